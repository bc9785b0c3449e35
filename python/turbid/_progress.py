"""How far a run is, in terminals and notebooks."""

from __future__ import annotations

import sys
from typing import Any, Callable, Dict, Optional, Union

from ._program import Event

#: `None` shows progress where somebody looks on, `False` never; a function gets each event of the program as a dict.
Progress = Union[None, bool, Callable[[Event], None]]


def choose(progress: Progress) -> Callable[[Event], None]:
    """What is done with each event."""
    if callable(progress):
        return progress
    if progress is False:
        return lambda event: None
    if _in_notebook():
        return Notebook()
    if progress is True or sys.stderr.isatty():
        return Terminal()
    return lambda event: None


def _in_notebook() -> bool:
    shell = sys.modules.get("IPython")
    instance: Optional[Any] = shell.get_ipython() if shell is not None else None
    return instance is not None and hasattr(instance, "kernel")


class Line:
    """What is known of a run, in one line."""

    def __init__(self) -> None:
        self.running: Dict[str, None] = {}
        self.ended = 0
        self.failed = 0
        self.heartbeat: Optional[Event] = None

    def take(self, event: Event) -> str:
        """The line after an event."""
        kind, instance = event.get("event"), event.get("instance", "")
        if kind == "started":
            self.running[instance] = None
        elif kind in ("ran", "found", "failed"):
            self.running.pop(instance, None)
            self.ended += 1
            self.failed += kind == "failed"
        elif kind == "heartbeat":
            self.heartbeat = event
        return self.text()

    def text(self) -> str:
        parts = [f"{self.ended} done"]
        beat = self.heartbeat
        if beat is not None:
            parts = [f"{self.ended} of {beat['instances']} done", f"{100 * (beat['part'] or 0):.0f} %"]
            if beat["seconds_left"] is not None:
                parts.append(f"{_duration(beat['seconds_left'])} left")
        if self.failed:
            parts.append(f"{self.failed} failed")
        if self.running:
            names = list(self.running)
            parts.append(", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else ""))
        return "  ".join(parts)


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


class Terminal:
    """One line of a terminal, written over and over; nothing of it stays."""

    def __init__(self) -> None:
        self.line = Line()
        self.width = 0

    def __call__(self, event: Event) -> None:
        import shutil

        text = self.line.take(event)
        if event.get("event") == "finished":
            text = ""
        text = text[: shutil.get_terminal_size().columns - 1]
        sys.stderr.write("\r" + text.ljust(self.width) + ("\r" if not text else ""))
        sys.stderr.flush()
        self.width = len(text)


class Notebook:
    """A bar below the cell, which goes when the run has ended."""

    def __init__(self) -> None:
        self.line = Line()
        self.display: Optional[Any] = None

    def __call__(self, event: Event) -> None:
        from html import escape

        from IPython import display

        text = self.line.take(event)
        part = (self.line.heartbeat or {}).get("part") or 0.0
        html = f"<progress value='{part}' max='1'></progress> <code>{escape(text)}</code>"
        shown = display.HTML("" if event.get("event") == "finished" else html)
        if self.display is None:
            self.display = display.display(shown, display_id=True)
        else:
            self.display.update(shown)
