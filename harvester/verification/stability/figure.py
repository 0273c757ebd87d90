"""The figure of `harvester stability`: its table with coloured cells, whole or in pages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from harvester.verification.stability.matrix import cell_text
from harvester.verification.stability.verdicts import (
    NOT_JUDGED,
    REFUSED,
    RIGHT,
    UNFINISHED,
    WORDS,
    WRONG,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.verification.stability.matrix import StabilityMatrix

FACE = {
    RIGHT: "#A8DDB5",
    REFUSED: "#D0D0D0",
    NOT_JUDGED: "#FEE8A0",
    UNFINISHED: "#FDAE6B",
    WRONG: "#CB181D",
}
INK = {WRONG: "white", REFUSED: "0.25"}
BLOCKS = 2
# Rows of a page, and the width of a block in inches.
PAGE, WIDTH = 30, 12.0
# Share of a block's width for the names of cases, and the fewest letters of a column.
NAME, SHORTEST = 0.22, 14


def draw(matrix: StabilityMatrix) -> Figure:
    """Judge and margin of each cell: all rows, in two blocks side by side."""
    depth = math.ceil(len(matrix.rows) / BLOCKS)
    parts = [slice(block * depth, (block + 1) * depth) for block in range(BLOCKS)]
    return _drawn(matrix, parts, depth)


def draw_pages(matrix: StabilityMatrix) -> list[Figure]:
    """Judge and margin of each cell, in figures of `PAGE` rows that can be read in print."""
    count = len(matrix.rows)
    return [
        _drawn(matrix, [slice(first, first + PAGE)], min(PAGE, count - first))
        for first in range(0, count, PAGE)
    ]


def _drawn(matrix, parts, depth):
    """A figure with a block for each part of the rows, `depth` of which are the most."""
    from matplotlib.figure import Figure

    texts = [[cell_text(row.cells[method]) for method in matrix.methods] for row in matrix.rows]
    lengths = [max(SHORTEST, *map(len, column)) for column in zip(*texts, strict=True)]
    widths = [NAME, *((1.0 - NAME) * length / sum(lengths) for length in lengths)]
    figure = Figure(figsize=(WIDTH * len(parts), 1.4 + 0.25 * depth))
    for part, axes in zip(parts, figure.subplots(1, len(parts), squeeze=False)[0], strict=True):
        axes.axis("off")
        if matrix.rows[part]:
            _draw_block(axes, matrix, matrix.rows[part], texts[part], widths, depth)
    counts = ", ".join(f"{len(matrix.cells(word))} {word}" for word in WORDS)
    figure.suptitle(
        f"{matrix.scene.name}: stiff and extreme cases ({counts}; {matrix.wall_seconds:.0f} s)\n"
        "in each cell its judges and how sharply they judge: the path against a fine one, E[V²] "
        "against another\nmethod or a closed form, a closure against its coarser grid",
        x=0.01,
        ha="left",
        fontsize=10,
    )
    return figure


def _draw_block(axes, matrix, rows, texts, widths, depth):
    header = [method.replace("_", " ") for method in matrix.methods]
    words = [[row.cells[method].word for method in matrix.methods] for row in rows]
    table = axes.table(
        [["", *header], *([row.case.title, *line] for row, line in zip(rows, texts, strict=True))],
        cellColours=[["none"] * len(widths), *(["none", *map(FACE.get, line)] for line in words)],
        colWidths=widths,
        cellLoc="center",
        bbox=(0.0, 1.0 - (len(rows) + 1) / (depth + 1), 1.0, (len(rows) + 1) / (depth + 1)),
        edges="closed",
    )
    table.auto_set_font_size(False)
    for (line, column), cell in table.get_celld().items():
        cell.set(edgecolor="white", linewidth=1.0)
        cell.set_fontsize(7 if line and column else 8)
        if line and column:
            cell.set_text_props(color=INK.get(words[line - 1][column - 1], "black"))
        elif column:
            cell.set_text_props(weight="bold")
        else:
            cell.set_text_props(ha="left")
