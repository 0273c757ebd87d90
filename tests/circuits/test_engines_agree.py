"""Circuit and Monte Carlo on the same noise: means within the errors of their differences."""

import math

import pytest
from device_scenes import DEVICES, SCALED

from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.statistics.paired import paired_difference

EACH = [
    pytest.param("bias and quadratic term", marks=pytest.mark.exhaustive),
    pytest.param("tristable, degree 5", marks=pytest.mark.exhaustive),
    pytest.param("one-sided stopper", marks=pytest.mark.exhaustive),
    pytest.param("uneven stoppers", marks=pytest.mark.slow),
    pytest.param("quadratic damping", marks=pytest.mark.exhaustive),
]
COMPARED = (
    "mean_square_displacement",
    "mean_square_velocity",
    "mean_square_voltage",
    "mean_power",
    "mean_input_power",
    "mean_loss_power",
    "power_conversion_efficiency",
)
# So much that two paths on the same noise stay together, and their difference has a small error.
DAMPING = 0.8
# Standard error of the steps, as a share: of second order, 16 times less than the default ones'.
STEP_ERROR = 2e-4


@pytest.mark.parametrize("name", EACH)
def test_the_means_of_circuit_and_monte_carlo_agree(pool, name):
    """Within 3 joint standard errors of at most 0.5 %; false alarm under 2 % for the seven."""
    tables = {**SCALED, **DEVICES[name]}
    tables["oscillator"] = {**tables["oscillator"], "damping": DAMPING}
    tables["run"] = {"duration": 40.0, "settle": 10.0, "seed": 5, "realizations": 32}
    scene = Scene.from_tables(tables, name=name)
    circuit = simulate(scene, method="circuit", step="fine", runner=pool)
    monte_carlo = simulate(scene, method="monte-carlo", step="fine", runner=pool)
    differences = paired_difference(circuit, monte_carlo)
    for quantity in COMPARED:
        difference = differences[quantity]
        joint_error = math.hypot(difference.standard_error, STEP_ERROR)
        assert joint_error < 0.005, quantity
        assert abs(difference.estimate) < 3.0 * joint_error, quantity


LOCKOUT = """* rectifier, rail, under-voltage lockout, and no capacitor at the output
.subckt lockout p n out ref
.model dd d(is=2.52n n=1.752 rs=0.568 cjo=4p tt=20n)
D1 p rail dd
D2 ref p dd
D3 n rail dd
D4 ref n dd
Crail rail ref 0.42u
B1 rail reg V=max(v(rail,ref)-1.8,0)
S1 reg out rail ref uv
.model uv sw vt=4 vh=1 ron=10 roff=100meg
Rload out ref 3k
.ends
"""


@pytest.mark.slow
def test_an_output_without_a_capacitor_does_not_ring_behind_an_open_switch(pool, tmp_path):
    """On a stray capacitance of its own it did: twice the peak, and 20 % more power."""
    path = tmp_path / "lockout.lib"
    path.write_text(LOCKOUT)
    tables = {
        "units": "SI",
        "oscillator": {"mass": 0.0421, "damping": 0.372, "restoring_force": [0.0, 647.0]},
        "piezo": {"coupling": 7.47e-4, "capacitance": 2.85e-8},
        "load": {"netlist": str(path)},
        "excitation": {"kind": "sine", "amplitude": 1.0, "frequency": 19.7},
        "run": {"settle": 0.0, "duration": 1.0},
    }
    scene = Scene.from_tables(tables, name="lockout")
    found = simulate(scene, method="circuit", runner=pool)
    # While the switch is closed the output has 1.8 V, less what the switch takes; else it has 0.
    closed = 1.8 * 3000.0 / 3010.0
    assert found["output_peak_to_peak"].estimate == pytest.approx(closed, rel=1e-3)
    power = found["output_voltage"].estimate * closed / 3000.0
    assert found["mean_output_power"].estimate == pytest.approx(power, rel=1e-3)


@pytest.mark.parametrize(
    ("elements", "pins"),
    [
        ("S1 rail out rail ref uv\n.model uv sw vt=4 vh=1\nRload out ref 3k", ("ref",)),
        # A controlled current behind a sense resistor feeds the output: its loop needs a memory.
        ("B1 rail vo I=1m*v(rail,vo)\nRo vo out 1\nRload out ref 3k", ("out", "ref")),
        # With a capacitor the stray capacitance is not alone, and all diodes may block.
        ("R1 rail out 10\nCout out ref 1u\nRload out ref 3k", ("out", "ref")),
    ],
)
def test_an_output_has_a_stray_capacitance_where_nothing_else_holds_it(tmp_path, elements, pins):
    path = tmp_path / "load.lib"
    bridge = LOCKOUT.partition("B1")[0].replace("lockout", "load")
    path.write_text(f"{bridge}{elements}\n.ends\n")
    scene = Scene.read("device", [f'load.netlist="{path}"'])
    assert scene.load.circuit.stray_pins == pins
