"""Columns of a .mat file: its numeric arrays, including those in structures."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from harvester.records.table import (
    NUMBER_KINDS,
    REAL_KINDS,
    Format,
    Table,
    Unreadable,
    broken_file,
    table_of_longest,
)

# MATLAB's numeric classes. Cells, objects and code at the top level are not read.
NUMBER_CLASSES = {
    "double",
    "single",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}
# Limits on parts and nesting: scipy allocates the claimed size of cells and structures before it
# reads them, and recurses into each part.
MOST_PARTS, DEEPEST = 100_000, 16
LARGEST_STRUCTURE = 2**28
# Codes of the format: element types and matrix classes.
MATRIX, COMPRESSED = 14, 15
CELL, STRUCTURE, OBJECT = 1, 2, 3
HEADER_BYTES, HEAD_BYTES = 128, 64


def read(content: bytes) -> Table:
    """Samples by column, named after the variables; `data.y` for a field of a structure.

    A single number `fs` or `dt` is the sampling rate or its inverse.

    `content`: the whole file, in MATLAB's formats 4 to 7.2; scipy reads only its numbers and
    structures of numbers. Raises Unreadable if it contains no such array.
    """
    listed = _read("whosmat", content)
    arrays = {
        name: shape
        for name, shape, kind in listed
        if kind in NUMBER_CLASSES and len(shape) <= 2 and min(shape) > 0
    }
    structures = [name for name, _, kind in listed if kind == "struct"]
    fields: dict[str, np.ndarray] = {}
    if structures:
        _refuse_claims(content)
        loaded = _read("loadmat", content, variable_names=structures, simplify_cells=True)
        fields = dict(_fields("", {name: loaded[name] for name in structures}))

    def load(names):
        return _load(content, [name for name in names if name in arrays]) | {
            name: fields[name] for name in names if name in fields
        }

    shapes = arrays | {name: value.shape for name, value in fields.items()}
    single = load(
        [n for n, shape in shapes.items() if shape == () or (n in arrays and max(shape) == 1)]
    )
    numbers = {n: float(v.ravel()[0]) for n, v in single.items() if v.dtype.kind in REAL_KINDS}
    return table_of_longest(shapes, load, numbers=lambda longest: numbers)


def _load(content, names):
    """Arrays of the file by name."""
    if not names:
        return {}
    values = _read("loadmat", content, variable_names=names)
    return {name: values[name] for name in names if name in values}


def _read(function: str, content: bytes, **options: Any) -> Any:
    from scipy import io as scipy_io

    with broken_file(".mat file of numbers", "save it in version 7 or older, or as .csv"):
        return getattr(scipy_io, function)(io.BytesIO(content), **options)


def _fields(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (name, numbers) of every numeric field of a structure."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _fields(f"{name}.{key}" if name else key, part)
    elif isinstance(value, list) or getattr(value, "dtype", np.dtype(float)).kind == "O":
        for index, part in enumerate(np.ravel(np.array(value, dtype=object))):
            if isinstance(part, dict):
                yield from _fields(f"{name}[{index}]", part)
    else:
        array = np.asarray(value)
        if array.dtype.kind in NUMBER_KINDS and array.ndim <= 2 and array.size:
            yield name, array


def _refuse_claims(content):
    """Raise Unreadable if a structure's header claims more data than the file contains."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise Unreadable("the header of a .mat file with structures is invalid: save it again")
    try:
        for kind, data in _elements(memoryview(content)[HEADER_BYTES:], order):
            if kind == COMPRESSED:
                # Only the first bytes are decompressed: they show whether it is a structure. The
                # size of an array follows from its header and needs no check here.
                _, head = next(_elements(_unpacked(data, HEAD_BYTES), order))
                if _class_of(head, order) != STRUCTURE:
                    continue
                kind, data = next(_elements(_unpacked(data, LARGEST_STRUCTURE), order))
            if kind == MATRIX and _class_of(data, order) == STRUCTURE:
                _count_parts(data, order, 0)
    except (struct.error, zlib.error, StopIteration, IndexError, RuntimeError):
        raise Unreadable("a structure of the .mat file is truncated: save it again") from None


def _elements(data, order):
    """Yield (kind, content) of consecutive elements."""
    offset = 0
    while offset + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, offset)
        # An element of up to four bytes is stored in its tag.
        if kind >> 16:
            kind, size, start, offset = kind & 0xFFFF, kind >> 16, offset + 4, offset + 8
        else:
            start = offset + 8
            offset = start + size + (0 if kind == COMPRESSED else -size % 8)
        yield kind, data[start : start + size]


def _unpacked(data, most):
    """The content of a compressed element, or its first `most` bytes."""
    reader = zlib.decompressobj()
    unpacked = reader.decompress(data, most)
    if reader.unconsumed_tail and most > HEAD_BYTES:
        raise Unreadable(f"one of its structures is larger than {most / 1e6:.0f} MB: shorten it")
    return memoryview(unpacked)


def _class_of(data, order):
    return struct.unpack_from(f"{order}I", next(_elements(data, order))[1])[0] & 0xFF


def _count_parts(data, order, depth):
    """Total number of parts of a matrix; raise if they are too many or too deeply nested."""
    if depth > DEEPEST:
        raise Unreadable(f"its structures are nested more than {DEEPEST} deep: save only arrays")
    if len(data) == 0 or _class_of(data, order) not in (CELL, STRUCTURE, OBJECT):
        return 1
    parts = _elements(data, order)
    sort = struct.unpack_from(f"{order}I", next(parts)[1])[0] & 0xFF
    shape = next(parts)[1]
    claimed = np.prod(np.frombuffer(shape, f"{order}i4"), dtype=float)
    next(parts)
    if sort == OBJECT:
        next(parts)
    if sort != CELL:
        length = max(1, struct.unpack_from(f"{order}i", next(parts)[1])[0])
        claimed *= max(1, len(next(parts)[1]) // length)
    if claimed > MOST_PARTS or 8.0 * claimed > len(data) + 8:
        raise Unreadable(
            "one of its structures claims more parts than it contains, or too many: save the file "
            "again"
        )
    total = 1
    for kind, part in parts:
        total += _count_parts(part, order, depth + 1) if kind == MATRIX else 1
        if total > MOST_PARTS:
            raise Unreadable(f"its structures have more than {MOST_PARTS} parts: save only arrays")
    return total


FORMAT = Format(read)
