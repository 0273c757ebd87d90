"""The figure of `harvester stability`: every case a row of coloured cells."""

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
# Shares of a block's width: the case's name, and a gap between cells.
NAME, GAP = 0.22, 0.006
# Letters that a column has room for at least.
SHORTEST = 14


def draw(matrix: StabilityMatrix) -> Figure:
    """One coloured grid: what judged each cell, and how sharply."""
    from matplotlib.figure import Figure

    depth = math.ceil(len(matrix.rows) / BLOCKS)
    figure = Figure(figsize=(24.0, 1.4 + 0.25 * depth))
    axes = figure.add_subplot()
    for place, row in enumerate(matrix.rows):
        _draw_row(axes, matrix, row, place // depth, place % depth)
    for block in range(min(BLOCKS, len(matrix.rows))):
        for method, (left, width) in zip(matrix.methods, _columns(matrix), strict=True):
            axes.text(
                block + left + 0.5 * width,
                -0.5,
                method.replace("_", " "),
                ha="center",
                va="center",
                weight="bold",
                fontsize=8,
            )
    axes.set_xlim(0.0, BLOCKS)
    axes.set_ylim(depth, -1.2)
    axes.axis("off")
    counts = ", ".join(f"{len(matrix.cells(word))} {word}" for word in WORDS)
    figure.suptitle(
        f"{matrix.scene.name}: stiff and extreme cases ({counts}; {matrix.wall_seconds:.0f} s)\n"
        "in each cell its judges and how sharply they judge: the path against a fine one, E[V²] "
        "against another method or a closed form, a closure against its coarser grid",
        x=0.01,
        ha="left",
        fontsize=10,
    )
    return figure


def _columns(matrix):
    """(left edge, width) of each method's cells within a block, as wide as their longest texts."""
    lengths = [
        max(SHORTEST, *(len(cell_text(row.cells[method])) for row in matrix.rows))
        for method in matrix.methods
    ]
    columns, left = [], NAME
    for length in lengths:
        width = (0.99 - NAME) * length / sum(lengths)
        columns.append((left, width - GAP))
        left += width
    return columns


def _draw_row(axes, matrix, row, block, line):
    from matplotlib.patches import Rectangle

    axes.text(block, line + 0.5, row.case.title, va="center", fontsize=8)
    for method, (left, width) in zip(matrix.methods, _columns(matrix), strict=True):
        verdict = row.cells[method]
        face, ink = FACE[verdict.word], INK.get(verdict.word, "black")
        corner = (block + left, line + 0.06)
        axes.add_patch(Rectangle(corner, width, 0.88, facecolor=face, linewidth=0))
        axes.text(
            corner[0] + 0.5 * width,
            line + 0.5,
            cell_text(verdict),
            ha="center",
            va="center",
            color=ink,
            fontsize=7,
        )
