"""Stores that still charge, against the same run once they are charged."""

import re

import pytest

from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

BRIDGE = """.model sch d(is=200n n=1.05 rs=10 cjo=5p)
D1 p out sch
D2 ref p sch
D3 n out sch
D4 ref n sch
"""
DEVICE = [
    "oscillator={mass=0.022, damping=0.2, linear_stiffness=63.451, cubic_stiffness=0.0}",
    "piezo={coupling=3.69e-4, capacitance=4.3e-8}",
    "excitation={kind='sine', amplitude=4.0, frequency=8.5}",
]


def run(tmp_path, pool, cards, settle, method="monte-carlo"):
    path = tmp_path / "load.lib"
    path.write_text(f"* a load\n.subckt load p n out ref\n{BRIDGE}{cards}\n.ends\n")
    length = f"run={{duration=2.0, settle={settle}, seed=1, realizations=1}}"
    scene = Scene.read("device", [*DEVICE, f"load={{netlist='{path}'}}", length])
    result = simulate(scene, method=method, runner=pool)
    notes = [note for note in result.notes if "the store" in note]
    return result.quantities["output_voltage"], notes


@pytest.mark.exhaustive
def test_what_a_store_lacks_is_what_it_takes_later(tmp_path, pool):
    cards = "C1 out ref 8u\nR1 out ref 100meg"
    final, notes = run(tmp_path, pool, cards, 60.0)
    assert not notes
    # A tenth of what is compared.
    assert final.standard_error < 0.02 * final.estimate
    for settle, share in ((3.0, 0.2), (10.0, 0.1)):
        voltage, (note,) = run(tmp_path, pool, cards, settle)
        assert voltage.standard_error is None
        found = re.search(r"c1 .* still charges: its charge is up to (\S+) % away", note)
        lacking = float(found[1]) / 100.0
        assert lacking == pytest.approx(final.estimate / voltage.estimate - 1.0, rel=share)
    # What is missing after 30 s is less than the error bar.
    voltage, notes = run(tmp_path, pool, cards, 30.0)
    assert not notes
    assert abs(final.estimate - voltage.estimate) < voltage.standard_error


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", ["monte-carlo", "circuit"])
@pytest.mark.parametrize(
    "cards",
    [
        "Resr out s 10\nCs s ref 100u",
        "Vammeter out s 0\nCs s ref 100u",
        "Ca out m 200u\nCb m ref 200u",
    ],
)
def test_an_uncharged_store_behind_something_is_named(tmp_path, pool, method, cards):
    _, notes = run(tmp_path, pool, f"C1 out ref 1n\nR1 out ref 1meg\n{cards}", 3.0, method)
    assert len(notes) == 1
    assert "still charges" in notes[0]


def test_a_stray_capacitance_at_a_negative_voltage_is_not_the_store_that_charges():
    """The bridge's stray capacitor follows its storage, with the opposite sign."""
    excitation = 'excitation={kind="sine", amplitude=4.0, frequency=46.0}'
    scene = Scene.read(
        "cantilever",
        ["load.netlist=bridge", "load.parameters.storage=1m", "run.realizations=1", excitation],
    )
    (note,) = (each for each in simulate(scene, method="monte-carlo").notes if "store c" in each)
    assert note.startswith("the store cstorage")
    assert "still charges" in note
