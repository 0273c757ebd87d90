"""Columns of recorded motion from CSV, .npy and .wav files."""

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harvester.errors import SceneError
from harvester.scene_schema import nearest

COMMENTS = ("#", "%", "//")
# The first that a line holds; else blanks.
SEPARATORS = (";", "\t", ",")


class Columns(NamedTuple):
    """What a file holds, before units.

    Attributes
    ----------
    values : ndarray, shape (n,)
        NaN where the file holds no number.
    times : ndarray, shape (n,), or None
        s, as in the time column.
    sampling_rate : float or None
        Hz, where the file itself tells it.
    """

    values: np.ndarray
    times: np.ndarray | None
    sampling_rate: float | None


def content_digest(file):
    """SHA-256 of a file's bytes.

    Raises
    ------
    SceneError
        It cannot be read.
    """
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError as error:
        raise SceneError(f"{file}: the record cannot be read: {error.strerror}") from None


def read_columns(file, column=None, time_column=None):
    """The column of motion, and that of time where one is named.

    Parameters
    ----------
    file : str
        `.npy`, `.wav`, or text with one line per sample: separated by commas, semicolons, tabs
        or blanks, with or without a header, comments after #, % or //.
    column, time_column : str, int or None
        Name in the header, or number from 0. Without `column` a file of one column besides
        time is read.

    Returns
    -------
    Columns

    Raises
    ------
    SceneError
    """
    suffix = Path(file).suffix.lower()
    rate = None
    try:
        if suffix == ".npy":
            table, names = _from_npy(file)
        elif suffix == ".wav":
            table, names, rate = _from_wav(file)
        else:
            table, names = _from_text(file)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise SceneError(f"{file}: not a readable record: {reason}") from None
    places = list(range(table.shape[1]))
    time = None if time_column is None else _place(file, "time_column", time_column, names, places)
    if column is None:
        others = [place for place in places if place != time]
        if len(others) != 1:
            listed = ", ".join(names) or f"0 … {len(places) - 1}"
            raise SceneError(f"{file}: excitation.column is missing; the file has {listed}")
        place = others[0]
    else:
        place = _place(file, "column", column, names, places)
    return Columns(table[:, place], None if time is None else table[:, time], rate)


def _place(file, key, wanted, names, places):
    """Number of a column given by name or number."""
    if isinstance(wanted, str):
        if wanted in names:
            return names.index(wanted)
        listed = ", ".join(names) or "no header, only numbers"
        raise SceneError(
            f"{file}: excitation.{key} = {wanted!r}: no such column{nearest(wanted, names)}; "
            f"the file has {listed}"
        )
    if wanted not in places:
        raise SceneError(
            f"{file}: excitation.{key} = {wanted}: the file has columns 0 … {len(places) - 1}"
        )
    return wanted


def _from_npy(file):
    table = np.load(file, allow_pickle=False)
    names = list(table.dtype.names or ())
    if names:
        table = np.stack([table[name].astype(float) for name in names], axis=1)
    if table.ndim == 1:
        table = table[:, None]
    if table.ndim != 2:
        raise ValueError(f"an array of shape {table.shape} is no table of samples by columns")
    return table.astype(float), names


def _from_wav(file):
    """Full scale of whole numbers is 1; unsigned bytes are centred."""
    import warnings

    from scipy.io import wavfile

    with warnings.catch_warnings():
        # Chunks that scipy does not know carry no samples.
        warnings.simplefilter("ignore", wavfile.WavFileWarning)
        rate, samples = wavfile.read(file)
    table = samples.astype(float)
    if samples.dtype == np.uint8:
        table = (table - 128.0) / 128.0
    elif samples.dtype.kind == "i":
        table /= -float(np.iinfo(samples.dtype).min)
    return table.reshape(len(table), -1), [], float(rate)


def _from_text(file):
    lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
    rows = [(k, line) for k, line in enumerate(lines) if line.strip() and not _comment(line)]
    # The last line is one of samples, whatever stands in front of the first.
    separator, numeric = _layout(rows[-1][1]) if rows else (None, [])
    if not any(numeric):
        raise ValueError("its last line holds no numbers (with decimal points, not commas)")
    width = len(numeric)
    first = next(k for k, (_, line) in enumerate(rows) if _fits(line, separator, numeric))
    table = np.empty((len(rows) - first, width))
    for place, (number, line) in enumerate(rows[first:]):
        fields = line.split(separator)
        if len(fields) != width:
            raise ValueError(
                f"line {number + 1} has {len(fields)} columns, and the last one {width}"
            )
        table[place] = [_float(text) for text in fields]
    header = rows[first - 1][1].split(separator) if first else []
    names = [name.strip().strip('"') for name in header]
    return table, names if len(names) == width else []


def _comment(line):
    return line.lstrip().startswith(COMMENTS)


def _layout(line):
    """(separator, which fields are numbers) of a line of samples; dates and names may be there."""
    separator = next((mark for mark in SEPARATORS if mark in line), None)
    return separator, [_is_number(text) for text in line.split(separator)]


def _fits(line, separator, numeric):
    """Whether a line has numbers, or nothing, where the last one has numbers."""
    fields = line.split(separator)
    return len(fields) == len(numeric) and all(
        _is_number(text) or not text.strip()
        for text, wanted in zip(fields, numeric, strict=True)
        if wanted
    )


def _is_number(text):
    return text.strip().lower() in ("nan", "na", "null") or not np.isnan(_float(text))


def _float(text):
    try:
        return float(text)
    except ValueError:
        return np.nan
