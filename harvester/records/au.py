"""Columns of a Sun or NeXT audio file (.au, .snd)."""

from __future__ import annotations

import struct

import numpy as np

from harvester.records.table import Format, Table, table_of

# Type and full scale of a sample by the header's encoding.
ENCODINGS = {2: (">i1", 2.0**7), 3: (">i2", 2.0**15), 5: (">i4", 2.0**31), 6: (">f4", 1.0)}


def read(content: bytes) -> Table:
    """Channels as columns; full scale of whole numbers is 1.

    Raises ValueError if the header is cut short, or its encoding is another.
    """
    if len(content) < 24:
        raise ValueError("its header is cut short: record it again")
    start, _, encoding, rate, channels = struct.unpack_from(">5I", content, 4)
    if encoding not in ENCODINGS or not channels:
        raise ValueError(f"its samples have the encoding {encoding}: convert it to PCM or float")
    dtype, full_scale = ENCODINGS[encoding]
    size = channels * np.dtype(dtype).itemsize
    samples = np.frombuffer(content, dtype, (len(content) - start) // size * channels, start)
    columns = [*samples.reshape(-1, channels).T / full_scale]
    table = table_of(columns, [""] * channels)
    table.rate = float(rate)
    return table


FORMAT = Format(read, (b".snd",))
