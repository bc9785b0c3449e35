"""Data sets that `turbid dataset build` made, as arrays and for PyTorch."""

from __future__ import annotations

import io
import json
import os
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Sequence, Tuple

from . import _parquet
from ._program import PathLike

if TYPE_CHECKING:
    import numpy
    import torch.utils.data

    Array = numpy.ndarray[Any, Any]


class Samples(Sequence[Dict[str, Any]]):
    """The samples of one split. `samples[0]` is a dict by column: tensors as float32 arrays (channels, rows, columns), numbers, text.

    PyTorch's DataLoader takes it as it is.
    """

    def __init__(self, folder: PathLike, split: str = "train") -> None:
        self.folder = os.fspath(folder)
        manifest = os.path.join(self.folder, "dataset.json")
        try:
            with io.open(manifest, encoding="utf-8") as file:
                self.manifest: Dict[str, Any] = json.load(file)
        except OSError as error:
            raise FileNotFoundError(f"{self.folder} holds no data set ({error}); `turbid dataset build FILE --to DIR` makes one") from error
        self.split = split
        self._shards = [shard for shard in self.manifest["shards"] if shard["split"] == split]
        if not self._shards:
            splits = sorted({shard["split"] for shard in self.manifest["shards"]})
            raise ValueError(f"{self.folder} has no split {split!r}; it has {', '.join(splits)}")
        self.features: Dict[str, Dict[str, Any]] = {c["name"]: c for c in self.manifest["columns"] if "shape" in c}
        """The tensors by name: `shape`, `unit`, `channels`, .. of each."""
        self._columns: Optional[Dict[str, Array]] = None

    def arrays(self) -> Dict[str, Array]:
        """All columns: tensors as (samples, channels, rows, columns), the others as (samples,). Read once, and kept."""
        if self._columns is None:
            parts = [self._read(os.path.join(self.folder, shard["file"])) for shard in self._shards]
            import numpy

            self._columns = {name: numpy.concatenate([part[name] for part in parts]) for name in parts[0]}
        return self._columns

    def _read(self, path: str) -> Dict[str, Array]:
        return _read_tar(path) if path.endswith(".tar") else self._read_parquet(path)

    def _read_parquet(self, path: str) -> Dict[str, Array]:
        import polars

        frame = _parquet.read(path)
        columns: Dict[str, Array] = {}
        for name in frame.columns:
            series = frame[name]
            if name in self.features:
                shape = (len(series), *self.features[name]["shape"])
                flat = series
                while isinstance(flat.dtype, (polars.List, polars.Array)):
                    flat = flat.explode()
                columns[name] = flat.to_numpy().reshape(shape)
            else:
                columns[name] = series.to_numpy()
        return columns

    def __len__(self) -> int:
        return sum(int(shard["rows"]) for shard in self._shards)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return {name: column[index] for name, column in self.arrays().items()}

    def torch(self, *names: str) -> torch.utils.data.TensorDataset:
        """These columns as a TensorDataset, all tensors where none is named; each sample is a tuple in that order.

        Errors: ImportError where PyTorch is not installed; KeyError for a column that there is not.
        """
        import numpy
        import torch
        from torch.utils.data import TensorDataset

        arrays = self.arrays()
        unknown = [name for name in names if name not in arrays]
        if unknown:
            raise KeyError(f"there is no column {unknown[0]!r}; there are {', '.join(arrays)}")
        chosen = [arrays[name] for name in (names or tuple(self.features))]
        return TensorDataset(*(torch.from_numpy(numpy.ascontiguousarray(array)) for array in chosen))

    def __repr__(self) -> str:
        features = ", ".join(f"{name} {tuple(of['shape'])}" for name, of in self.features.items())
        return f"{self.manifest.get('dataset', self.folder)}: {len(self)} samples of {self.split}: {features}"

    def _repr_html_(self) -> str:
        from html import escape

        from ._html import picture

        return f"<p>{escape(repr(self))}</p>" + picture(os.path.join(self.folder, "overview.png"))


def _read_tar(path: str) -> Dict[str, Array]:
    """A shard of WebDataset: of each sample ID.json and ID.npz."""
    import tarfile

    import numpy

    samples: Dict[str, Dict[str, Any]] = {}
    with tarfile.open(path) as tar:
        for member in tar:
            stem, _, ending = member.name.rpartition(".")
            content = tar.extractfile(member)
            if content is None:
                continue
            known: Mapping[str, Any] = json.load(content) if ending == "json" else dict(numpy.load(io.BytesIO(content.read())))
            samples.setdefault(stem, {}).update(known)
    rows: List[Dict[str, Any]] = list(samples.values())
    names: Tuple[str, ...] = tuple(rows[0]) if rows else ()
    return {name: numpy.stack([numpy.asarray(row[name]) for row in rows]) for name in names}


def dataset(folder: PathLike, split: str = "train") -> Samples:
    """A split of a data set, of either format: `dataset("spots", "train").torch("frames", "mu_a_true")`.

    Errors: FileNotFoundError where there is no data set, ValueError where it has no such split.
    """
    return Samples(folder, split)
