"""The outputs of many instances at once."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional

from . import _parquet, _program
from ._pipeline import File, common
from ._program import PathLike

if TYPE_CHECKING:
    import polars


def export(
    file: File,
    selector: str,
    to: PathLike,
    *,
    all: bool = True,
    set: Optional[Mapping[str, Any]] = None,
    outputs: Optional[PathLike] = None,
) -> List[str]:
    """Writes an output to a file, by `turbid export`, and tells which were written. `docs/export.md` describes the formats.

    With `all` the outputs of all instances that the selector names: image stacks to one .npz or to .mat files, tables and records to
    one .parquet, .npz, .mat or .csv with the axes as columns; to a folder (a name that ends with a slash) each as the store has it.
    """
    name = os.fspath(to)
    arguments = [*common("export", file, set, outputs), selector, "--to", name]
    told = _program.ask([*arguments, "--all"] if all else arguments)
    return [line[len("wrote ") :] for line in told.splitlines() if line.startswith("wrote ")]


class _Gathered:
    """A Parquet file of all instances, in a folder that goes with this object."""

    def __init__(self, file: File, selector: str, set: Optional[Mapping[str, Any]], outputs: Optional[PathLike]) -> None:
        import tempfile

        self.folder = tempfile.TemporaryDirectory(prefix="turbid-")
        self.path = os.path.join(self.folder.name, "all.parquet")
        export(file, selector, self.path, set=set, outputs=outputs)

    def __enter__(self) -> str:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.folder.cleanup()


def scan(
    file: File, selector: str, *, set: Optional[Mapping[str, Any]] = None, outputs: Optional[PathLike] = None
) -> polars.LazyFrame:
    """The rows of a table, or the records, of all instances: `scan("sweep.yaml", "metrics")`.

    Columns are those of the table, behind one for each axis (`axis.NAME` where the table has a column of that name) and one for
    each attribute in which instances differ (`attributes.NAME`). All rows are in memory: for more than that, `export` to a .parquet
    and `polars.scan_parquet`. `units` gives the unit of each column.

    Errors: those of `open`.
    """
    with _Gathered(file, selector, set, outputs) as path:
        return _parquet.read(path).lazy()


def units(
    file: File, selector: str, *, set: Optional[Mapping[str, Any]] = None, outputs: Optional[PathLike] = None
) -> Dict[str, str]:
    """The unit of each column of `scan`; "1" for pure numbers, "" for text."""
    with _Gathered(file, selector, set, outputs) as path:
        told: Dict[str, str] = json.loads(_parquet.metadata(path)["turbid"])["attributes"]["units"]
        return {name: told[name] for name in _parquet.columns(path)}
