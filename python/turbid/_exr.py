"""Image stacks as the store has them: EXR files of 32-bit floats, a part for each layer.

Value layers are views of the file; masks and drawings, which are compressed, are decoded. `docs/store.md` describes the files.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
from typing import TYPE_CHECKING, Any, Dict, List, NamedTuple, Optional, Tuple

from ._program import PathLike

if TYPE_CHECKING:
    import numpy

    Array = numpy.ndarray[Any, Any]

_MAGIC = 20000630
_MULTI_PART = 0x1000
#: Tiles, deep data.
_UNKNOWN = 0x200 | 0x800
#: Of the kinds of compression that turbid writes: rows in a block.
_ROWS = {0: 1, 1: 1, 2: 1, 3: 16}
_WANTED = {b"channels", b"compression", b"dataWindow", b"chunkCount", b"turbid"}


class Layer(NamedTuple):
    """One image. `info` has name, kind, unit and, where they apply, f_x_per_mm, phase_rad, orientation_deg, wavelength_nm, pair, mean_se."""

    info: Dict[str, Any]
    pixels: Array
    """float32, (rows, columns), row 0 at the top; read-only."""


class Stack(NamedTuple):
    """Images of one size."""

    layers: List[Layer]
    attributes: Dict[str, Any]


def read_exr(path: PathLike, offset: int = 0, length: Optional[int] = None) -> Stack:
    """Reads an image stack of turbid, a file or bytes inside of one. Value layers stay on the disk until they are looked at.

    Errors: OSError; ValueError where it is no stack of turbid.
    """
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        end = size if length is None else offset + length
        if end > size or end <= offset:
            raise ValueError(f"{os.fspath(path)}: it has {size} bytes, and no image stack at {offset}")
        start = offset - offset % mmap.ALLOCATIONGRANULARITY
        mapped = mmap.mmap(file.fileno(), end - start, access=mmap.ACCESS_READ, offset=start)
    try:
        return _stack(mapped, offset - start)
    except (struct.error, IndexError, KeyError, ValueError) as error:
        raise ValueError(f"{os.fspath(path)}: not an image stack of turbid: {error}") from error


def _stack(data: mmap.mmap, begin: int) -> Stack:
    magic, version = struct.unpack_from("<ii", data, begin)
    if magic != _MAGIC or version & _UNKNOWN:
        raise ValueError("it is no EXR file of scan lines")
    multi_part = bool(version & _MULTI_PART)
    headers, at = _headers(data, begin + 8, multi_part)
    described = json.loads(headers[0][b"turbid"])
    if len(described["layers"]) != len(headers):
        raise ValueError("its parts are not those that it describes")
    known: Dict[bytes, Array] = {}
    layers = []
    for header, info in zip(headers, described["layers"]):
        pixels, at = _part(data, begin, at, header, multi_part, known)
        layers.append(Layer(info, pixels))
    return Stack(layers, described["attributes"])


def _headers(data: mmap.mmap, at: int, multi_part: bool) -> Tuple[List[Dict[bytes, bytes]], int]:
    """The attributes that are wanted of each part, and where the headers end."""
    headers: List[Dict[bytes, bytes]] = []
    while True:
        header: Dict[bytes, bytes] = {}
        while data[at] != 0:
            name_end = data.find(b"\0", at)
            kind_end = data.find(b"\0", name_end + 1)
            name = data[at:name_end]
            (size,) = struct.unpack_from("<i", data, kind_end + 1)
            at = kind_end + 5 + size
            if size < 0 or at > len(data):
                raise ValueError("an attribute of no length")
            if name in _WANTED:
                header[name] = data[kind_end + 5 : at]
        at += 1
        headers.append(header)
        if not multi_part or data[at] == 0:
            return headers, at + multi_part


def _part(
    data: mmap.mmap, begin: int, at: int, header: Dict[bytes, bytes], multi_part: bool, known: Dict[bytes, Array]
) -> Tuple[Array, int]:
    """The pixels of a part, whose table of offsets is at `at`, and where that ends."""
    import numpy

    left, top, right, bottom = struct.unpack("<4i", header[b"dataWindow"])
    rows, columns = bottom - top + 1, right - left + 1
    compression = header[b"compression"][0]
    # One channel of 32-bit floats: its name, its type, flags, sampling.
    if header[b"channels"][:6] != b"Y\0\x02\0\0\0" or compression not in _ROWS or rows < 1 or columns < 1:
        raise ValueError("a part is not of one channel of 32-bit floats")
    block = _ROWS[compression]
    count = -(-rows // block)
    table = numpy.frombuffer(data, "<u8", count, at)
    head = 12 if multi_part else 8
    after = at + 8 * count
    if int(table.max()) + begin + head > len(data):
        raise ValueError("it ends early")
    if compression == 0:
        stride = head + 4 * columns
        first = int(table[0])
        if first + rows * stride + begin > len(data):
            raise ValueError("it ends early")
        if numpy.array_equal(table, first + stride * numpy.arange(rows, dtype=numpy.uint64)):
            return numpy.ndarray((rows, columns), "<f4", data, begin + first + head, (stride, 4)), after
    pixels = numpy.empty((rows, columns), numpy.float32)
    for number in range(count):
        start = begin + int(table[number])
        y, size = struct.unpack_from("<ii", data, start + head - 8)
        packed = data[start + head : start + head + size]
        lines = min(block, rows - number * block)
        image = known.get(packed) if compression else None
        if image is None or image.shape != (lines, columns):
            image = numpy.frombuffer(_unpacked(packed, compression, 4 * lines * columns), "<f4").reshape(lines, columns)
            known[packed] = image
        pixels[y - top : y - top + lines] = image
    pixels.flags.writeable = False
    return pixels, after


def _unpacked(packed: bytes, compression: int, size: int) -> bytes:
    """The bytes of a block."""
    import zlib

    import numpy

    # What does not shrink is stored as it is.
    if compression == 0 or len(packed) == size:
        return packed
    raw = _runs(packed) if compression == 1 else zlib.decompress(packed)
    if len(raw) != size:
        raise ValueError("a block has another length than its header says")
    # Bytes were taken apart, first all of even places, and each is told by its distance from the one before.
    steps = numpy.frombuffer(raw, numpy.uint8).astype(numpy.int64)
    steps[1:] -= 128
    ordered = (numpy.cumsum(steps) & 255).astype(numpy.uint8)
    out = numpy.empty(size, numpy.uint8)
    half = (size + 1) // 2
    out[0::2], out[1::2] = ordered[:half], ordered[half:]
    return out.tobytes()


def _runs(packed: bytes) -> bytes:
    """Runs of bytes: a count below 0 and so many bytes, or a count and the byte that follows once more than that."""
    pieces, at = [], 0
    while at < len(packed):
        count = packed[at]
        if count > 127:
            pieces.append(packed[at + 1 : at + 257 - count])
            at += 257 - count
        else:
            pieces.append(packed[at + 1 : at + 2] * (count + 1))
            at += 2
    return b"".join(pieces)
