"""Small pieces of HTML for notebooks."""

from __future__ import annotations

import base64
from html import escape
from typing import Iterable, Optional, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Texts in rows below a head."""
    cells = "".join(f"<th style='text-align:left'>{escape(name)}</th>" for name in head)
    lines = ["".join(f"<td style='text-align:left'>{escape(str(cell))}</td>" for cell in row) for row in rows]
    return f"<table><tr>{cells}</tr>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def picture(path: Optional[str]) -> str:
    """A PNG file, or nothing where there is none."""
    if path is None:
        return ""
    try:
        with open(path, "rb") as file:
            data = base64.b64encode(file.read()).decode("ascii")
    except OSError:
        return ""
    return f"<img style='max-width:100%' src='data:image/png;base64,{data}'>"
