"""Columns of a .wav file: PCM of 1 to 8 bytes per sample, and floats."""

from __future__ import annotations

import struct

import numpy as np

from harvester.records.table import Format, Table

PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
# Size written by programs that do not know it yet.
UNKNOWN_SIZE = 0xFFFFFFFF
MOST_CHUNKS = 1000


def read(content: bytes) -> Table:
    """Channels as columns; integers are scaled to a full scale of 1, unsigned bytes are centred.

    Raises ValueError if a chunk is missing, is truncated or contradicts another.
    """
    order, form, start, size = _parts(content)
    channels, rate, stride, dtype = _layout(order, form)
    if size > len(content) - start:
        raise ValueError(
            f"it claims {size} bytes of samples but contains {len(content) - start}: it is "
            "truncated; record it again or repair its header"
        )
    rows = size // stride
    samples = np.frombuffer(content, np.uint8, rows * stride, start if rows else 0)
    samples = samples.reshape(rows, channels, stride // channels)
    # Integers of 3, 5, 6 or 7 bytes become the upper bytes of a longer integer.
    upper = slice(-samples.shape[2], None) if order == "<" else slice(samples.shape[2])

    def column(channel):
        padded = np.zeros((rows, dtype.itemsize), np.uint8)
        padded[:, upper] = samples[:, channel]
        values = padded.view(dtype)[:, 0]
        if dtype.kind == "u":
            return (values.astype(float) - 128.0) / 128.0
        with np.errstate(invalid="ignore"):
            full_scale = -float(np.iinfo(dtype).min) if dtype.kind == "i" else 1.0
            return values.astype(float) / full_scale

    def take(indices):
        return [column(channel) for channel in indices]

    return Table([""] * channels, rows, take, rate=float(rate))


def _parts(content):
    """Return (byte order, content of `fmt `, start and claimed size of `data`)."""
    kind = content[:4]
    if kind not in (b"RIFF", b"RIFX", b"RF64") or content[8:12] != b"WAVE":
        raise ValueError("it does not begin as a .wav file does (RIFF … WAVE): export it again")
    order = ">" if kind == b"RIFX" else "<"
    form, long_size, offset = None, None, 12
    for _ in range(MOST_CHUNKS):
        if offset + 8 > len(content):
            raise ValueError("it ends before its samples (no data chunk): export it again")
        name, size = struct.unpack_from(f"{order}4sI", content, offset)
        offset += 8
        if name == b"data":
            if form is None:
                raise ValueError("the samples' format is missing (no fmt chunk): export it again")
            remaining = len(content) - offset if long_size is None else long_size
            return order, form, offset, remaining if size == UNKNOWN_SIZE else size
        if name == b"fmt ":
            form = content[offset : offset + size]
        elif name == b"ds64" and len(content) >= offset + 16:
            (long_size,) = struct.unpack_from("<Q", content, offset + 8)
        offset += size + size % 2
    raise ValueError(f"it has no samples within {MOST_CHUNKS} chunks: export it again")


def _layout(order, form):
    """(channels, Hz, bytes of one sample of all channels, dtype of a sample)."""
    if len(form) < 16:
        raise ValueError("the samples' format is truncated (fmt chunk): export it again")
    tag, channels, rate, _, stride, bits = struct.unpack_from(f"{order}HHIIHH", form)
    if tag == EXTENSIBLE and len(form) >= 28:
        (tag,) = struct.unpack_from(f"{order}I", form, 24)
    if tag not in (PCM, FLOAT):
        raise ValueError(f"its samples have the format {tag:#x}: convert it to PCM or float")
    if channels == 0 or rate == 0:
        raise ValueError(f"its header says {channels} channels at {rate} Hz: export it again")
    size = stride // channels
    fits = 0 < bits <= 8 * size if tag == PCM else bits == 8 * size and size in (4, 8)
    if stride % channels or not 1 <= size <= 8 or not fits:
        raise ValueError(
            f"its header gives {bits} bits in {stride} bytes for {channels} channels: convert it "
            "to PCM of 8, 16, 24 or 32 bits, or float"
        )
    integer = "u1" if size == 1 else f"{order}i{next(n for n in (2, 4, 8) if n >= size)}"
    return channels, rate, stride, np.dtype(integer if tag == PCM else f"{order}f{size}")


FORMAT = Format(read)
