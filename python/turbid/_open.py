"""Stored results."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Tuple

from . import _parquet, _program
from ._exr import Stack, read_exr
from ._pipeline import File, common
from ._program import PathLike
from .errors import InputError, NotRunError, ProgramError

if TYPE_CHECKING:
    import polars
    import xarray


class Result:
    """An output of an instance: an image stack (`dataset`), a table (`table`) or a record (`record`).

    `result["mu_a"]` is one quantity of a stack as a DataArray: values (masked pixels hold 0), `attrs["units"]`, coordinates `y` and
    `x` (mm from the middle of the image, y upwards, where the pitch of the pixels is known), and beside them as coordinates
    `standard_error`, `error_unknown`, `mask` (a number of `turbid.REASONS`) and `good`. `result["mu_a"].where(...)` keeps them.
    """

    def __init__(self, ask: List[str], instance: Mapping[str, Any], port: str) -> None:
        self._ask = ask
        self.stage: str = instance["stage"]
        self.port = port
        self.axes: Dict[str, Any] = instance["axes"]
        """Values of its axes, and what a draw gave it."""
        self.key: str = instance["key"]
        place = instance["ports"][port]
        self.kind: str = place["kind"]
        """`images`, `table` or `record`."""
        self.payload: str = place["payload"]
        """What it holds: `maps`, `frames`, .. (`docs/payloads.md`)."""
        self.digest: str = place["digest"]
        """BLAKE3 of its bytes, as the record names it; this module does not compare them (`turbid cache verify` does)."""
        self.picture: Optional[str] = place["picture"]
        """The PNG that the last run drew, if there is one."""
        self._place = place
        self._dataset: Optional[xarray.Dataset] = None
        self._units: Optional[Dict[str, str]] = None

    @property
    def stack(self) -> Stack:
        """The layers of an image stack as NumPy arrays."""
        if self.kind != "images":
            raise TypeError(f"{self}: a {self.kind} has no layers")
        return read_exr(self._file(), self._place["offset"], self._place["bytes"])

    @property
    def dataset(self) -> xarray.Dataset:
        """All layers of an image stack: NAME, NAME_se, NAME_se_unknown, `mask`, `good`; attributes of the stack in `attrs`."""
        from ._images import dataset

        if self._dataset is None:
            self._dataset = dataset(self.stack)
        return self._dataset

    @property
    def table(self) -> polars.DataFrame:
        """The rows of a table."""
        if self.kind == "images":
            raise TypeError(f"{self}: images are no table; see `dataset`")
        with open_binary(self._file()) as file:
            file.seek(self._place["offset"])
            return _parquet.read(file.read(self._place["bytes"]))

    @property
    def record(self) -> Dict[str, Any]:
        """The fields of a record."""
        if self.kind != "record":
            raise TypeError(f"{self}: a {self.kind} is no record")
        fields: Dict[str, Any] = self._shown()["fields"]
        return fields

    @property
    def units(self) -> Dict[str, str]:
        """The unit of each layer or column."""
        if self._units is None:
            if self.kind == "images":
                self._units = {layer.info["name"]: layer.info["unit"] for layer in self.stack.layers}
            else:
                self._units = {column["name"]: column["unit"] for column in self._shown()["columns"]}
        return self._units

    @property
    def attributes(self) -> Dict[str, Any]:
        """Facts about the whole: convention, g, n, conditions of light and view, .."""
        attributes: Dict[str, Any] = self.stack.attributes if self.kind == "images" else self._shown().get("attributes", {})
        return attributes

    def reasons(self) -> Dict[str, int]:
        """How many pixels are good, and how many are masked for which reason."""
        from ._images import counts

        return counts(self.dataset)

    def __getitem__(self, name: str) -> xarray.DataArray:
        from ._images import quantity

        dataset = self.dataset
        if name not in dataset:
            raise KeyError(f"{self} has no layer {name!r}; it has {', '.join(map(str, dataset.data_vars))}")
        return quantity(dataset, name)

    def __iter__(self) -> Iterator[str]:
        """The names of the quantities."""
        return iter(dict.fromkeys(l.info["name"] for l in self.stack.layers if l.info["kind"] == "value"))

    def _file(self) -> str:
        file: Optional[str] = self._place["file"]
        if file is None:
            raise NotRunError(f"{self}: its bytes were given back on purpose, or are not here any more; run it again")
        return file

    def _shown(self) -> Dict[str, Any]:
        """What the program says of the content."""
        told = _program.ask_json([*self._ask, self._selector(), "--json"])
        port: Dict[str, Any] = told["instances"][0]["ports"][self.port]
        return port

    def _selector(self) -> str:
        axes = {name: value for name, value in self.axes.items() if name in self._own_axes}
        inside = ",".join(f"{name}={_value(value)}" for name, value in axes.items())
        return f"{self.stage}[{inside}].{self.port}" if inside else f"{self.stage}.{self.port}"

    @property
    def _own_axes(self) -> Tuple[str, ...]:
        # What a draw gives is not selected by: its index is.
        return ("draw",) if "draw" in self.axes else tuple(self.axes)

    def __repr__(self) -> str:
        axes = ",".join(f"{name}={_value(value)}" for name, value in self.axes.items())
        return f"{self.stage}[{axes}].{self.port}" if axes else f"{self.stage}.{self.port}"

    def _repr_html_(self) -> str:
        from html import escape

        from ._html import picture, table

        head = f"<p><b>{escape(repr(self))}</b> ({escape(self.payload)})</p>"
        if self.kind != "images":
            return head + (self.table._repr_html_() if self.kind == "table" else table(["field", "value"], self.record.items()))
        rows = [[info["name"], info["kind"], info["unit"]] for info in (layer.info for layer in self.stack.layers)]
        return head + (picture(self.picture) or table(["layer", "kind", "unit"], rows))


def open_binary(path: str) -> Any:
    """The built-in `open`, whose name this module gives to something else."""
    import io

    return io.open(path, "rb")


def _value(value: Any) -> str:
    import json

    if isinstance(value, str):
        return value
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return json.dumps(value, separators=(",", ":"))


def open_all(
    file: File, selector: str, *, set: Optional[Mapping[str, Any]] = None, outputs: Optional[PathLike] = None
) -> List[Result]:
    """The outputs of all instances that a selector names, in the order of the plan. `open` says what a selector is."""
    ask = common("show", file, set, outputs)
    told = _program.ask_json([*ask, selector, "--json", "--places"])
    found = []
    for instance in told["instances"]:
        ports = instance["ports"]
        # One port was named, or the first that the stage declares is meant.
        port = next(iter(ports)) if len(ports) == 1 else instance["first"]
        if port not in ports:
            raise NotRunError(f"{selector} has no output `{port}` stored; it has {', '.join(ports)}: write {instance['stage']}.PORT")
        found.append(Result(ask, instance, port))
    return found


def open(
    file: File, selector: str, *, set: Optional[Mapping[str, Any]] = None, outputs: Optional[PathLike] = None
) -> Result:
    """A stored output of one instance: `open("mine.yaml", "maps[mu_a=0.1]")`.

    `selector` is STAGE, STAGE.PORT or STAGE[axis=value,axis=value].PORT; without a port the first of the stage. `set` and `outputs`
    are those of the run that made it.

    Errors: `InputError` for an unknown stage, port or axis, and where several instances fit (`open_all` gives all, `scan` all rows);
    `NotRunError` where no run has made it with these parameters, or one is at work on it.
    """
    found = open_all(file, selector, set=set, outputs=outputs)
    if len(found) > 1:
        some = ", ".join(repr(one) for one in found[:3])
        text = f"`{selector}` names {len(found)} instances ({some}, ..); pick one with [axis=value], or take turbid.open_all"
        raise InputError(text)
    if not found:
        raise ProgramError(f"`{selector}`: the program named no instance")
    return found[0]
