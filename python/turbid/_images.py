"""Image stacks as xarray: quantities with their errors, masks as reasons, coordinates in mm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, Hashable, List, Mapping, Optional, Sequence, Tuple

from ._exr import Layer, Stack

if TYPE_CHECKING:
    import numpy
    import xarray

    Array = numpy.ndarray[Any, Any]

#: What the numbers of a layer `mask` mean; `docs/concepts.md` says who sets which.
REASONS: Tuple[str, ...] = (
    "good",
    "background",
    "signal too weak",
    "reference too weak",
    "darker than the table",
    "brighter than the table",
    "modulation outside the table",
    "ambiguous",
    "saturated",
    "not a number",
    "no height from this geometry",
    "outside the reference",
    "finer than the projector's pixels",
    "outside the sections",
    "no fit",
    "surface too steep",
    "conditions unlike the table's",
)

#: Numbers that tell layers of one name apart: in the file, and as coordinates with their units.
_NUMBERS = {
    "f_x_per_mm": ("f_x", "mm^-1"),
    "phase_rad": ("phase", "rad"),
    "orientation_deg": ("orientation", "deg"),
    "wavelength_nm": ("wavelength", "nm"),
}
_PIXELS = ("y", "x")


def dataset(stack: Stack) -> xarray.Dataset:
    """All layers: NAME, NAME_se (standard errors), NAME_se_unknown (bool), `mask` (uint8, a number of `REASONS`), `good` (bool).

    Layers of one name have as dimension the number by which each is told (`f_x`, `phase`, `orientation`, `wavelength`), or `NAME_layer`
    where no single one does; other numbers in which they differ are coordinates such as `NAME_phase`. `x` and `y` are the places of pixels.
    """
    import xarray

    named: Dict[str, List[Layer]] = {}
    for layer in stack.layers:
        named.setdefault(layer.info["name"], []).append(layer)
    rows, columns = stack.layers[0].pixels.shape
    places = _places(rows, columns, stack.attributes)
    variables: Dict[Hashable, Any] = {}
    coordinates: Dict[Hashable, Any] = dict(places)
    for name, layers in named.items():
        dims, own, pixels = _joined(name, layers, coordinates)
        coordinates.update(own)
        variables[name] = (dims, _typed(name, layers[0].info, pixels), _facts(name, layers))
    if "mask" in variables:
        dims, mask, _ = variables["mask"]
        variables["good"] = (dims, mask == 0, {"long_name": "pixels that have a value"})
    return xarray.Dataset(variables, coords=coordinates, attrs=dict(stack.attributes))


def _places(rows: int, columns: int, attributes: Mapping[str, Any]) -> Dict[Hashable, Any]:
    """Coordinates of pixels, from the middle of the image: x to the right, y upwards, where their pitch is known."""
    import numpy

    for name, unit in (("pixel_pitch_mm", "mm"), ("pixel_pitch_rad", "rad")):
        pitch = attributes.get(name)
        if pitch is not None:
            x = (numpy.arange(columns) - (columns - 1) / 2) * pitch[0]
            y = ((rows - 1) / 2 - numpy.arange(rows)) * pitch[1]
            return {"y": ("y", y, {"units": unit}), "x": ("x", x, {"units": unit})}
    return {"y": ("y", numpy.arange(rows), {"units": "pixel"}), "x": ("x", numpy.arange(columns), {"units": "pixel"})}


def _joined(
    name: str, layers: Sequence[Layer], taken: Mapping[Hashable, Any]
) -> Tuple[Tuple[str, ...], Dict[Hashable, Any], Array]:
    """Dimensions, coordinates and pixels of the layers of one name."""
    if len(layers) == 1:
        return _PIXELS, {}, layers[0].pixels
    values = {key: [layer.info.get(key) for layer in layers] for key in _NUMBERS}
    pixels = _stacked([layer.pixels for layer in layers])
    differ = [key for key, of in values.items() if len(set(of)) > 1]
    dim = f"{name}_layer"
    own: Dict[Hashable, Any] = {}
    for key in differ:
        short, unit = _NUMBERS[key]
        known = taken.get(short)
        if None not in values[key] and len(set(values[key])) == len(layers) and (known is None or list(known[1]) == values[key]):
            dim, own = short, {short: (short, values[key], {"units": unit})}
            break
    for key in differ:
        if dim == _NUMBERS[key][0]:
            continue
        numbers = [float("nan") if value is None else value for value in values[key]]
        own[f"{name}_{_NUMBERS[key][0]}"] = (dim, numbers, {"units": _NUMBERS[key][1]})
    pairs = [",".join(map(str, layer.info.get("pair") or ())) for layer in layers]
    if all(pairs):
        own[f"{name}_pair"] = (dim, pairs)
    return (dim, *_PIXELS), own, pixels


def _stacked(images: Sequence[Array]) -> Array:
    """Images behind each other: a view where they lie evenly in one file, else a copy."""
    import numpy

    addresses = [image.__array_interface__["data"][0] for image in images]
    steps = {later - earlier for earlier, later in zip(addresses, addresses[1:])}
    first = images[0]
    if len(steps) == 1 and first.base is not None and all(image.strides == first.strides and image.base is first.base for image in images):
        step = steps.pop()
        view = numpy.lib.stride_tricks.as_strided(first, (len(images), *first.shape), (step, *first.strides), writeable=False)
        return view
    return numpy.stack(images)


def _typed(name: str, info: Mapping[str, Any], pixels: Array) -> Array:
    import numpy

    if info["kind"] != "mask":
        return pixels
    flags: Array = pixels.astype(numpy.uint8)
    return flags if not name.endswith("_se_unknown") else flags != 0


def _facts(name: str, layers: Sequence[Layer]) -> Dict[str, Any]:
    info = layers[0].info
    facts: Dict[str, Any] = {"units": info["unit"], "kind": info["kind"]}
    if info["kind"] == "mask" and not name.endswith("_se_unknown"):
        facts["flag_meanings"] = list(REASONS)
    for key, (short, _) in _NUMBERS.items():
        if info.get(key) is not None and len({layer.info.get(key) for layer in layers}) == 1:
            facts[short] = info[key]
    errors = [layer.info.get("mean_se") for layer in layers]
    if any(error is not None for error in errors):
        facts["mean_se"] = errors[0] if len(errors) == 1 else errors
    return facts


def quantity(of: xarray.Dataset, name: str) -> xarray.DataArray:
    """One quantity, with its standard errors, mask and good pixels as coordinates beside it."""
    array: xarray.DataArray = of[name]
    beside = {"standard_error": f"{name}_se", "error_unknown": f"{name}_se_unknown", "mask": "mask", "good": "good"}
    found = {short: of[long] for short, long in beside.items() if long in of and long != name}
    fitting = {short: one for short, one in found.items() if set(one.dims) <= set(array.dims)}
    array = array.assign_coords({short: (one.dims, one.data, one.attrs) for short, one in fitting.items()})
    array.attrs = {**array.attrs, "long_name": name}
    return array


def counts(of: xarray.Dataset) -> Dict[str, int]:
    """How many pixels each reason of the mask has."""
    import numpy

    mask: Optional[xarray.DataArray] = of["mask"] if "mask" in of else None
    if mask is None:
        return {}
    numbers, pixels = numpy.unique(mask.values, return_counts=True)
    return {REASONS[number] if number < len(REASONS) else str(number): int(n) for number, n in zip(numbers, pixels)}
