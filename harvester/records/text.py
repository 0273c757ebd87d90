"""Columns of a text file with one line per sample."""

from __future__ import annotations

import csv
import io
import itertools
import re
from array import array
from collections import Counter, deque
from collections.abc import Iterator
from math import isnan, nan
from typing import Any, NamedTuple

import numpy as np

from harvester.records.decimal_marks import marks_of, shape, ungrouped
from harvester.records.quantities import heading, is_unit
from harvester.records.table import LARGEST_TEXT, Format, Table
from harvester.records.time_stamps import CLOCK_TIME, StampReader

COMMENTS = ("#", "%", "//")
# Separators of fields; None for blanks. If several work equally well, the first is used. Between
# separating commas, numbers with decimal commas must be quoted.
SEPARATORS = (";", "\t", ",")
# Maximum line length in characters. A line holds one sample of every column.
LONGEST_LINE = 1_000_000
# The majority of the last lines determines the format, since a footer is shorter.
LINES_SEEN, BYTES_SEEN = 41, 200_000
HEADER_LINES = 50
NO_NUMBER = ("nan", "na", "n/a", "#n/a", "null", "none", "-", "--")
NUMBER, STAMP, COMPLEX, TEXT = "number", "stamp", "complex", "text"
# Matches complex numbers such as 1.5e-3-2i and (0.1+2j).
COMPLEX_NUMBER = re.compile(
    r"\(?\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*([+-])\s*([\d.]+(?:[eE][+-]?\d+)?)\s*\*?[ij]\s*\)?"
)
# Matches a quoted field, a unit in brackets, or a word with an optional unit in brackets.
BLANK_SEPARATED = re.compile(r"\"[^\"]*\"|[\[(][^\])]*[\])]|\S+(?:\s+[\[(][^\])]*[\])])?")
# Entries in a row of units by which loggers denote columns without a unit.
NO_UNIT = ("", "-", "ts", "rn")
# Decimals and exponent of a number. A truncated line has fewer digits.
DIGITS = re.compile(r"[+-]?\d*[.,]?(\d*)([eE][+-]?\d*)?")


class Form(NamedTuple):
    """Format of the lines of samples.

    Attributes
    ----------
    separator
        Separator of the fields; None: blanks.
    kinds
        Kind of each column: `NUMBER`, `STAMP`, `COMPLEX` or `TEXT`.
    """

    separator: str | None
    kinds: tuple[str, ...]

    def fits(self, fields: list[str]) -> bool:
        """Whether each field of a line is empty or of its column's kind (number, time stamp).

        The imaginary part of a complex number may be missing.
        """
        if len(fields) != len(self.kinds):
            return False
        pairs = zip(fields, self.kinds, strict=True)
        kinds = [(_kind(field), kind) for field, kind in pairs if field.strip() and kind != TEXT]
        return bool(kinds) and all(
            written in (kind, kind == COMPLEX and NUMBER) for written, kind in kinds
        )


def read(content: bytes) -> Table:
    """Read columns separated by commas, semicolons, tabs or blanks, with or without a header.

    Numbers may be quoted, and have decimal commas if commas do not separate columns. The last line
    may be truncated, and a footer may follow the samples. Names come from the header, or from a
    comment above the first line, and a row of units may follow. Time stamps become seconds after
    the first.

    `content`: UTF-8; lines that begin with #, % or // are comments. Raises ValueError if it is not
    text, or its last lines contain no numbers.
    """
    if b"\0" in content:
        raise ValueError("it contains NUL bytes (UTF-16, or not a text): save it as UTF-8")
    last_lines = _last_lines(content)
    form = _form_of(last_lines)
    kinds = form.kinds
    above, first, rows, left_out = _scan(content, form)
    if rows > 1 and not left_out and _is_cut_short(content, last_lines, form):
        rows, left_out = rows - 1, 1
    names, units = _names_and_units(above, form)

    def samples():
        lines = (line for line in _lines(content) if line[0] >= first and not line[2])
        return (_fields(line, form.separator) for _, line, _ in itertools.islice(lines, rows))

    def take(indices):
        marks = _marks(content, form, samples, indices)
        columns: list[Any] = [[] if kinds[k] == COMPLEX else array("d") for k in indices]
        readers = [
            (column.append, index, _reader(kinds[index], *marks.get(index, ())))
            for column, index in zip(columns, indices, strict=True)
        ]
        for fields in samples():
            for append, index, number in readers:
                append(number(fields[index]))
        return [
            np.array(column, complex) if isinstance(column, list) else np.frombuffer(column)
            for column in columns
        ]

    def line_of(row):
        numbers = (number for number, _, comment in _lines(content) if not comment)
        return next(itertools.islice((n for n in numbers if n >= first), row, None)) + 1

    remark = f"the file's last {left_out} lines are not complete samples and are ignored"
    if left_out == 1:
        remark = "the file's last line is not a complete sample and is ignored"
    return Table(
        names,
        rows,
        take,
        ["s" if kind == STAMP else unit for kind, unit in zip(kinds, units, strict=True)],
        texts=[index for index, kind in enumerate(kinds) if kind == TEXT],
        complexes=[index for index, kind in enumerate(kinds) if kind == COMPLEX],
        remarks=(remark,) if left_out else (),
        line_of=line_of,
    )


def _reader(kind, decimal=",", group=""):
    """The function that converts a field of a column to a number."""
    if kind == STAMP:
        return StampReader().seconds
    return _complex if kind == COMPLEX else lambda text: _number(text, decimal, group)


def _marks(content, form, samples, indices):
    """(decimal mark, thousands separator) of each column with commas or possible grouping."""
    numbers = [k for k, kind in enumerate(form.kinds) if kind == NUMBER]
    # Test whether fields may contain commas, so that each column's values decide their meaning.
    if b"," not in content or (form.separator == "," and b'"' not in content):
        asked = {*indices} & {*numbers} if b"." in content else ()
        columns = ((fields[k] for fields in samples()) for k in asked)
        shapes = (itertools.takewhile(".d".__ne__, map(shape, column)) for column in columns)
        # Points may separate thousands, as in 1.286 next to 742.
        if not any({".?", "mid"} <= {*seen} for seen in shapes):
            return {}
    rows = ([fields[k] for k in numbers] for fields in samples())
    return dict(zip(numbers, marks_of(rows, len(numbers)), strict=True))


def _lines(content: bytes) -> Iterator[tuple[int, str, bool]]:
    """Yield (number from 0, text, whether it is a comment) of each line that is not blank."""
    stream = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig")
    for number in itertools.count():
        line = stream.readline(LONGEST_LINE + 1)
        if not line:
            return
        if len(line) > LONGEST_LINE:
            raise ValueError(
                f"line {number + 1} is longer than {LONGEST_LINE} characters: write one line "
                "per sample"
            )
        if line.strip():
            yield number, line, line.lstrip().startswith(COMMENTS)


def _last_lines(content):
    """The last lines without comments; the first one may be incomplete."""
    end = content[-BYTES_SEEN:].decode("utf-8-sig", errors="replace")
    lines = list(io.StringIO(end, newline=None))
    lines = lines[1:] if len(content) > BYTES_SEEN and len(lines) > 1 else lines
    samples = [line for line in lines if line.strip() and not line.lstrip().startswith(COMMENTS)]
    return samples[-LINES_SEEN:]


def _scan(content, form):
    """Lines above the first row with comment flags, its number, the rows, and the lines below."""
    above: deque = deque(maxlen=HEADER_LINES)
    last: list[str] = []
    width, first, rows, behind, ragged = len(form.kinds), 0, 0, 0, ""
    number_at = form.kinds.index(NUMBER) if NUMBER in form.kinds else width
    for number, line, comment in _lines(content):
        fields = [] if comment else _fields(line, form.separator)
        # In the middle, one number identifies a row. The first and last rows are checked
        # completely.
        quick = rows and number_at < len(fields) == width
        if (quick and not isnan(_number(fields[number_at]))) or form.fits(fields):
            if ragged:
                raise ValueError(f"{ragged}, and the last ones {width}")
            first = first if rows else number
            rows, behind, last = rows + behind + 1, 0, fields
        elif not rows:
            above.append((line, comment))
        elif not comment:
            behind += 1
            if len(fields) != width and not ragged:
                ragged = f"line {number + 1} has {len(fields)} columns"
    if rows > 1 and not form.fits(last):
        rows, behind = rows - 1, behind + 1
    return above, first, rows, behind


def _is_cut_short(content, lines, form):
    """Whether the last number has fewer digits than all others, which have equally many."""
    *others, last = (DIGITS.fullmatch(_fields(x, form.separator)[-1].strip()) for x in lines)
    # Numbers of decimals, and letters of the exponent.
    digits, *other_digits = {
        match and (len(match[1]), len(match[2] or "")) for match in others
    } or {None}
    if content.endswith((b"\n", b"\r")) or len(others) < 2 or other_digits or not (digits and last):
        return False
    return (len(last[1]), len(last[2] or "")) < digits


def _form_of(lines):
    """The form (separator, kinds of columns) of most lines."""
    seen = []
    for line in lines:
        best, best_share = None, 0.0
        for separator in (*(mark for mark in SEPARATORS if mark in line), None):
            fields = _fields(line, separator)
            kinds = tuple(_kind(field) for field in fields)
            empty = sum(not field.strip() for field in fields)
            share = sum(kind != TEXT for kind in kinds) / max(1, len(kinds) - empty)
            if share > best_share:
                best, best_share = Form(separator, kinds), share
        if best:
            seen.append(best)
    if not seen:
        raise ValueError(
            "its last lines hold no numbers: write samples below the heading, one a line"
        )
    widths = Counter((form.separator, len(form.kinds)) for form in reversed(seen))
    separator, width = widths.most_common(1)[0][0]
    alike = [form.kinds for form in seen if len(form.kinds) == width]
    # The most common kind of each column's fields, ignoring texts and gaps.
    columns = ([kind for kind in column if kind != TEXT] for column in zip(*alike, strict=True))
    usual = (Counter(column).most_common(1)[0][0] if column else TEXT for column in columns)
    return Form(separator, tuple(usual))


def _fields(line, separator):
    """Split a line of samples into fields."""
    if '"' not in line:
        return line.split(separator)
    if separator is None:
        return [field.strip('"') for field in BLANK_SEPARATED.findall(line)]
    try:
        return next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise ValueError(f"a line cannot be read: {error}") from None


def _kind(field):
    text = field.strip()
    if text.lower() in NO_NUMBER or not isnan(_number(text)):
        return NUMBER
    if _complex_match(text):
        return COMPLEX
    return STAMP if ":" in text and CLOCK_TIME.fullmatch(text) else TEXT


def _complex(text):
    """Convert a text to a complex number, real without imaginary part; NaN if invalid."""
    match = _complex_match(text.strip())
    parts = (match[1], match[2] + match[3]) if match else (text, "0")
    return complex(*map(_number, parts))


def _complex_match(text):
    return text.endswith(("i", "j", ")")) and COMPLEX_NUMBER.fullmatch(text.replace(",", "."))


def _number(text, decimal=",", group=""):
    """Convert a text to a number; NaN if it is not a number."""
    try:
        # Python accepts 1_000 as a number; other programs do not.
        return nan if "_" in text else float(text.replace(group, "").replace(decimal, "."))
    except ValueError:
        bare = ungrouped(text)
        return nan if bare == text else float(bare)


def _names_and_units(above, form):
    """Names of the columns (none without a header), and the units in a row below them."""
    rows = [_header_row(line, form) for line, comment in above if not comment]
    rows = [row for row in rows if row]
    if not rows:
        # A comment that names a quantity is a header, as numpy.savetxt writes it.
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
    """Split a line above the samples into one field per column; empty if the count differs."""
    width = len(form.kinds)
    alternatives = [mark for mark in SEPARATORS if mark in line and mark != form.separator]
    for separator in (form.separator, *alternatives):
        fields = BLANK_SEPARATED.findall(line) if separator is None else _fields(line, separator)
        fields = [field.strip().strip('"') for field in fields]
        if len(fields) == width + 1 and not fields[-1]:
            return fields[:-1]
        # A separator at the end of each line creates a column without a name.
        if len(fields) == width - 1 and form.kinds[-1] == TEXT and separator is not None:
            return [*fields, ""]
        if len(fields) == width:
            return fields
    return [line.strip()] if width == 1 and heading(line).quantity else []


def _is_unit_row(row):
    """Whether a row below the names contains units."""
    return any(is_unit(text) for text in row) and all(
        is_unit(text) or text.lower() in NO_UNIT or re.fullmatch(r"[\[({].*[\])}]", text)
        for text in row
    )


def _refuse_unquoted_commas(above, form):
    """Raise ValueError if unquoted decimal commas split each column in two."""
    for line, comment in above:
        names = [] if comment or form.separator != "," else line.split(",")
        if len(form.kinds) == 2 * len(names) and any(heading(name).quantity for name in names):
            raise ValueError(
                f"its header has {len(names)} names and its lines {len(form.kinds)} columns: "
                "decimal commas cannot be distinguished from commas between columns: save it with "
                "semicolons between them"
            )


FORMAT = Format(read, largest=LARGEST_TEXT)
