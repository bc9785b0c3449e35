"""Runs."""

from __future__ import annotations

import warnings
from typing import Any, Dict, List, Mapping, Optional, Sequence, Union

from . import _program
from ._pipeline import File, common
from ._program import Event, PathLike
from ._progress import Progress, choose
from .errors import TurbidWarning


class Run:
    """What a run did. `events` has all that the program told, as dicts."""

    def __init__(self, file: File, options: Mapping[str, Any], events: Sequence[Event]) -> None:
        self._file, self._options = file, dict(options)
        self.events = list(events)
        finished = [event for event in self.events if event.get("event") == "finished"]
        last: Event = finished[-1] if finished else {}
        self.pipeline: str = last.get("pipeline", "")
        self.hits: int = last.get("hits", 0)
        """How many instances were up to date."""
        self.ran: int = last.get("ran", 0)
        self.failed: int = last.get("failed", 0)
        self.seconds: float = last.get("seconds", 0.0)
        """Wall-clock seconds."""

    def _of(self, kind: str) -> List[Event]:
        return [event for event in self.events if event.get("event") == kind]

    @property
    def warnings(self) -> List[str]:
        """What was warned of, each behind the instance that it is about."""
        return [f"{event['instance']}: {event['message']}" for event in self._of("warning")]

    @property
    def cpu_seconds(self) -> float:
        """CPU seconds of what ran."""
        return float(sum(event["cpu_seconds"] for event in self._of("ran")))

    @property
    def figures(self) -> List[Dict[str, Any]]:
        """The figures that the run ends with: dicts of the columns of metrics, with `stage` and axes."""
        return [{"stage": event["stage"], **event["axes"], **event["figures"]} for event in self._of("figures")]

    @property
    def measures(self) -> Dict[str, Dict[str, Any]]:
        """What stages that ran measured: by instance and name a dict of value and unit."""
        return {event["instance"]: event["measures"] for event in self._of("ran")}

    def __repr__(self) -> str:
        return f"{self.pipeline}: {self.hits} up to date, {self.ran} ran, {self.failed} failed in {self.seconds:.2f} s"

    def _repr_html_(self) -> str:
        from ._html import picture, table

        rows = []
        columns = ["stage", "region", "quantity", "bias_percent", "rmse_percent", "masked_percent"]
        for figure in self.figures:
            cells = [figure.get(name) for name in columns]
            rows.append([f"{cell:.3g}" if isinstance(cell, float) else "" if cell is None else cell for cell in cells])
        return f"<p>{self!r}</p>" + (table(columns, rows) if rows else "") + picture(self._picture())

    def _picture(self) -> Optional[str]:
        """The picture of the last stage that has one."""
        arguments = common("show", self._file, self._options.get("set"), self._options.get("outputs"))
        told = _program.ask_json([*arguments, "--json", "--places"])
        pictures = [port["picture"] for one in told["instances"] for port in one["ports"].values() if port["picture"]]
        return pictures[-1] if pictures else None


def run(
    file: File,
    *targets: str,
    set: Optional[Mapping[str, Any]] = None,
    jobs: Optional[int] = None,
    memory: Union[None, int, str] = None,
    force: Sequence[str] = (),
    keep_going: bool = False,
    outputs: Optional[PathLike] = None,
    progress: Progress = None,
) -> Run:
    """Runs what is stale of the targets: stages, STAGE.PORT, studies and data sets; all leaves where none is named.

    `set` overrides values of the file: `{"vars.f_x": 0.2}`. `jobs` is how many threads, `memory` how many bytes (or `"8GB"`) stages
    may take together. `force` names stages to run again, `keep_going` goes on with what does not depend on a failed one.
    `outputs` is the folder of results, `outputs` by default. `progress`: a line in terminals and notebooks by default; `False` for
    none; a function is given each event.

    Ctrl-C lets the program end with what it has finished, and is raised then; the next run goes on from there.

    Errors: `InputError` with file, line and column of each mistake, before anything runs; `RunError` with what failed.
    """
    arguments = [*common("run", file, set, outputs), *targets, "--json"]
    for stage in force:
        arguments += ["--force", stage]
    if jobs is not None:
        arguments += ["--jobs", str(jobs)]
    if memory is not None:
        arguments += ["--memory", str(memory)]
    if keep_going:
        arguments.append("--keep-going")
    events: List[Event] = []
    show = choose(progress)

    def take(line: str) -> None:
        event = _program.parsed(line)
        events.append(event)
        show(event)

    try:
        ended = _program.stream(arguments, take)
    finally:
        # Lines that were shown meanwhile go, however the run ended.
        if not any(event.get("event") == "finished" for event in events) and not callable(progress):
            show({"event": "finished"})
    if ended.code != 0:
        failures = {event["instance"]: event["message"] for event in events if event.get("event") == "failed"}
        _program.fail(ended, failures)
    done = Run(file, {"set": set, "outputs": outputs}, events)
    for text in done.warnings:
        warnings.warn(text, TurbidWarning, stacklevel=2)
    return done
