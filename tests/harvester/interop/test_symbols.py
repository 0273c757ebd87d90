"""Symbols for schematics, read by programs that others wrote."""

import re

import pytest

from circuits.equivalent.block.spice import PINS
from harvester.base.errors import HarvesterError
from harvester.interop.block import write_subcircuit
from harvester.interop.formats import write
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared


def written(folder, dialect):
    scene = Scene.read("device")
    return {
        path.suffix: path
        for path in write_subcircuit(prepared(scene), folder, dialect, "default", 0, 1e-3, 1.0)
    }


@pytest.mark.exhaustive
def test_spicelib_reads_ltspices_symbol_and_deck(tmp_path):
    spicelib = pytest.importorskip("spicelib")
    from spicelib.editor.asy_reader import AsyReader

    files = written(tmp_path, "ltspice")
    symbol = AsyReader(files[".asy"])
    assert symbol.attributes["Prefix"] == "X"
    assert symbol.attributes["Value"] == "harvester_device"
    assert symbol.attributes["ModelFile"] == files[".lib"].name
    assert len(symbol.pins) == 4
    named = re.findall(r"PinName (\w+)\nPINATTR SpiceOrder (\d)", files[".asy"].read_text())
    assert [name for name, _ in sorted(named, key=lambda each: each[1])] == list(PINS)
    deck = spicelib.SpiceEditor(str(files[".cir"]))
    assert deck.get_component_nodes("Xharvester") == ["p", "0", "base", "x"]
    assert deck.get_component_value("Xharvester") == "harvester_device"


def test_kiutils_reads_kicads_symbol(tmp_path):
    symbols = pytest.importorskip("kiutils.symbol")
    files = written(tmp_path, "ngspice")
    [symbol] = symbols.SymbolLib.from_file(str(files[".kicad_sym"])).symbols
    fields = {each.key: each.value for each in symbol.properties}
    assert fields["Sim.Device"] == "SUBCKT"
    assert fields["Sim.Library"] == files[".lib"].name
    assert fields["Sim.Name"] == "harvester_device"
    assert fields["Sim.Pins"] == "1=p 2=n 3=base 4=x"
    pins = {pin.number: pin.name for unit in symbol.units for pin in unit.pins}
    assert pins == {str(k): pin for k, pin in enumerate(PINS, start=1)}


def test_a_kind_or_an_option_that_is_not_there_is_refused_by_name(tmp_path):
    scene = Scene.read("device")
    with pytest.raises(HarvesterError, match=r"--as subcircuit: no such kind.*there are deck"):
        write(scene, "subcircuit", tmp_path)
    with pytest.raises(
        HarvesterError, match="--dialect: `export --as verilog-a` has no such option"
    ):
        write(scene, "verilog-a", tmp_path, dialect="ltspice")
    with pytest.raises(HarvesterError, match="--as subckt writes several files"):
        write(scene, "subckt", "-")


@pytest.mark.parametrize("kind", ["subckt", "verilog-a"])
def test_a_block_names_the_time_that_its_vibration_covers(tmp_path, kind):
    lines: list[str] = []
    write(Scene.read("device"), kind, tmp_path, lines.append, duration=0.3)
    assert lines[0].startswith(
        "the vibration covers 0.3 s and then keeps its last value: --duration"
    )
