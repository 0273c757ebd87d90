"""How a load's stores relax, against closed forms of their networks."""

import numpy as np
import pytest

from circuits.kernel.slow_modes import relaxation, slowest_time
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

BRIDGE = """.model sch d(is=200n n=1.05 rs=10 cjo=5p)
D1 p out sch
D2 ref p sch
D3 n out sch
D4 ref n sch
"""


def scene(tmp_path, cards, bridge=BRIDGE):
    path = tmp_path / "load.lib"
    path.write_text(f"* a load\n.subckt load p n out ref\n{bridge}{cards}\n.ends\n")
    return Scene.read("device", [f"load.netlist={path}"])


@pytest.mark.parametrize(
    ("cards", "seconds"),
    [
        ("C1 out ref 1n\nResr out s 10\nCs s ref 100u\nR1 out ref 1meg", 100.0),
        ("C1 out ref 1n\nVam out s 0\nCs s ref 100u\nR1 out ref 1meg", 100.0),
        ("C1 out ref 1n\nCa out m 200u\nCb m ref 200u\nR1 out ref 1meg", 100.0),
        ("C1 out ref 1n\nL1 out s 1\nCs s ref 50u\nR1 out ref 1meg", 50.0),
        # Nothing but diodes discharges it.
        ("C1 out ref 100u", 0.0),
    ],
)
def test_a_store_behind_anything_in_series_has_its_time(tmp_path, cards, seconds):
    assert slowest_time(prepared(scene(tmp_path, cards))) == pytest.approx(seconds, rel=1e-3)


def test_a_diode_that_conducts_on_average_is_part_of_it(tmp_path):
    """A Zener at its breakdown: its slope is its current over the thermal voltage, and 5 Ω."""
    cards = ".model zen d(is=1e-12 rs=5 bv=8 ibv=1m)\nDz ref out zen\nC1 out ref 8u\nR1 out ref 1g"
    made = scene(tmp_path, cards)
    levels = dict.fromkeys(made.load.circuit.levels, 0.0)
    times = {}
    for volts in (4.0, 8.0):
        levels.update(out=0.5 * volts, ref=-0.5 * volts)
        ends = np.array([{"out": 1.0, "ref": -1.0}.get(name, 0.0) for name in levels])
        times[volts] = ends @ relaxation(prepared(made), levels) @ ends / 2.0
    thermal = 1.380649e-23 * 300.15 / 1.602176634e-19
    assert times[8.0] == pytest.approx(8e-6 * (thermal / 1e-3 + 5.0), rel=0.01)
    assert times[4.0] > 1e3


def test_what_is_missing_follows_from_the_rates(tmp_path):
    """Two stores, 1 and 2 µF, with 1 and 3 MΩ in a chain: V∞ − V = G⁻¹ C dV/dt, by hand."""
    cards = "C1 out ref 1u\nR1 out ref 1meg\nR2 out s 3meg\nC2 s ref 2u"
    made = scene(tmp_path, cards)
    levels = dict.fromkeys(made.load.circuit.levels, 0.0) | {"out": 5.0, "ref": -5.0, "s": 5.0}
    rates = np.array([{"out": 0.5, "ref": -0.5, "s": 0.0}.get(name, 0.0) for name in levels])
    shift = dict(zip(levels, relaxation(prepared(made), levels) @ rates, strict=True))
    # C1 takes 1 V/s · 1 µF and C2 0.5 V/s · 2 µF, both through R1, C2's through R2 as well.
    assert shift["out"] - shift["ref"] == pytest.approx(2.0, rel=1e-3)
    assert shift["s"] - shift["ref"] == pytest.approx(2.0 + 3.0, rel=1e-3)


def test_all_stores_share_one_decomposition(tmp_path, monkeypatch):
    """A ladder of 40 sections: its slowest time from the closed form of a chain with open end."""
    count, resistance, capacitance = 40, 1e3, 1e-6
    names = ["out", *(f"a{k}" for k in range(1, count)), "ref"]
    cards = [f"R{k} {names[k]} {names[k + 1]} {resistance}" for k in range(count - 1)]
    cards += [f"C{k} {names[k]} ref {capacitance}" for k in range(1, count)]
    cards.append(f"Rs out ref {1e-3 * resistance}")
    made = scene(tmp_path, "\n".join(cards))
    calls, real = [], np.linalg.eig
    monkeypatch.setattr(np.linalg, "eig", lambda matrix: calls.append(0) or real(matrix))
    found = slowest_time(prepared(made))
    assert len(calls) == 1
    rate = 4.0 * np.sin(0.5 * np.pi / (2 * (count - 1) + 1)) ** 2 / (resistance * capacitance)
    assert found == pytest.approx(1.0 / rate, rel=1e-3)
