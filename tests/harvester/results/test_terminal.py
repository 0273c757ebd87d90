"""Tables on terminals of any width."""

import io

import pytest
from rich.console import Console

from harvester.base.formatting import with_error
from harvester.results.terminal import LONGEST_CELL, laid_out
from harvester.results.view import Table
from harvester.statistics.estimate import Estimate

REASON = (
    "the power changes more slowly than 64 periods show; harvester basins there averages starts"
)


def study(columns, rows=4):
    """A table with a number in each cell but the first and the last."""
    header = ["method", *(f"quantity number {k}" for k in range(columns)), "no error bar because"]
    body = []
    for row in range(rows):
        numbers = [
            with_error(Estimate(1.5e-3 * (k + 1) * (row + 1), 2e-5, None, "power"), "W")
            for k in range(columns)
        ]
        body.append([f"method {row}", *numbers, REASON if row % 2 else ""])
    return Table(header, body)


def lines_of(table, width):
    blocks, footnotes = laid_out(table, width)
    stream = io.StringIO()
    console = Console(file=stream, width=width)
    for block in blocks:
        console.print(block)
    return blocks, stream.getvalue().splitlines(), footnotes


@pytest.mark.parametrize("width", [60, 80, 100, 140, 220])
@pytest.mark.parametrize("columns", [1, 3, 12])
def test_a_table_fits_and_no_number_is_broken(width, columns):
    table = study(columns)
    _, lines, footnotes = lines_of(table, width)
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    assert all(cell in text for row in table.rows for cell in row[:-1])
    assert footnotes == [f"[1] {REASON}"]
    assert text.count("[1]") == 2


def test_rows_are_told_apart_in_each_block():
    blocks, lines, _ = lines_of(study(12), 80)
    assert len(blocks) > 1
    assert sum("method 3" in line for line in lines) == len(blocks)


def test_rows_that_two_columns_tell_apart_keep_both():
    rows = [["a", k, *["x" * LONGEST_CELL] * 3] for k in ("1", "2")]
    rows += [["b", k, *["y" * LONGEST_CELL] * 3] for k in ("1", "2")]
    blocks, footnotes = laid_out(Table(["load", "place", "p", "q", "r"], rows), 80)
    assert len(blocks) == 3
    assert all([str(c.header) for c in block.columns][:2] == ["load", "place"] for block in blocks)
    assert not footnotes


def test_long_keys_leave_room_for_numbers():
    rows = [
        [
            f"the strain of the layers per displacement of mode {k}",
            "with all modes left out",
            "-3.8638e-10",
        ]
        for k in range(3)
    ]
    _, lines, _ = lines_of(Table(["quantity", "equation", "value"], [*rows, *rows]), 80)
    assert max(map(len, lines)) <= 80
    assert "\n".join(lines).count("-3.8638e-10") == 6


def test_words_of_keys_stay_whole():
    key = "excitation.intensity [m²/s³]"
    rows = [["fokker_planck", str(k), str(7 * k), "1" * 30] for k in range(3)]
    rows += [["monte-carlo", *row[1:]] for row in rows]
    _, lines, _ = lines_of(Table(["method", "load.resistance [Ω]", key, "power"], rows), 80)
    text = "\n".join(lines)
    for word in ("fokker_planck", "resistance", "intensity"):
        assert word in text
