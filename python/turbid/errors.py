"""What can go wrong, as exceptions that say where."""

from __future__ import annotations

from typing import Any, Mapping, NamedTuple, Optional, Sequence, Tuple


class Mistake(NamedTuple):
    """One mistake, or warning, with its place.

    `line` and `column` count from 1 and are 0 where the mistake is in no line of a file; `file` is empty where it is in none.
    """

    severity: str
    """`error` or `warning`."""
    kind: str
    """`syntax`, `unknown_key`, `unknown_name`, `missing`, `wrong_type`, `wrong_value`, `wrong_unit`, `graph`, `too_many`, `file`,
    `memory`, `suspect`, `usage`, `not_run` or `failed`."""
    file: str
    line: int
    column: int
    path: str
    """The place in the pipeline, such as `stages.frames.with.samples`."""
    message: str
    hint: Optional[str]

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Mistake:
        """From the program's JSON."""
        return cls(**{name: told.get(name) for name in cls._fields})  # type: ignore[arg-type]

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}: " if self.line else f"{self.file}: " if self.file else ""
        path = f"{self.path}: " if self.path else ""
        hint = f" ({self.hint})" if self.hint else ""
        return f"{place}{path}{self.message}{hint}"


class TurbidError(Exception):
    """All errors of this module. `mistakes` has each; `file`, `line`, `column`, `kind`, `hint` are those of the first."""

    def __init__(self, message: str, mistakes: Sequence[Mistake] = ()) -> None:
        super().__init__(message)
        self.mistakes: Tuple[Mistake, ...] = tuple(mistakes)

    def _first(self) -> Mistake:
        return self.mistakes[0] if self.mistakes else Mistake("error", "failed", "", 0, 0, "", str(self), None)

    @property
    def file(self) -> str:
        return self._first().file

    @property
    def line(self) -> int:
        return self._first().line

    @property
    def column(self) -> int:
        return self._first().column

    @property
    def kind(self) -> str:
        return self._first().kind

    @property
    def hint(self) -> Optional[str]:
        return self._first().hint


class InputError(TurbidError, ValueError):
    """What was given is wrong: a pipeline file, a name of a stage or an axis, an option, a folder. Nothing has run."""


class NotRunError(TurbidError, LookupError):
    """A result that no run has made yet with these parameters, or that a run is at work on."""


class RunError(TurbidError, RuntimeError):
    """Something failed while it ran. What was finished is kept. `failures` has the message of each instance that failed."""

    def __init__(self, message: str, mistakes: Sequence[Mistake] = (), failures: Optional[Mapping[str, str]] = None) -> None:
        super().__init__(message, mistakes)
        self.failures = dict(failures or {})


class InterruptedRun(TurbidError, RuntimeError):
    """Somebody else ended the program (SIGINT, SIGTERM). What was finished is kept. Ctrl-C in Python is KeyboardInterrupt."""


class ProgramError(TurbidError, RuntimeError):
    """The program is not there, was killed, or said what this module does not understand."""


class TurbidWarning(UserWarning):
    """Legal, but probably not meant."""
