"""Columns of a text file with one line per sample."""

from __future__ import annotations

import io
from array import array
from typing import Any

import numpy as np

COMMENTS = ("#", "%", "//")
# The first that a line holds; else blanks.
SEPARATORS = (";", "\t", ",")
# Characters: a line is one sample of every column.
LONGEST_LINE = 1_000_000


class TextTable:
    """Columns separated by commas, semicolons, tabs or blanks, with or without a header.

    Parameters
    ----------
    content : bytes
        UTF-8; lines that begin with #, % or // are comments.

    Attributes
    ----------
    names : list of str
        Of the header; empty without one.
    width : int
        Columns.
    rows : int
        Samples in each.
    rate : None
        A text file's comments are not read.

    Raises
    ------
    ValueError
        It is no text, or its last line holds no numbers.
    """

    rate = None

    def __init__(self, content: Any) -> None:
        if b"\0" in content:
            raise ValueError(
                "it holds NUL bytes, as text in UTF-16 or no text does: save it as UTF-8"
            )
        self._content = content
        last = None
        for _, line in self._lines():
            last = line
        # The last line is one of samples, whatever stands in front of the first.
        self._separator, numeric = _layout(last) if last else (None, [])
        if not any(numeric):
            raise ValueError("its last line holds no numbers (with decimal points, not commas)")
        self.width = len(numeric)
        self.rows, self._first, header = 0, 0, []
        for number, line in self._lines():
            if self.rows == 0 and not _fits(line, self._separator, numeric):
                header = line.split(self._separator)
                continue
            self._first = self._first if self.rows else number
            self.rows += 1
            width = line.count(self._separator) + 1 if self._separator else len(line.split())
            if width != self.width:
                raise ValueError(
                    f"line {number + 1} has {width} columns, and the last one {self.width}"
                )
        names = [name.strip().strip('"') for name in header]
        self.names = names if len(names) == self.width else []

    def take(self, places: list[int]) -> list[np.ndarray]:
        """The columns at `places`, each float64 of shape (rows,); NaN where there is no number."""
        columns = [array("d") for _ in places]
        appends = [(column.append, place) for column, place in zip(columns, places, strict=True)]
        for number, line in self._lines():
            if number < self._first:
                continue
            fields = line.split(self._separator)
            for append, place in appends:
                append(_float(fields[place]))
        return [np.frombuffer(column) for column in columns]

    def _lines(self):
        """(number from 0, text) of each line that is neither blank nor a comment."""
        stream = io.TextIOWrapper(io.BytesIO(self._content), encoding="utf-8-sig")
        number = 0
        while line := stream.readline(LONGEST_LINE + 1):
            if len(line) > LONGEST_LINE:
                raise ValueError(
                    f"line {number + 1} is longer than {LONGEST_LINE} characters: write one line "
                    "per sample"
                )
            if line.strip() and not line.lstrip().startswith(COMMENTS):
                yield number, line
            number += 1


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
        # Python's own 1_000 is no number elsewhere.
        return np.nan if "_" in text else float(text)
    except ValueError:
        return np.nan
