"""Columns of a .npy file: one array of numbers, or a structured array with named fields."""

from __future__ import annotations

import io

import numpy as np

from harvester.records.table import Format, Table, broken_file, table_of


def read(content: bytes) -> Table:
    """Samples by column; the fields of a structured array are named columns.

    `content`: the whole file; pickled objects are not read. Raises ValueError if it contains no
    such array.
    """
    if not content.startswith(b"\x93NUMPY"):
        raise ValueError("it does not begin as a .npy file does: save the array with numpy.save")
    # The header is a Python literal whose evaluation may raise any exception. The claimed size may
    # exceed the memory.
    with broken_file(".npy file of numbers", "save the array with numpy.save", ()):
        array = np.load(io.BytesIO(content), allow_pickle=False)
    names = array.dtype.names
    if array.ndim not in ((1,) if names else (1, 2)):
        raise ValueError(
            f"an array of shape {array.shape} is not a table of samples by columns: save one or "
            "two dimensions"
        )
    columns = [array[name] for name in names or ()] or list(np.atleast_2d(array.T))
    return table_of(columns, names or [""] * len(columns))


FORMAT = Format(read)
