"""Print results on a terminal: tables fitted to its width, footnotes, and density plots in text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from rich import box
from rich.table import Table as RichTable

from harvester.base.formatting import Printed
from harvester.base.plain_text import one_line
from harvester.results.view import Table, key_columns

if TYPE_CHECKING:
    from harvester.results.result import Result

# Longer texts become footnotes, so that a table of numbers stays narrow.
LONGEST_CELL = 32
# Minimum width of a column that identifies rows.
NARROWEST_KEY = 12
# Characters between two columns, and margin at both ends of a line.
GAP, MARGIN = 3, 1
# Text plot of a density: bars in eighths of the height, characters per line, samples of the density
# per character, and the share of the peak below which the ends are cut.
HEIGHTS = " ▁▂▃▄▅▆▇█"
LETTERS, FINER, VISIBLE_SHARE = 56, 32, 0.01


def laid_out(table: Table, width: int) -> tuple[list[RichTable], list[str]]:
    """Lay a table out in blocks of at most `width` characters, with footnotes.

    Columns that do not fit form a further block, which repeats the columns that identify the rows.
    A long text is replaced by the number of its footnote; equal texts share one.
    """
    header = [one_line(name) for name in table.header]
    keys = key_columns(table.rows, len(header))
    rows, footnotes = _with_footnotes(table.rows, keys)
    widths = _widths(header, rows, keys, width)
    blocks = []
    for columns in _blocks(widths, keys, width):
        block = RichTable(box=box.SIMPLE_HEAD)
        spare = width - MARGIN - sum(widths[k] + GAP for k in columns)
        for k in columns:
            # Remaining width is given to headings that need several lines.
            wider = max(0, min(spare, len(header[k]) - widths[k]))
            spare -= wider
            words = any(row[k][:1].isalpha() for row in rows)
            justify: Literal["left", "right"] = "left" if words else "right"
            heading, space = header[k], widths[k] + wider
            if _longest_word(heading) > space:
                heading = heading.replace(".", ".\n")
            block.add_column(heading, justify=justify, width=space, overflow="fold")
        for row in rows:
            block.add_row(*(row[k] for k in columns))
        blocks.append(block)
    return blocks, footnotes


def _widths(header, rows, keys, width):
    """Widths of the columns; numbers are never wrapped."""
    widths = [
        max([_longest_word(name), *(len(row[k]) for row in rows)]) for k, name in enumerate(header)
    ]
    # Long keys wrap between words until the table fits or they take half of the width.
    least = [
        max(
            NARROWEST_KEY, *map(_longest_word, [header[k].replace(".", " "), *(r[k] for r in rows)])
        )
        for k in range(keys)
    ]
    while (
        MARGIN + sum(widths) + GAP * len(widths) > width
        and sum(widths[:keys]) + GAP * keys > width // 2
        and any(widths[k] > least[k] for k in range(keys))
    ):
        widths[max(range(keys), key=lambda k: (widths[k] > least[k], widths[k]))] -= 1
    # A column that does not fit next to the keys also wraps between words.
    available = width - MARGIN - sum(widths[k] + GAP for k in range(keys)) - GAP
    for k in range(keys, len(header)):
        words = max((_longest_word(row[k]) for row in rows), default=1)
        widths[k] = min(widths[k], max(available, words, _longest_word(header[k])))
    return widths


def _with_footnotes(rows, keys):
    """The rows with footnote numbers for long texts, and the footnotes."""
    numbers: dict[str, int] = {}
    shortened = []
    for row in rows:
        cells = [one_line(cell) for cell in row]
        for k in range(keys, len(cells)):
            if len(cells[k]) > LONGEST_CELL and not isinstance(row[k], Printed):
                cells[k] = f"[{numbers.setdefault(cells[k], len(numbers) + 1)}]"
        shortened.append(cells)
    return shortened, [f"[{number}] {text}" for text, number in numbers.items()]


def _blocks(widths: Sequence[int], keys: int, width: int) -> Iterator[list[int]]:
    """Yield the column numbers of each block."""
    start = sum(widths[k] + GAP for k in range(keys)) + MARGIN
    columns, filled = list(range(keys)), start
    for k in range(keys, len(widths)):
        if len(columns) > keys and filled + widths[k] + GAP > width:
            yield columns
            columns, filled = list(range(keys)), start
        columns.append(k)
        filled += widths[k] + GAP
    yield columns


def _longest_word(text):
    return max(map(len, text.split()), default=1)


def density_sketch(results: Mapping[str, Result]) -> list[str]:
    """One line of bars for each method with a density of X, and one with the range.

    All lines have the same range and height.
    """
    curves = {
        name: result.densities["displacement"]
        for name, result in results.items()
        if "displacement" in result.densities
    }
    if not curves:
        return []
    visible = [c.centre[c.density >= VISIBLE_SHARE * c.density.max()] for c in curves.values()]
    low, high = min(centre[0] for centre in visible), max(centre[-1] for centre in visible)
    samples = low + (high - low) * (np.arange(LETTERS * FINER) + 0.5) / (LETTERS * FINER)
    heights = {
        name: np.interp(samples, c.centre, c.density).reshape(LETTERS, FINER).mean(axis=1)
        for name, c in curves.items()
    }
    top = max(row.max() for row in heights.values())
    names = max(map(len, heights))
    first = results[next(iter(curves))]
    scale, unit = first.scales.of("displacement"), first.unit("displacement")
    ends = f"{low * scale:.3g}", f"{high * scale:.3g} {unit}"
    middle = f"{'density of displacement':^{LETTERS - len(ends[0]) - len(ends[1])}}"
    return [
        *(
            f"  {name:{names}}  {''.join(HEIGHTS[round(8 * share)] for share in row / top)}"
            for name, row in heights.items()
        ),
        f"  {'':{names}}  {ends[0]}{middle}{ends[1]}",
    ]
