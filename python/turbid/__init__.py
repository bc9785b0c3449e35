"""turbid designs and simulates spatial frequency domain imaging. This module runs the program and reads what it makes.

    import turbid
    turbid.run("mine.yaml")
    mu_a = turbid.open("mine.yaml", "maps")["mu_a"]      # an xarray.DataArray in mm^-1, with standard errors and mask

Lengths are mm, coefficients mm^-1, angles rad. `docs/python.md` is the tutorial.
"""

#: What type checkers take as true; `typing` itself would be most of the import.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, List

    from ._dataset import Samples, dataset
    from ._exr import Layer, Stack, read_exr
    from ._images import REASONS
    from ._open import Result, open, open_all
    from ._pipeline import Pipeline
    from ._plan import Difference, Explanation, Plan, Planned, check, explain, plan
    from ._program import executable
    from ._run import Run, run
    from ._scan import export, scan, units
    from .errors import (
        InputError,
        InterruptedRun,
        Mistake,
        NotRunError,
        ProgramError,
        RunError,
        TurbidError,
        TurbidWarning,
    )

__all__ = [
    "REASONS",
    "Difference",
    "Explanation",
    "InputError",
    "InterruptedRun",
    "Layer",
    "Mistake",
    "NotRunError",
    "Pipeline",
    "Plan",
    "Planned",
    "ProgramError",
    "Result",
    "Run",
    "RunError",
    "Samples",
    "Stack",
    "TurbidError",
    "TurbidWarning",
    "check",
    "dataset",
    "executable",
    "explain",
    "export",
    "open",
    "open_all",
    "plan",
    "read_exr",
    "run",
    "scan",
    "units",
]

#: Where each name is; a file is read when the first of its names is asked for, so that the import takes next to no time.
_MODULES = {
    "_dataset": "Samples dataset",
    "_exr": "Layer Stack read_exr",
    "_images": "REASONS",
    "_open": "Result open open_all",
    "_pipeline": "Pipeline",
    "_plan": "Difference Explanation Plan Planned check explain plan",
    "_program": "executable",
    "_run": "Run run",
    "_scan": "export scan units",
    "errors": "InputError InterruptedRun Mistake NotRunError ProgramError RunError TurbidError TurbidWarning",
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> "Any":
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> "List[str]":
    return sorted({*globals(), *__all__})
