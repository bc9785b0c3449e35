"""Runs, plans, mistakes, interruptions."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any, Callable, Dict, List

import pytest

import turbid

from conftest import ROOT, Space, tree

MakeSpace = Callable[..., Space]


def slow() -> Dict[str, Any]:
    """Renders that take a minute by themselves, and one that takes no time."""
    pipeline = tree("slow", 32)
    pipeline["stages"]["frames"]["with"] = {"f_x": [0, 0.1], "phases": 3, "samples": 200_000, "method": "path"}
    return pipeline


def test_a_run_tells_what_it_did(fresh: MakeSpace) -> None:
    space = fresh()
    events: List[Dict[str, Any]] = []
    run = space.run(progress=events.append)
    assert (run.hits, run.failed, run.pipeline) == (0, 0, "fresh") and run.ran == 10
    assert events == run.events and events[-1]["event"] == "finished"
    assert {figure["quantity"] for figure in run.figures} == {"mu_a", "mu_s_prime"}
    assert run.measures["frames"]["flights"]["value"] > 0 and run.cpu_seconds > 0
    again = space.run()
    assert (again.hits, again.ran) == (10, 0) and "10 up to date" in repr(again)
    assert "data:image/png;base64," in again._repr_html_() and "mu_s_prime" in again._repr_html_()


def test_a_plan_is_what_a_run_does(fresh: MakeSpace) -> None:
    space = fresh()
    plan = turbid.plan(space.file, "modulation", outputs=space.outputs)
    assert [one.state for one in plan if one.stage == "frames"] == ["run"] and len(plan.stale) == len(plan) == 3
    assert plan[0].stage == "tissue" and "frames: 1 run" in repr(plan) and "frames" in plan._repr_html_()
    space.run("modulation")
    assert turbid.plan(space.file, "modulation", outputs=space.outputs).stale == []
    changed = turbid.plan(space.file, "modulation", set={"vars.samples": 300}, outputs=space.outputs)
    assert {one.stage for one in changed.stale} == {"frames", "modulation"}
    (why,) = turbid.explain(space.file, "frames", set={"vars.samples": 300}, outputs=space.outputs)
    assert (why.state, why.differences[0].field, why.differences[0].now) == ("run", "with.samples", "300")
    (hit,) = turbid.explain(space.file, "frames", outputs=space.outputs)
    assert hit.state == "hit" and hit.differences == []


def test_pipelines_come_back(fresh: MakeSpace, tmp_path: Path) -> None:
    odd = ["yes", "1e5", "0x10", "a: b", "# no", "", "- x", "tab\t", "µm \"q\" \\", "null", "~", "*x", "&x", "line\nline", "1:30", "=", "…"]
    for text in odd:
        pipeline = tree("odd")
        pipeline["about"] = text or "empty"
        pipeline["vars"]["text"] = text
        one = turbid.Pipeline(pipeline, tmp_path / "odd.yaml")
        assert one.check(outputs=tmp_path / "outputs") == []
    assert "samples: 256" in one.to_yaml() and one.name == "odd"
    with pytest.raises(turbid.InputError, match="samples"):
        turbid.check(one, set={"vars.samples": "many"}, outputs=tmp_path)
    unwritten = turbid.Pipeline(tree("unwritten"))
    assert unwritten.check(outputs=tmp_path / "outputs") == []
    assert unwritten.write().name == "unwritten.yaml"
    with pytest.raises(ValueError, match="name"):
        turbid.Pipeline({"stages": {}})
    with pytest.raises(TypeError, match="object"):
        turbid.Pipeline({"pipeline": "p", "x": object()})
    with pytest.raises(ValueError):
        turbid.Pipeline({"pipeline": "p", "x": float("nan")}).to_yaml()


def test_mistakes_have_places(fresh: MakeSpace) -> None:
    pipeline = tree("wrong")
    pipeline["stages"]["frames"]["with"]["f_x"] = [0, -0.1]
    pipeline["stages"]["modulation"]["with"] = {"methd": "phase_shift"}
    space = fresh(pipeline)
    with pytest.raises(turbid.InputError) as told:
        space.run()
    error = told.value
    wrong = [m for m in error.mistakes if m.severity == "error"]
    assert {"wrong_value", "unknown_key"} <= {m.kind for m in wrong} and {Path(m.file) for m in error.mistakes} == {space.file}
    lines = space.file.read_text().splitlines()
    assert any("-0.1" in lines[m.line - 1][m.column - 1 :] for m in wrong)
    unknown = next(m for m in error.mistakes if m.kind == "unknown_key")
    assert unknown.path.startswith("stages.modulation.with") and f"{unknown.line}:{unknown.column}" in str(error)
    assert "methd" in lines[unknown.line - 1][unknown.column - 1 :]
    calls: List[Callable[..., Any]] = [turbid.plan, turbid.check]
    for call in calls:
        with pytest.raises(turbid.InputError) as same:
            call(space.file, outputs=space.outputs)
        assert [m.line for m in same.value.mistakes] == [m.line for m in error.mistakes]


def test_names_that_nothing_has(small: Space) -> None:
    for call, says in [
        (lambda: turbid.run("nowhere.yaml"), "nowhere.yaml"),
        (lambda: turbid.open("nowhere.yaml", "maps"), "nowhere.yaml"),
        (lambda: small.run("mapps"), "mapps"),
        (lambda: small.run(set={"vars.sample": 1}), "sample"),
        (lambda: small.run(jobs=0), "jobs"),
        (lambda: turbid.explain(small.file, "mapps"), "mapps"),
    ]:
        with pytest.raises(turbid.InputError, match=says) as told:
            call()
        assert told.value.mistakes, says


def test_failures_name_their_instance(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """By a program that fails as the real one does where a disk is full."""
    program = tmp_path / "turbid"
    told = '{"event": "failed", "instance": "frames[x=1]", "message": "the disk is full"}\\n{"event": "finished", "failed": 1}'
    program.write_text(f"#!/bin/sh\nprintf '{told}\\n'\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("TURBID", str(program))
    with pytest.raises(turbid.RunError, match="the disk is full") as failed:
        turbid.run("p.yaml", progress=False)
    assert failed.value.failures == {"frames[x=1]": "the disk is full"}


def test_a_store_of_another_format(fresh: MakeSpace) -> None:
    space = fresh()
    (space.outputs / "store").mkdir(parents=True)
    (space.outputs / "store" / "format").write_text("7\n")
    for call in (lambda: space.run(), lambda: space.open("maps"), lambda: turbid.check(space.file, outputs=space.outputs)):
        with pytest.raises(turbid.InputError, match="format 7, and this turbid knows formats up to 1"):
            call()


def test_no_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TURBID", "/nowhere/turbid")
    with pytest.raises(turbid.ProgramError, match="/nowhere/turbid"):
        turbid.check("p.yaml")
    monkeypatch.setenv("TURBID", "/bin/echo")
    with pytest.raises(turbid.ProgramError, match="another version"):
        turbid.plan("p.yaml")


def test_ctrl_c_keeps_what_is_finished(fresh: MakeSpace) -> None:
    """The interrupt comes once `frames` is under way: the scenes before it are kept, no child goes on, the next run finds them."""
    space = fresh(slow())
    begun: List[Dict[str, Any]] = []

    def press(event: Dict[str, Any]) -> None:
        begun.append(event)
        if event.get("event") == "started" and event["instance"] == "frames":
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        space.run("modulation", progress=press)
    # The program had the time for its last words.
    assert begun[-1]["event"] == "finished" and begun[-1]["interrupted"] is True
    plan = turbid.plan(space.file, "modulation", outputs=space.outputs)
    assert [one.state for one in plan if one.stage == "tissue"] == ["hit"]
    with pytest.raises(turbid.NotRunError, match="has not run yet"):
        space.open("modulation")


def test_a_callback_that_fails_ends_the_run(fresh: MakeSpace) -> None:
    def fail(event: Dict[str, Any]) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fresh(slow()).run("modulation", progress=fail)


def test_a_run_in_progress_is_told(fresh: MakeSpace) -> None:
    """Of what another process is at work on, and of what waits for it."""
    space = fresh(slow())
    other = subprocess.Popen([turbid.executable(), "run", str(space.file), "modulation", "--outputs", str(space.outputs), "--json"],
                             stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert other.stdout is not None
    try:
        for line in other.stdout:
            if '"started"' in line and '"frames"' in line:
                break
        for selector in ("frames.frames", "modulation"):
            with pytest.raises(turbid.NotRunError, match="a run is at work on frames, try again when it has ended"):
                space.open(selector)
        # What is finished can be read meanwhile.
        assert space.open("tissue").kind == "record"
    finally:
        other.send_signal(signal.SIGINT)
        other.stdout.read()
        assert other.wait(60) == 130
    with pytest.raises(turbid.NotRunError, match="try `turbid run"):
        space.open("frames.frames")


def test_somebody_else_ends_the_program(fresh: MakeSpace) -> None:
    for number, error in ((signal.SIGTERM, turbid.InterruptedRun), (signal.SIGKILL, turbid.ProgramError)):
        space = fresh(slow())

        def end(event: Dict[str, Any], number: int = number) -> None:
            if event.get("event") == "started" and event["instance"] == "frames":
                children = subprocess.run(["pgrep", "-P", str(os.getpid()), "-f", str(space.file)], capture_output=True, text=True)
                for pid in children.stdout.split():
                    os.kill(int(pid), number)

        with pytest.raises(error):
            space.run("modulation", progress=end)


def test_the_import_brings_no_arrays() -> None:
    """Neither the import nor the first use of each part that needs none of them loads a large package: they take longer than all the rest."""
    code = textwrap.dedent("""
        import sys
        import turbid
        turbid.run, turbid.open, turbid.plan, turbid.Pipeline, turbid.scan, turbid.dataset
        assert not {"numpy", "xarray", "polars", "torch", "matplotlib"} & set(sys.modules)
    """)
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "python")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
