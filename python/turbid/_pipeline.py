"""Pipelines: files, and trees of dicts that are written as such."""

from __future__ import annotations

import json
import os
import re
from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Mapping, Optional, Union

from ._program import PathLike

if TYPE_CHECKING:
    from pathlib import Path

    import polars

    from ._open import Result
    from ._plan import Explanation, Plan
    from ._progress import Progress
    from ._run import Run
    from .errors import Mistake

#: Words that YAML reads as something else than text.
_WORDS = {"", "null", "true", "false", "yes", "no", "on", "off", "y", "n", "nan", "inf"}
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*(?: [A-Za-z0-9_./-]+)*")
_WIDTH = 100


class Pipeline:
    """A pipeline as a tree of dicts and lists, as `docs/pipeline-files.md` describes it.

    `path` is where the file is written; relative names of files in the pipeline are looked for beside it. Without a path it is
    written to a temporary folder that goes with this process.
    """

    def __init__(self, tree: Mapping[str, Any], path: Optional[PathLike] = None) -> None:
        if not isinstance(tree.get("pipeline"), str):
            raise ValueError("a pipeline needs a name: {'pipeline': 'NAME', 'stages': {..}}")
        self.tree: Dict[str, Any] = _copied(tree)
        self._given = None if path is None else os.path.abspath(os.fspath(path))
        self._temporary: Optional[Any] = None

    @property
    def name(self) -> str:
        """What stands behind `pipeline:`."""
        name = self.tree["pipeline"]
        assert isinstance(name, str)
        return name

    def to_yaml(self) -> str:
        """The text of the file."""
        return _block(self.tree, 0)

    def write(self, path: Optional[PathLike] = None) -> Path:
        """Writes the file, here or where it was said to be, and tells where."""
        from pathlib import Path

        if path is not None:
            self._given = os.path.abspath(os.fspath(path))
        to = Path(self._given or self._own_path())
        text = self.to_yaml()
        # Unchanged files keep their times.
        if not to.exists() or to.read_text(encoding="utf-8") != text:
            to.write_text(text, encoding="utf-8")
        return to

    def _own_path(self) -> str:
        import tempfile

        if self._temporary is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="turbid-")
        return os.path.join(self._temporary.name, f"{re.sub(r'[^A-Za-z0-9_.-]', '_', self.name)}.yaml")

    def __repr__(self) -> str:
        return f"Pipeline({self.name!r}: {', '.join(self.tree.get('stages', {}))})"

    def run(self, *targets: str, progress: Progress = None, **options: Any) -> Run:
        """As `turbid.run`."""
        from ._run import run

        return run(self, *targets, progress=progress, **options)

    def plan(self, *targets: str, **options: Any) -> Plan:
        """As `turbid.plan`."""
        from ._plan import plan

        return plan(self, *targets, **options)

    def check(self, **options: Any) -> List[Mistake]:
        """As `turbid.check`."""
        from ._plan import check

        return check(self, **options)

    def explain(self, stage: str, **options: Any) -> List[Explanation]:
        """As `turbid.explain`."""
        from ._plan import explain

        return explain(self, stage, **options)

    def open(self, selector: str, **options: Any) -> Result:
        """As `turbid.open`."""
        from ._open import open

        return open(self, selector, **options)

    def scan(self, selector: str, **options: Any) -> polars.LazyFrame:
        """As `turbid.scan`."""
        from ._scan import scan

        return scan(self, selector, **options)


#: What functions take as a pipeline.
File = Union[str, "os.PathLike[str]", Pipeline]


def path_of(file: File) -> str:
    """The path of a pipeline file as the program takes it."""
    path = os.fspath(file.write()) if isinstance(file, Pipeline) else os.fspath(file)
    return os.path.join(os.curdir, path) if path.startswith("-") else path


def common(command: str, file: File, set: Optional[Mapping[str, Any]], outputs: Optional[PathLike]) -> List[str]:
    """The arguments that all commands have."""
    arguments = [command, path_of(file)]
    for path, value in (set or {}).items():
        arguments += ["--set", f"{path}={_flow(_plain(value))}"]
    if outputs is not None:
        arguments += ["--outputs", os.fspath(outputs)]
    return arguments


def _plain(value: Any) -> Any:
    """Arrays and numbers of NumPy as lists and numbers of Python."""
    return value.tolist() if hasattr(value, "tolist") else value


def _copied(tree: Any) -> Any:
    tree = _plain(tree)
    if isinstance(tree, Mapping):
        wrong = [key for key in tree if not isinstance(key, str)]
        if wrong:
            raise TypeError(f"keys of a pipeline are text, not {wrong[0]!r}")
        return {key: _copied(value) for key, value in tree.items()}
    if isinstance(tree, (list, tuple)):
        return [_copied(value) for value in tree]
    if tree is None or isinstance(tree, (bool, int, float, str)):
        return tree
    if isinstance(tree, os.PathLike):
        return os.fspath(tree)
    raise TypeError(f"a pipeline holds numbers, text, lists and dicts, not {tree!r}")


def _text(text: str) -> str:
    """A text in quotes where YAML would read something else without them."""
    if _PLAIN.fullmatch(text) and text.lower() not in _WORDS:
        return text
    return json.dumps(text, ensure_ascii=False)


def _flow(value: Any) -> str:
    """In one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_text(key)}: {_flow(_plain(child))}" for key, child in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_flow(_plain(child)) for child in value) + "]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, os.PathLike):
        return _text(os.fspath(value))
    return json.dumps(value, allow_nan=False)


def _is_flat(tree: Mapping[str, Any]) -> bool:
    def inner(values: Iterable[Any]) -> bool:
        return not any(isinstance(value, Mapping) and value for value in values)

    return inner(tree.values())


def _block(tree: Mapping[str, Any], depth: int) -> str:
    lines = []
    for key, value in tree.items():
        head = f"{'  ' * depth}{_text(key)}:"
        if isinstance(value, Mapping) and value:
            line = f"{head} {_flow(value)}"
            if depth == 0 or len(line) > _WIDTH or not _is_flat(value):
                lines.append(f"{head}\n{_block(value, depth + 1)}")
                continue
            lines.append(f"{line}\n")
        else:
            lines.append(f"{head} {_flow(value)}\n")
    return "".join(lines)
