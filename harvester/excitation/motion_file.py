"""Columns of recorded motion from CSV, .npy and .wav files."""

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harvester.errors import SceneError
from harvester.scene_schema import nearest

COMMENTS = ("#", "%", "//")
SEPARATORS = (";", "\t", ",", None)


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
    first = next((k for k, (_, line) in enumerate(rows) if _numbers(line)), None)
    if first is None:
        raise ValueError("it holds no line of numbers")
    separator = _numbers(rows[first][1])[1]
    width = len(rows[first][1].split(separator))
    table = np.empty((len(rows) - first, width))
    for place, (number, line) in enumerate(rows[first:]):
        fields = line.split(separator)
        if len(fields) != width:
            raise ValueError(
                f"line {number + 1} has {len(fields)} columns, and the first one {width}"
            )
        table[place] = [_float(text) for text in fields]
    header = rows[first - 1][1].split(separator) if first else []
    names = [name.strip().strip('"') for name in header]
    return table, names if len(names) == width else []


def _comment(line):
    return line.lstrip().startswith(COMMENTS)


def _numbers(line):
    """(True, separator) where a line holds a number in every field that is not empty."""
    for separator in SEPARATORS:
        if separator is not None and separator not in line:
            continue
        fields = [text for text in line.split(separator) if text.strip()]
        if fields and all(_is_number(text) for text in fields):
            return True, separator
    return None


def _is_number(text):
    return text.strip().lower() in ("nan", "na", "null") or not np.isnan(_float(text))


def _float(text):
    try:
        return float(text)
    except ValueError:
        return np.nan
