"""Step loads without a hysteresis: named with the cure, which runs."""

import pytest

from circuits.netlist.part_values import jumping_sources
from harvester.base.errors import LoadChatters
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

BRIDGE = """.model m4148 d(is=2.52n rs=.568 n=1.752 cjo=4p m=.4 tt=20n bv=75)
D1 p out m4148
D2 n out m4148
D3 ref p m4148
D4 ref n m4148
C1 out ref 1u
R1 out ref 100meg
"""
SETS = [
    "oscillator={mass=0.022, damping=0.2, linear_stiffness=63.451, cubic_stiffness=0.0}",
    "piezo={coupling=3.69e-4, capacitance=4.3e-8}",
    "excitation={kind='sine', amplitude=4.0, frequency=8.5}",
    "run={duration=0.5, settle=0.5, seed=1, realizations=1}",
]
STEP = "B1 out ref I = V(out,ref) > 8 ? 150u : 0"
SMOOTH = "B1 out ref I = 150u*0.5*(1+tanh((V(out,ref)-8)/5m))"


def scene(tmp_path, card):
    path = tmp_path / "load.lib"
    path.write_text(f"* a load\n.subckt load p n out ref\n{BRIDGE}{card}\n.ends\n")
    return Scene.read("device", [*SETS, f"load={{netlist='{path}'}}"])


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", ["monte-carlo", "circuit"])
def test_a_step_load_that_chatters_is_named(tmp_path, pool, method):
    with pytest.raises(LoadChatters, match=r"b1 \(load\.lib:10\) chatters: .*hysteresis.*tanh"):
        simulate(scene(tmp_path, STEP), method=method, runner=pool)


@pytest.mark.exhaustive
def test_its_cure_holds_the_threshold(tmp_path, pool):
    result = simulate(scene(tmp_path, SMOOTH), method="monte-carlo", runner=pool)
    assert result.quantities["output_voltage"].estimate == pytest.approx(8.0, rel=2e-3)


def test_sources_that_may_jump_are_known(tmp_path):
    cards = {
        STEP: 1,
        SMOOTH: 0,
        "B1 out ref I = 1u*u(V(out,ref)-8)": 1,
        "B1 out ref I=V(out)*1u": 0,
    }
    for card, count in cards.items():
        assert len(jumping_sources(scene(tmp_path, card).load.circuit.elements)) == count
