"""Columns of a text file with one line per sample."""

from __future__ import annotations

import csv
import io
import itertools
import re
from array import array
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from math import isnan, nan
from typing import Any, NamedTuple

import numpy as np

from harvester.records.decimal_marks import marks_of, plain, shape, ungrouped
from harvester.records.quantities import heading, is_unit
from harvester.records.table import LARGEST_TEXT, Format, Table
from harvester.records.time_stamps import CLOCK_TIME, StampReader

COMMENTS = ("#", "%", "//")
SEPARATORS = (";", "\t", ",")
# Forms of a line: separator and decimal mark, None for blanks. The first of equally good ones is
# taken. Decimal commas between commas are in quotes.
FORMS = (
    *((separator, ".") for separator in (*SEPARATORS, None)),
    *((separator, ",") for separator in (";", "\t", None, ",")),
)
# Longest line in characters. A line holds one sample of every column.
LONGEST_LINE = 1_000_000
# The form is that of most of the last lines. A footer makes up less than half of them.
LINES_SEEN, BYTES_SEEN = 41, 200_000
HEADER_LINES = 50
NO_NUMBER = ("nan", "na", "n/a", "#n/a", "null", "none", "-", "--")
NUMBER, STAMP, COMPLEX, TEXT = "number", "stamp", "complex", "text"
# Matches complex numbers such as 1.5e-3-2i and (0.1+2j).
COMPLEX_NUMBER = re.compile(
    r"\(?\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*([+-])\s*([\d.]+(?:[eE][+-]?\d+)?)\s*\*?[ij]\s*\)?"
)
# A quoted field, a unit in brackets, or a word with a unit in brackets behind it.
BLANK_SEPARATED = re.compile(r"\"[^\"]*\"|[\[(][^\])]*[\])]|\S+(?:\s+[\[(][^\])]*[\])])?")
# In a row of units, loggers write this for a column without a unit.
NO_UNIT = ("", "-", "ts", "rn")
# Decimals and exponent of a number. A line that was cut short has fewer of them.
DIGITS = re.compile(r"[+-]?\d*[.,]?(\d*)([eE][+-]?\d*)?")


class Form(NamedTuple):
    """How a line of samples is written.

    Attributes
    ----------
    separator
        Separator of the fields; None: blanks.
    decimal : "." or ",".
    kinds
        Kind of each column: `NUMBER`, `STAMP`, `COMPLEX` or `TEXT`.
    """

    separator: str | None
    decimal: str
    kinds: tuple[str, ...]

    def fits(self, fields: list[str]) -> bool:
        """Whether each field of a line is empty or of its column's kind (number, time stamp).

        A complex number may be written without its imaginary part.
        """
        if len(fields) != len(self.kinds):
            return False
        pairs = [pair for pair in zip(fields, self.kinds, strict=True) if pair[1] != TEXT]
        return any(field.strip() for field, _ in pairs) and all(
            not field.strip() or _kind(field, self.decimal) in (kind, kind == COMPLEX and NUMBER)
            for field, kind in pairs
        )


def read(content: bytes) -> Table:
    """Columns separated by commas, semicolons, tabs or blanks, with or without a header.

    Numbers may be quoted, and have decimal commas where another sign separates them. The last line
    may be cut short, and a footer may follow the samples. The names are those of the header, or of
    the comment above the first line, and may have a row of units below them.

    `content`: UTF-8; lines that begin with #, % or // are comments. Raises ValueError if it is no
    text, or its last lines hold no numbers.
    """
    if b"\0" in content:
        raise ValueError("it holds NUL bytes, as text in UTF-16 or no text does: save it as UTF-8")
    return _Lines(content).table


class _Lines:
    """The lines of a text file: its form, its header, and the samples by columns."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        last_lines = self._last_lines()
        self._form = _form_of(last_lines)
        # Whether a field may hold a comma: each column's values then show what it means.
        self._commas = b"," in content and (self._form.separator != "," or b'"' in content)
        if self._commas:
            self._form = self._form._replace(decimal=",")
        kinds = self._form.kinds
        self._rows, self._first = 0, 0
        above, left_out = self._scan()
        if self._rows > 1 and not left_out and self._is_cut_short(last_lines):
            self._rows, left_out = self._rows - 1, 1
        names, units = _names_and_units(above, self._form)
        self._complexes = [index for index, kind in enumerate(kinds) if kind == COMPLEX]
        self.table = Table(
            names,
            self._rows,
            self._take,
            ["s" if kind == STAMP else unit for kind, unit in zip(kinds, units, strict=True)],
            texts=[index for index, kind in enumerate(kinds) if kind == TEXT],
            complexes=self._complexes,
            line_of=self._line_of,
        )
        if left_out:
            lines = "line holds" if left_out == 1 else f"{left_out} lines hold"
            verb = "is" if left_out == 1 else "are"
            self.table.remarks = (f"the file's last {lines} no whole sample and {verb} left out",)

    def _take(self, places: Sequence[int]) -> list[np.ndarray]:
        """The columns at `places`; time stamps are seconds after the first."""
        marks = self._marks(places)
        columns: list[Any] = [[] if index in self._complexes else array("d") for index in places]
        readers = [
            (column.append, index, self._reader(index, marks))
            for column, index in zip(columns, places, strict=True)
        ]
        for fields in self._fields_of_rows():
            for append, index, read in readers:
                append(read(fields[index]))
        return [
            np.array(column, complex) if isinstance(column, list) else np.frombuffer(column)
            for column in columns
        ]

    def _line_of(self, row: int) -> int:
        """Number of the line, from 1, that holds a row."""
        return next(itertools.islice(self._row_lines(), row, None))[0] + 1

    def _row_lines(self):
        return ((n, line) for n, line, mark in self._lines() if n >= self._first and not mark)

    def _fields_of_rows(self) -> Iterator[list[str]]:
        """The fields of each row."""
        lines = itertools.islice(self._row_lines(), self._rows)
        return (_fields(line, self._form.separator) for _, line in lines)

    def _marks(self, places):
        """(decimal mark, thousands separator) of each column that has commas or looks grouped."""
        numbers = [k for k, kind in enumerate(self._form.kinds) if kind == NUMBER]
        asked = {*places} & {*numbers} if b"." in self._content else ()
        if not self._commas:
            columns = ((fields[k] for fields in self._fields_of_rows()) for k in asked)
            shapes = (itertools.takewhile(".d".__ne__, map(shape, column)) for column in columns)
            # Points may stand between thousands: 1.286 beside 742.
            if not any({".?", "mid"} <= {*seen} for seen in shapes):
                return {}
        rows = ([fields[k] for k in numbers] for fields in self._fields_of_rows())
        return dict(zip(numbers, marks_of(rows, len(numbers)), strict=True))

    def _reader(self, index, marks):
        if self._form.kinds[index] == STAMP:
            return StampReader().seconds
        if self._form.kinds[index] == COMPLEX:
            return lambda text: _complex(text, self._form.decimal)
        decimal, group = marks.get(index, (self._form.decimal, ""))
        return lambda text: _float(plain(text, decimal, group) if group else text, decimal)

    def _lines(self) -> Iterator[tuple[int, str, bool]]:
        """(number from 0, text, whether it is a comment) of each line that is not blank."""
        stream = io.TextIOWrapper(io.BytesIO(self._content), encoding="utf-8-sig")
        number = 0
        while line := stream.readline(LONGEST_LINE + 1):
            if len(line) > LONGEST_LINE:
                raise ValueError(
                    f"line {number + 1} is longer than {LONGEST_LINE} characters: write one line "
                    "per sample"
                )
            if line.strip():
                yield number, line, line.lstrip().startswith(COMMENTS)
            number += 1

    def _last_lines(self):
        """The last lines that are no comments; the first of a long file's end may be a part."""
        end = self._content[-BYTES_SEEN:].decode("utf-8-sig", errors="replace")
        lines = re.split(r"\r\n|\r|\n", end)
        lines = lines[1:] if len(self._content) > BYTES_SEEN and len(lines) > 2 else lines
        samples = [
            line for line in lines if line.strip() and not line.lstrip().startswith(COMMENTS)
        ]
        return samples[-LINES_SEEN:]

    def _scan(self):
        """Count the rows: (lines above the first, with whether they are comments; lines behind)."""
        above: deque = deque(maxlen=HEADER_LINES)
        form = self._form
        number_at = form.kinds.index(NUMBER) if NUMBER in form.kinds else None
        waiting, ragged, last = 0, None, []
        for number, line, comment in self._lines():
            if comment:
                if not self._rows:
                    above.append((line, True))
                continue
            fields = _fields(line, form.separator)
            # Between other rows one number is enough to recognise a row. The first and the last are
            # examined whole.
            quick = self._rows and number_at is not None and len(fields) == len(form.kinds)
            quick = quick and not isnan(_float(fields[number_at], form.decimal))
            if quick or form.fits(fields):
                if ragged:
                    raise ValueError(
                        f"line {ragged[0] + 1} has {ragged[1]} columns, and the last ones "
                        f"{len(form.kinds)}"
                    )
                self._first = self._first if self._rows else number
                self._rows += waiting + 1
                waiting, last = 0, fields
            elif self._rows:
                waiting += 1
                wrong = len(fields) != len(form.kinds)
                ragged = (number, len(fields)) if wrong and not ragged else ragged
            else:
                above.append((line, False))
        if self._rows > 1 and not form.fits(last):
            self._rows, waiting = self._rows - 1, waiting + 1
        return above, waiting

    def _is_cut_short(self, lines):
        """Whether the last number has fewer digits than all others, which have the same."""
        if self._content.endswith((b"\n", b"\r")):
            return False
        *others, last = (_fields(line, self._form.separator)[-1] for line in lines)
        written = {_digits(text) for text in others}
        return len(others) > 1 and len(written) == 1 and _digits(last) < written.pop()


def _digits(text):
    """(decimals, letters of the exponent) of a number."""
    match = DIGITS.fullmatch(text.strip())
    return (len(match[1]), len(match[2] or "")) if match else (0, 0)


def _form_of(lines):
    """The form (separator, decimal mark, kinds of columns) that most of the lines have."""
    seen = []
    for line in lines:
        best, best_share = None, 0.0
        for separator, decimal in FORMS:
            if separator is not None and separator not in line:
                continue
            fields = _fields(line, separator)
            kinds = tuple(_kind(field, decimal) for field in fields)
            empty = sum(not field.strip() for field in fields)
            share = sum(kind != TEXT for kind in kinds) / max(1, len(kinds) - empty)
            if share > best_share:
                best, best_share = Form(separator, decimal, kinds), share
        if best:
            seen.append(best)
    if not seen:
        raise ValueError("its last lines hold no numbers")
    (separator, decimal, width), _ = Counter(
        (form.separator, form.decimal, len(form.kinds)) for form in reversed(seen)
    ).most_common(1)[0]
    alike = [form.kinds for form in seen if len(form.kinds) == width]
    # The most common kind of each column's fields, of which a gap counts as text.
    counts = (
        Counter(kind for kind in column if kind != TEXT) for column in zip(*alike, strict=True)
    )
    return Form(
        separator,
        decimal,
        tuple(count.most_common(1)[0][0] if count else TEXT for count in counts),
    )


def _fields(line, separator):
    """The fields of a line of samples."""
    if '"' not in line:
        return line.split(separator)
    if separator is None:
        return [field.strip('"') for field in BLANK_SEPARATED.findall(line)]
    try:
        return next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise ValueError(f"a line of it cannot be read: {error}") from None


def _kind(field, decimal):
    text = field.strip()
    if text.lower() in NO_NUMBER or not isnan(_float(text, decimal)):
        return NUMBER
    if _complex_match(text, decimal):
        return COMPLEX
    return STAMP if ":" in text and CLOCK_TIME.fullmatch(text) else TEXT


def _complex(text, decimal):
    """A complex number; without an imaginary part it is real, NaN where it is none."""
    match = _complex_match(text.strip(), decimal)
    if not match:
        return complex(_float(text, decimal), 0.0)
    return complex(_float(match[1], "."), _float(match[2] + match[3], "."))


def _complex_match(text, decimal):
    if not text.endswith(("i", "j", ")")):
        return None
    return COMPLEX_NUMBER.fullmatch(text if decimal == "." else text.replace(",", "."))


def _float(text, decimal):
    try:
        # Python reads 1_000 as a number; other programs do not.
        if "_" in text:
            return nan
        return float(text) if decimal == "." else float(text.replace(",", "."))
    except ValueError:
        bare = ungrouped(text)
        return nan if bare == text else float(bare)


def _names_and_units(above, form):
    """Names of the columns (none without a header) and the units in a row below them."""
    rows = [_header_row(line, form) for line, comment in above if not comment]
    rows = [row for row in rows if row]
    if not rows:
        # A comment is a header if it names a quantity: numpy.savetxt writes it so.
        comments = [_header_row(line.strip().lstrip("#%/"), form) for line, mark in above if mark]
        rows = [row for row in comments if any(heading(x).quantity or is_unit(x) for x in row)]
    without = [""] * len(form.kinds)
    if not rows:
        _refuse_unquoted_commas(above, form)
        return without, without
    for index in range(len(rows) - 1, 0, -1):
        if _is_unit_row(rows[index]):
            return rows[index - 1], [unit.strip("[](){} ") for unit in rows[index]]
    return rows[-1], without


def _header_row(line, form):
    """A line above the samples as one field per column, empty where it has another number."""
    width = len(form.kinds)
    others = [mark for mark in SEPARATORS if mark in line and mark != form.separator]
    for separator in (form.separator, *others):
        fields = BLANK_SEPARATED.findall(line) if separator is None else _fields(line, separator)
        fields = [field.strip().strip('"') for field in fields]
        if len(fields) == width + 1 and not fields[-1]:
            return fields[:-1]
        # A separator at the end of each line makes a column without a name.
        if len(fields) == width - 1 and form.kinds[-1] == TEXT and separator is not None:
            return [*fields, ""]
        if len(fields) == width:
            return fields
    return [line.strip()] if width == 1 and heading(line).quantity else []


def _is_unit_row(row):
    """Whether a row below the names holds their units."""
    return any(is_unit(text) for text in row) and all(
        is_unit(text) or text.lower() in NO_UNIT or re.fullmatch(r"[\[({].*[\])}]", text)
        for text in row
    )


def _refuse_unquoted_commas(above, form):
    """Decimal commas between commas make two columns of each."""
    for line, comment in above:
        names = [] if comment or form.separator != "," else line.split(",")
        if len(form.kinds) == 2 * len(names) and any(heading(name).quantity for name in names):
            raise ValueError(
                f"its header has {len(names)} names and its lines {len(form.kinds)} columns: "
                "decimal commas cannot be told from commas between columns: save it with "
                "semicolons between them"
            )


FORMAT = Format(read, largest=LARGEST_TEXT)
