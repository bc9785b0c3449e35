"""Every Python block of the documents that is about this module runs, in the order of its page, and is typed."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, List, Tuple

import pytest

import turbid

from conftest import ROOT

FENCE = re.compile(r"^```(\w+)((?: [\w.]+)*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
HAS_TORCH = importlib.util.find_spec("torch") is not None


def blocks(page: str) -> List[Tuple[str, str, str]]:
    """Language, further words and text of each block."""
    return [(m[1], m[2].strip(), m[3]) for m in FENCE.finditer((ROOT / page).read_text(encoding="utf-8"))]


def test_the_tutorial_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: Dict[str, Any] = {"__name__": "tutorial"}
    ran = 0
    for language, words, text in blocks("docs/python.md"):
        if language == "sh":
            for line in filter(lambda line: line.startswith("turbid "), text.splitlines()):
                subprocess.run([turbid.executable(), *shlex.split(line, comments=True)[1:]], check=True)
        elif language == "python" and (HAS_TORCH or words != "torch"):
            exec(compile(text, "docs/python.md", "exec"), names)
            ran += 1
    assert ran >= 6 and (tmp_path / "mu_a.png").stat().st_size > 5000


def test_the_tutorial_is_typed(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    text = "\n".join(text for language, words, text in blocks("docs/python.md") if language == "python" and (HAS_TORCH or words != "torch"))
    (tmp_path / "tutorial.py").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "--allow-subclassing-any", "--cache-dir", str(tmp_path / "cache"), "tutorial.py"]
    environment = {**os.environ, "MYPYPATH": str(ROOT / "python")}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout
