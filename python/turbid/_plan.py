"""What a run would do, and what is wrong with a file, before anything runs."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence

from . import _program
from ._pipeline import File, common
from ._program import PathLike
from .errors import InputError, Mistake


class Planned(NamedTuple):
    """An instance of a plan."""

    stage: str
    axes: Dict[str, Any]
    state: str
    """`hit` (is up to date), `run`, or `waits` (for what runs before it)."""
    reasons: List[str]
    """Why it runs, or what it waits for."""
    seconds: Optional[float]
    """CPU seconds that it is going to take, where that is known."""
    memory: Optional[int]
    """Bytes of memory at the most."""
    told: Dict[str, Any]
    """All that the program says of it: method, kernel, what is left out, what the outputs will hold."""


class Plan(Sequence[Planned]):
    """The instances that targets need, in the order in which they run."""

    def __init__(self, told: Mapping[str, Any]) -> None:
        self.told = dict(told)
        self._instances = [
            Planned(one["stage"], one["axes"], one["state"], one["reasons"], one.get("seconds"), one.get("memory"), one)
            for one in told["instances"]
        ]

    def __len__(self) -> int:
        return len(self._instances)

    def __getitem__(self, index: Any) -> Any:
        return self._instances[index]

    @property
    def stale(self) -> List[Planned]:
        """Those that are not up to date."""
        return [one for one in self._instances if one.state != "hit"]

    @property
    def cpu_seconds(self) -> float:
        """CPU seconds of all that is stale, as far as they are known."""
        return sum(one.seconds or 0.0 for one in self.stale)

    @property
    def memory(self) -> int:
        """Bytes that what runs side by side takes at the most."""
        return int(self.told["memory"]["at_most"])

    def _counts(self) -> Dict[str, Dict[str, int]]:
        counts: Dict[str, Dict[str, int]] = {}
        for one in self._instances:
            of = counts.setdefault(one.stage, {})
            of[one.state] = of.get(one.state, 0) + 1
        return counts

    def __repr__(self) -> str:
        lines = [f"{stage}: {', '.join(f'{n} {state}' for state, n in of.items())}" for stage, of in self._counts().items()]
        return "\n".join([*lines, f"about {self.cpu_seconds:.2g} CPU s, {self.memory / 1e6:.0f} MB"])

    def _repr_html_(self) -> str:
        from ._html import table

        rows = [[stage, ", ".join(f"{n} {state}" for state, n in of.items())] for stage, of in self._counts().items()]
        return table(["stage", "instances"], rows) + f"about {self.cpu_seconds:.2g} CPU s, {self.memory / 1e6:.0f} MB"


class Difference(NamedTuple):
    """A field in which an instance differs from an earlier result; None where one side has nothing."""

    field: str
    before: Optional[str]
    now: Optional[str]


class Explanation(NamedTuple):
    """Why an instance would run, or that it would not."""

    instance: str
    state: str
    """`hit`, `run`, `waits` or `not needed`."""
    reasons: List[str]
    differences: List[Difference]
    """From the nearest earlier result, if there is one."""


def plan(
    file: File, *targets: str, set: Optional[Mapping[str, Any]] = None, outputs: Optional[PathLike] = None
) -> Plan:
    """What a run would do; nothing runs.

    `targets` are stages, or STAGE.PORT; all leaves where there is none. `set` overrides values: `{"vars.f_x": 0.2}`.

    Errors: `InputError` with file, line and column of every mistake.
    """
    return Plan(_program.ask_json([*common("plan", file, set, outputs), *targets, "--json"]))


def check(
    file: File, *, set: Optional[Mapping[str, Any]] = None, outputs: Optional[PathLike] = None
) -> List[Mistake]:
    """The warnings of a pipeline file without mistakes. Errors: `InputError` with every mistake of one that has some."""
    ended = _program.call([*common("check", file, set, outputs), "--json"])
    if ended.code not in (0, 1, 2) or not ended.out:
        _program.fail(ended)
    found = [Mistake.of(told) for told in _program.parsed(ended.out)]
    if ended.code == 0:
        return found
    wrong = [mistake for mistake in found if mistake.severity == "error"]
    if ended.code == 1 or not wrong:
        _program.fail(ended)
    raise InputError("\n".join(map(str, wrong)), found)


def explain(
    file: File, stage: str, *, set: Optional[Mapping[str, Any]] = None, outputs: Optional[PathLike] = None
) -> List[Explanation]:
    """Why the instances of a stage would run: the fields in which each differs from the nearest earlier result (32 at the most)."""

    def of(told: Mapping[str, Any]) -> Explanation:
        nearest = told["nearest"] or {"differences": []}
        differences = [Difference(d["field"], d["before"], d["now"]) for d in nearest["differences"]]
        return Explanation(told["instance"], told["state"], told["reasons"], differences)

    told = _program.ask_json([*common("explain", file, set, outputs), stage, "--json"])
    return [of(one) for one in told["instances"]]
