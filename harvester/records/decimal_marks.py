"""Infer decimal marks and thousands separators of a text file's columns from all values.

"1,702" is 1.702 or 1702. The column's other values decide: 0,5 has a decimal comma, while 1,234,567
or 742 next to 1,702 has a thousands separator. Otherwise other columns decide. If they do not, the
file is rejected.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

MARKS = (",", "."), (".", ",")
GROUPED = {
    group: re.compile(rf"[+-]?[1-9]\d{{0,2}}(\{group}\d{{3}})+(\{decimal}\d*)?")
    for group, decimal in MARKS
}
# Numbers whose thousands separators cannot be decimal marks.
APART = re.compile(r"[+-]?\d{1,3}(?:['’\u00a0\u202f]\d{3})+(?:[.,]\d*)?")


def shape(text: str) -> str:
    """Decimal and thousands marks that a number implies for its column.

    Returns
    -------
    str
        The mark followed by "+" if it separates thousands, by "?" if it may, or by "d" if it is a
        decimal mark; without a mark, "mid" for integers of three digits, "long" for longer ones.
    """
    text = text.strip()
    for group, decimal in MARKS:
        if GROUPED[group].fullmatch(text):
            return f"{group}+" if decimal in text or text.count(group) > 1 else f"{group}?"
    digits = text.lstrip("+-")
    for mark in ",.":
        if mark in text and digits[0] in "0123456789,.":
            return f"{mark}d"
    if len(digits) < 3 or not digits.isdecimal():
        return ""
    return "mid" if len(digits) == 3 else "long"


def marks_of(rows: Iterable[Sequence[str]], width: int) -> Iterator[tuple[str, str]]:
    """(decimal mark, thousands separator or "") of each numeric column.

    `rows`: the fields of these columns by line. Raises ValueError if a column is ambiguous, or
    contradicts itself or another.
    """
    shapes: list[dict[str, str]] = [{} for _ in range(width)]
    for fields in rows:
        for seen, text in zip(shapes, fields, strict=True):
            # A column that certainly has decimals needs no information from other columns.
            if not (",d" in seen and "." not in text) and not (".d" in seen and "," not in text):
                seen.setdefault(shape(text), text)
    for index, column in enumerate(shapes):
        other_shapes = set(chain(*shapes[:index], *shapes[index + 1 :]))
        yield _marks(column, other_shapes)


def _marks(column, other_shapes):
    for group, decimal in MARKS:
        mixed = {f"{group}?", "mid"} <= column.keys() and "long" not in column
        if f"{group}+" in column or (mixed and f"{group}d" not in column):
            if f"{group}d" in column or f"{group}d" in other_shapes:
                _refuse(column.get(f"{group}+") or column[f"{group}?"], group)
            return decimal, group
    for decimal, group in MARKS:
        if f"{decimal}d" in column:
            return decimal, ""
        if f"{decimal}?" not in column:
            continue
        # If all values have three digits after the mark, the other columns decide.
        if f"{group}d" in other_shapes and f"{decimal}d" not in other_shapes:
            return group, decimal
        # A point is a decimal point, unless another column has an equally ambiguous comma.
        unsure = decimal == "," or ",?" in other_shapes
        if unsure and f"{decimal}d" not in other_shapes:
            _refuse(column[f"{decimal}?"], decimal)
        return decimal, ""
    return ".", ""


def _refuse(text, mark):
    text = text.strip()
    raise ValueError(
        f"{text} is ambiguous: {text.replace(mark, '')} or "
        f"{text.replace(mark, '.')}: save it without thousands separators "
        "and with decimal points"
    )


def ungrouped(text: str) -> str:
    """Remove thousands separators if `text` certainly has them; return other texts unchanged."""
    if APART.fullmatch(text.strip()):
        return re.sub("['’\u00a0\u202f]", "", text).replace(",", ".")
    for group, decimal in MARKS:
        if shape(text) == f"{group}+":
            return text.replace(group, "").replace(decimal, ".")
    return text
