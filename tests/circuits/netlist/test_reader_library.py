"""The project's own netlists are included by name from any folder."""

import pytest

from circuits.netlist.subcircuits import read_load
from harvester.base.errors import NetlistError

LOAD = (
    ".subckt mine p n out ref\n.include {}\nXbuck p out n nano_buck\nRload out ref 1meg\n"
    "Rref ref n 1meg\n.ends\n"
)


@pytest.fixture
def written(tmp_path):
    def write(include):
        head, _, rest = LOAD.format(include).partition("\n")
        included, _, rest = rest.partition("\n")
        (tmp_path / "mine.lib").write_text(f"{included}\n{head}\n{rest}")
        return tmp_path / "mine.lib"

    return write


def test_a_library_is_found_by_its_name_from_any_folder(written):
    load = read_load(written("buck_converters.lib"))
    assert any("bgive" in each.name for each in load.elements)
    # What a project's file includes in turn is found beside it.
    assert read_load(written('"bridge_buck.lib"'), "mine").name == "mine"


def test_a_file_beside_the_load_goes_before_the_library(written, tmp_path):
    (tmp_path / "buck_converters.lib").write_text(
        ".subckt nano_buck in out ref\nRmine in out 1k\nRref out ref 1k\n.ends\n"
    )
    load = read_load(written("buck_converters.lib"))
    assert any("rmine" in each.name for each in load.elements)


@pytest.mark.parametrize("name", ["../buck_converters.lib", "netlists/diodes.lib", "__init__.py"])
def test_nothing_else_is_found_there(written, name):
    with pytest.raises(NetlistError, match=r"is outside|no such file"):
        read_load(written(name))
