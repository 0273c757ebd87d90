"""The limits that docs/reference/safety.md states are those of the code."""

from pathlib import Path

import pytest

from circuits.equivalent import export
from circuits.netlist import expansion, expression, reader, vetting
from harvester.base import plain_text
from harvester.device import keys
from harvester.engines import codec, simulate
from harvester.excitation import base
from harvester.records import hdf5, mat, table
from harvester.scene import steps, toml

SAFETY = Path(__file__).parents[1] / "docs" / "reference" / "safety.md"
ROWS = [
    ("**netlist**: a load", (reader.MOST_BYTES,)),
    ("**netlist**: a load", (expansion.MOST_CHARACTERS,)),
    ("files; includes", (reader.MOST_FILES, reader.DEEPEST_INCLUDE)),
    ("elements, and calls", (expansion.MOST_ELEMENTS,)),
    ("calls within calls", (expansion.DEEPEST_CALL,)),
    ("statements; characters", (reader.MOST_CARDS, reader.LONGEST_CARD)),
    ("parameters, functions", (expansion.MOST_DEFINITIONS,)),
    ("parentheses", (expression.DEEPEST,)),
    ("a name or a number", (vetting.LONGEST_WORD,)),
    ("**scene**: a file", (toml.LARGEST_SCENE,)),
    ("values; tables", (toml.MOST_VALUES, toml.DEEPEST)),
    ("a text", (toml.LONGEST_TEXT,)),
    ("realizations", (int(base.Run.KEYS["realizations"].high),)),
    ("numbers in a `.mat`", (table.MOST_NUMBERS,)),
    ("structures of a `.mat`", (mat.LARGEST_STRUCTURE // 10**6,)),
    ("objects of an HDF5", (hdf5.MOST_OBJECTS,)),
    ("**study**: a stored task", (codec.MOST_BYTES,)),
    ("**`harvester netlist`**", (export.MOST_KNOTS,)),
    ("**run**: wall-clock", (int(simulate.TIME_LIMIT),)),
    ("processor time", (int(steps.PATIENCE),)),
    ("**output**: a name", (plain_text.LONGEST_NAME,)),
]


@pytest.mark.parametrize(("words", "limits"), ROWS)
def test_a_stated_limit_is_the_codes(words, limits):
    (row,) = (line for line in SAFETY.read_text().splitlines() if line.startswith(f"| {words}"))
    stated = row.split("|")[2].replace(",", "")
    for limit in limits:
        assert str(limit) in stated.replace(";", " ").split(), (row, limit)


def test_the_range_of_numbers_is_the_codes():
    assert f"{keys.SMALLEST:g} to {keys.LARGEST:g}" == "1e-30 to 1e+30"
    assert "| a number other than 0 | 1e-30 to 1e30 |" in SAFETY.read_text()
