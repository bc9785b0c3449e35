"""Parquet files as polars frames.

Polars before 1.43, which includes the last for Python 3.9, refuses the order of floats that the files state ("bad data",
"ColumnOrder union"). Where pyarrow is installed it reads them instead.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Dict, List, Union

if TYPE_CHECKING:
    import polars


def read(source: Union[str, bytes]) -> polars.DataFrame:
    """All rows of a file, or of its bytes.

    Errors: ImportError, where polars cannot read it and pyarrow is missing.
    """
    import polars

    try:
        return polars.read_parquet(source, memory_map=False)
    except polars.exceptions.ComputeError as error:
        _needs_pyarrow(error)
        return polars.read_parquet(io.BytesIO(source) if isinstance(source, bytes) else source, use_pyarrow=True)


def metadata(path: str) -> Dict[str, str]:
    """The key-value pairs of a file's footer."""
    import polars

    try:
        return polars.read_parquet_metadata(path)
    except polars.exceptions.ComputeError as error:
        _needs_pyarrow(error)
        import pyarrow.parquet

        return {key.decode(): value.decode() for key, value in pyarrow.parquet.read_metadata(path).metadata.items()}


def columns(path: str) -> List[str]:
    """The names of a file's columns, in order."""
    import polars

    try:
        return list(polars.read_parquet_schema(path))
    except polars.exceptions.ComputeError as error:
        _needs_pyarrow(error)
        import pyarrow.parquet

        return list(pyarrow.parquet.read_schema(path).names)


def _needs_pyarrow(error: Exception) -> None:
    import polars

    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise ImportError(
            f"polars {polars.__version__} cannot read the Parquet files of turbid ({error}): install polars 1.43 or newer, or pyarrow beside it"
        ) from error
