"""A device stepped by hand, against scipy and against electronics on its own terminals."""

import numpy as np
import pytest
from device_scenes import COIL, MAGNETS
from device_truths import written_path
from driven_fmus import base_acceleration, deviation
from scipy.integrate import solve_ivp

import harvester
from harvester.base.errors import HarvesterError, SpringRangeLeft

STOPPERS = [
    {"side": side, "gap": gap, "stiffness": 3e5, "restitution": 0.6, "impact_velocity": "event"}
    for side, gap in (("right", 1.1e-3), ("left", 1.2e-3))
]
# The magnets' table with wells at about a millimetre, between stoppers that hold the speed.
TABLE = {
    "units": "SI",
    "oscillator": {
        "mass": 0.02, "damping": 0.02, "force_table": [[1e-3 * x, 0.1 * f] for x, f in MAGNETS],
    },
    "stoppers": STOPPERS,
    "piezo": {"coupling": 4e-4, "capacitance": 4e-8},
    "load": {"resistance": 3e5},
    "excitation": {"kind": "ornstein-uhlenbeck", "intensity": 0.2, "correlation_time": 0.01},
    "run": {"duration": 2.0, "seed": 6},
}  # fmt: skip
INDUCTIVE = {**COIL, "coil": {"coupling": 4.0, "resistance": 100.0, "inductance": 0.05}}
RESISTIVE = {**COIL, "coil": {"coupling": 4.0, "resistance": 100.0, "inductance": 0.0}}


def follow(scene, knots):
    """(X, X') at the knots, the load's resistor at the terminals; and the last energies."""
    from harvester.scene.prepared import prepared
    from harvester.scene.steps import knot_spacing

    device = harvester.coupled(scene, load_resistance=scene.load.resistance)
    spacing, rows = knot_spacing(prepared(scene)), [(device.displacement, device.velocity)]
    for k in range(knots):
        device.advance((k + 1) * spacing)
        rows.append((device.displacement, device.velocity))
    return np.array(rows), device.energies


@pytest.mark.slow
def test_table_between_stoppers_that_hold_the_speed():
    scene = harvester.Scene.from_tables(TABLE, "table")
    found, energies = follow(scene, 150)
    truth = written_path(scene, 150)
    assert deviation(found[:, 0], truth[:, 0]) < 1e-5
    assert deviation(found[:, 1], truth[:, 1]) < 3e-5
    assert energies.contacts > 0.02 * energies.input
    assert sum(energies[1:]) == pytest.approx(energies.input, rel=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("tables", [INDUCTIVE, RESISTIVE], ids=["inductive", "resistive"])
def test_coils(tables):
    tables = {key: value for key, value in tables.items() if value is not None}
    scene = harvester.Scene.from_tables(tables, "coil")
    found, energies = follow(scene, 400)
    assert deviation(found[:, 0], written_path(scene, 400)[:, 0]) < 1e-6
    assert sum(energies[1:]) == pytest.approx(energies.input, rel=1e-6)
    assert energies.transducer / energies.delivered == pytest.approx(100.0 / 300.0, rel=1e-3)


@pytest.mark.exhaustive
def test_a_resistor_outside_is_of_first_order_in_the_exchange():
    """A current held over an exchange lags; the truth has the resistor at the terminals."""
    scene = harvester.Scene.read("one_sided")
    inside = harvester.coupled(scene, load_resistance=1e6)
    inside.advance(0.5)
    errors = []
    for length in (1e-3, 5e-4):
        outside = harvester.coupled(scene)
        for k in range(round(0.5 / length)):
            outside.advance((k + 1) * length, outside.voltage / 1e6)
        errors.append(abs(outside.voltage - inside.voltage))
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.3)


@pytest.mark.exhaustive
def test_the_end_of_the_springs_range_ends_it():
    scene = harvester.Scene.read("one_sided").replace(
        {"oscillator.restoring_force_range": [-1e-4, 1e-4]}, stoppers=None
    )
    device = harvester.coupled(scene)
    with pytest.raises(SpringRangeLeft, match="range"):
        device.advance(5.0)
    with pytest.raises(HarvesterError, match="give a time ≥"):
        device.advance(0.0)


@pytest.mark.exhaustive
def test_charge_that_the_base_moves():
    """A drawn beam, whose other modes charge the piezo with the base's acceleration."""
    scene, knots = harvester.Scene.read("bimorph"), 200
    table, oscillator, load = scene.transducer, scene.oscillator, scene.load.resistance
    assert table.base_charge
    device = harvester.coupled(scene, load_resistance=load)
    times, base = base_acceleration(scene, 0.05)
    stiffness = oscillator.coefficients[1]

    def voltage(t, state):
        return state - table.base_charge * np.interp(t, times, base) / table.capacitance

    def rates(t, y):
        x, v, state = y
        force = oscillator.damping * v + stiffness * x + table.coupling * voltage(t, state)
        drive = -oscillator.base_factor * np.interp(t, times, base)
        current = voltage(t, state) / load
        return [
            v,
            drive - force / oscillator.mass,
            (table.coupling * v - current) / table.capacitance,
        ]

    y = np.zeros(3)
    for k in range(knots):
        y = solve_ivp(rates, times[k : k + 2], y, "DOP853", rtol=1e-10, atol=1e-14).y[:, -1]
    device.advance(times[knots])
    assert device.displacement == pytest.approx(y[0], rel=1e-6)
    assert device.voltage == pytest.approx(voltage(times[knots], y[2]), rel=1e-6)
    assert sum(device.energies[1:]) == pytest.approx(device.energies.input, rel=1e-6)
