"""The figure of `harvester stability`: every case a row of coloured cells."""

import math

from harvester.averaging import AVERAGED
from harvester.engines.protocol import ENGINES
from harvester.verification.stability.verdicts import REFUSED, RIGHT, WRONG

FACE = {RIGHT: "#A8DDB5", REFUSED: "#D0D0D0", WRONG: "#CB181D"}
INK = {RIGHT: "black", REFUSED: "0.25", WRONG: "white"}
BLOCKS = 3
# Left edges and widths of a block's cells, the case's name left of them; a block is 1 wide.
NAME, CELLS = 0.0, ((0.36, 0.24), (0.61, 0.115), (0.735, 0.115), (0.86, 0.115))


def draw(matrix):
    """One coloured grid: residual and time of the simulations, error and time of the closures."""
    from matplotlib.figure import Figure

    depth = math.ceil(len(matrix.rows) / BLOCKS)
    figure = Figure(figsize=(19.0, 1.3 + 0.27 * depth))
    axes = figure.add_subplot()
    for place, row in enumerate(matrix.rows):
        _draw_row(axes, row, place // depth, place % depth)
    for block in range(min(BLOCKS, len(matrix.rows))):
        _draw_heads(axes, block)
    axes.set_xlim(0.0, BLOCKS)
    axes.set_ylim(depth, -1.6)
    axes.axis("off")
    counts = ", ".join(
        f"{sum(_words(row).count(word) for row in matrix.rows)} {word}" for word in FACE
    )
    figure.suptitle(
        f"{matrix.scene.name}: stiff and extreme cases ({counts}; {matrix.wall_seconds:.0f} s)\n"
        "simulation: energy balance residual of circuit | Monte Carlo, seconds of circuit; "
        "closures: relative numerical error, seconds",
        x=0.01,
        ha="left",
        fontsize=10,
    )
    return figure


def _draw_heads(axes, block):
    heads = ("simulation", *AVERAGED)
    for head, (left, width) in zip(heads, CELLS, strict=True):
        axes.text(block + left + 0.5 * width, -0.5, head, ha="center", va="center", weight="bold")


def _draw_row(axes, row, block, line):
    axes.text(block + NAME, line + 0.5, row.case.title, va="center", fontsize=8)
    texts = [_simulation_text(row), *(_closure_text(row, name) for name in AVERAGED)]
    for word, text, (left, width) in zip(_words(row), texts, CELLS, strict=True):
        corner = (block + left, line + 0.06)
        axes.add_patch(_rectangle(corner, width, FACE[word]))
        axes.text(
            corner[0] + 0.5 * width,
            line + 0.5,
            text,
            ha="center",
            va="center",
            color=INK[word],
            fontsize=7.5,
        )


def _rectangle(corner, width, colour):
    from matplotlib.patches import Rectangle

    return Rectangle(corner, width, 0.88, facecolor=colour, linewidth=0)


def _words(row):
    return [row.simulation.word, *(row.closures[name].word for name in AVERAGED)]


def _simulation_text(row):
    residuals = [row.residual(engine) for engine in ENGINES]
    if any(math.isnan(residual) for residual in residuals):
        return row.simulation.word
    both = " | ".join(f"{residual:+.2%}" for residual in residuals)
    return f"{both}  {row.seconds('circuit'):.1f} s"


def _closure_text(row, name):
    error = row.numerical_error(name)
    if math.isnan(error):
        return row.closures[name].word
    return f"{error:.0e}  {row.seconds(name):.1f} s"
