"""How well the compiled engine knows a switch's control, against scipy on the equations."""

import functools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from circuits.kernel.engine import circuit_of, integrate
from circuits.kernel.memory import SLOTS
from circuits.kernel.stage import fresh_state, slot_of
from circuits.kernel.switching import switched, turn
from harvester.base.compilation import compiled
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import steps_per_sample

# A diode's breakdown behind a coil clamps the piezo, whose voltage then falls by a tenth of a volt
# while it rings: a switch sees the slope.
CLAMPED = """* a switch that closes where the slope of a clamped voltage rings far enough below zero
.subckt clamped p n out ref gain=1
.model clamp d(is=2.5n n=1.75 bv=100 ibv=10u)
.model gate sw(vt=0 vh=30 ron=1 roff=1g)
L1 p a 94m
R1 a b 740
R2 p b 300k
C2 b n 1p ic=97
D1 n b clamp
C3 p sense 10p
R3 sense n 10meg
E1 control n n sense {gain}
S1 one out control n gate
V1 one n 1
R4 ref n 1
R5 out ref 1k
.ends
"""
START = {"displacement": -5e-3, "velocity": 0.3, "voltage": 97.0}
STOP = 4e-3


@functools.cache
def deepest_slope():
    """The lowest voltage of `sense`, V: of the scene's equations without noise."""
    swing = 1.75 * 1.380649e-23 * 300.15 / 1.602176634e-19
    breaking = 2.5e-9 * (1.0 + 10e-6 / 2.5e-9) ** (1.0 / 1.75)

    def rates(_, y):
        x, v, piezo, coil, clamp, sense = y
        through = coil + (piezo - clamp) / 300e3
        rise = (3.69e-4 * v - through - sense / 10e6) / 43e-9
        let_through = 2.5e-9 + 1e-12 * clamp + breaking * math.exp((clamp - 100.0) / swing)
        return [
            v,
            (63.451 * x - 634509.0 * x**3 - 0.03342 * v - 3.69e-4 * piezo) / 0.022,
            rise,
            (piezo - 740.0 * coil - clamp) / 94e-3,
            (through - let_through) / 1e-12,
            rise - sense / 1e-4,
        ]

    start = [START["displacement"], START["velocity"], START["voltage"], 0.0, 97.0, 0.0]
    path = solve_ivp(
        rates, (0.0, STOP), start, method="Radau", rtol=1e-9, atol=1e-12, max_step=2e-6
    )
    assert path.y[2].max() > 100.3
    return path.y[5].min()


@pytest.mark.parametrize(("step", "known"), [("default", 0.05), ("fine", 0.02), ("finest", 0.005)])
def test_a_ringing_turns_a_switch_where_it_passes_its_threshold(step, known, tmp_path):
    """By so little more it closes, by so little less it does not."""
    netlist = tmp_path / "clamped.lib"
    netlist.write_text(CLAMPED)
    for share in (1.0 - known, 1.0 + known):
        gain = float(-30.0 * share / deepest_slope())
        scene = Scene.read("device").replace(
            {
                "load": {"netlist": str(netlist), "parameters": {"gain": gain}},
                "start": START,
                "excitation.intensity": 1e-20,
                "run.settle": 0,
                "run.duration": 0.8,
            }
        )
        ready = prepared(scene)
        s, scales = ready.system, ready.scales
        fixed = steps_per_sample(prepared(scene), step, "monte-carlo")
        refinement = fixed / steps_per_sample(prepared(scene), engine="monte-carlo")
        path, start = noise_path(prepared(scene), 0), start_state(prepared(scene), 0)
        chunks = [
            np.array([record.time, volts])
            for record, (volts, *_) in integrate(
                s, circuit_of(prepared(scene)), path, start, STOP, fixed, refinement=refinement
            )
        ]
        time, volts = np.concatenate(chunks, axis=1)
        closed = volts[time < STOP].max() * scales.voltage > 0.5
        assert closed == (share > 1.0)


@pytest.mark.parametrize(
    ("closed", "control", "change", "share"),
    [
        # It closes above 0.7 and opens below 0.3.
        (0, 0.6, 0.4, 0.25),
        (0, 0.2, 0.4, None),
        (0, 0.9, 0.1, 0.0),
        (1, 0.6, -0.4, 0.75),
        (1, 0.6, -0.2, None),
        (1, 0.9, 0.4, None),
    ],
)
def test_a_switch_turns_beyond_its_hysteresis_and_when_its_control_passes_it(
    closed, control, change, share
):
    """The control is the difference of two voltages that change linearly in a step."""
    tables = SimpleNamespace(
        switches=np.array([[0, -1, 0, 1]]), switch_values=np.array([[1e-9, 1.0, 0.3, 0.7]])
    )
    state = SimpleNamespace(
        y=np.array([control + 5.0, 5.0]),
        change=np.array([change + 2.0, 2.0]),
        closed=np.array([closed]),
    )
    first, when = switched(tables, state)
    assert (first == 0) == (share is not None)
    if share is not None:
        assert when == pytest.approx(share)
    state.y += state.change
    turn(tables, state)
    assert state.closed[0] == (closed if share is None else 1 - closed)


def sixty_switches(folder):
    """A load of sixty switches; the first and the last ones close at the lowest voltages."""
    lines = [".subckt sixty p n"]
    for k in range(60):
        threshold = 0.02 * (60 - k) if k else 0.01
        resistance = 5e3 * (60 - k) if k else 1e7
        lines += [
            f".model s{k} sw(vt={threshold} vh=0.002 ron=1k roff=1g)",
            f"S{k} p m{k} p n s{k}",
            f"R{k} m{k} n {resistance}",
        ]
    path = folder / "sixty.lib"
    path.write_text("\n".join([*lines, "R60 p n 1meg", ".ends"]) + "\n")
    sine = "excitation={kind='sine', amplitude=3.0, frequency=20.0}"
    run = ["run.duration=0.2", "run.settle=0.05", "run.realizations=1"]
    return Scene.read("device", [f"load.netlist={path}", sine, *run])


# The next test shows the same in `make test`, by what a load does.
@pytest.mark.exhaustive
def test_each_state_of_sixty_switches_has_factors_of_its_own(tmp_path):
    """A float64 holds 53 states only: the last switches shared the factors of a wrong state."""
    find = compiled(lambda tables, state, delta: slot_of(tables, state, delta))
    circuit = circuit_of(prepared(sixty_switches(tmp_path)))
    state = fresh_state(circuit)
    state.keys[:SLOTS] = np.nan
    state.closed[0] = 1
    addresses = []
    for last in (0, 1, 0):
        state.closed[-1] = last
        addresses.append(find(circuit.tables, state, 1e-5))
    assert addresses[0] == addresses[2] != addresses[1]


@pytest.mark.slow
def test_sixty_switches_as_by_ngspice(tmp_path, pool):
    scene = sixty_switches(tmp_path)
    compiled, circuit = (
        simulate(scene, method=method, runner=pool) for method in ("monte-carlo", "circuit")
    )
    assert abs(circuit.energy_balance_residual) < 5e-3
    power = circuit["mean_power"].estimate
    assert compiled["mean_power"].estimate == pytest.approx(power, rel=0.01)
