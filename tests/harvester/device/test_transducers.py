"""The transducers' scaled equations against their circuits in SI units, written out here."""

import numpy as np
import pytest

from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

MASS, COUPLING, WINDING, LOAD = 0.0103, 14.9, 391.0, 1400.0
CAPACITANCE, LEAK = 5e-8, 3e6
FREQUENCY = 40.0  # rad/s


def states():
    """Velocity (m/s) and a current or voltage."""
    return np.random.default_rng(6).normal(size=(20, 2))


def made(scene):
    ready = prepared(scene)
    system, scales = ready.system, ready.scales
    return system.transducer, scales, MASS * scales.displacement


@pytest.mark.parametrize("inductance", [0.0, 0.8])
def test_a_coil_drives_its_current_through_winding_and_load(inductance):
    changes = [f"oscillator.mass={MASS}", f"coil.coupling={COUPLING}", f"coil.resistance={WINDING}"]
    changes += [f"coil.inductance={inductance}", f"load.resistance={LOAD}"]
    coil, scales, push = made(Scene.read("electromagnetic", changes))
    length = scales.displacement
    for velocity, current in states():
        if inductance == 0.0:
            current = COUPLING * velocity / (WINDING + LOAD)
        v, state = velocity / length, inductance * current / (COUPLING * length)
        rise = COUPLING * velocity - (WINDING + LOAD) * current
        assert coil.state_rate(v, state) == pytest.approx(rise / (COUPLING * length), abs=1e-9)
        assert coil.force(v, state) == pytest.approx(COUPLING * current / push)
        assert coil.voltage(v, state) * scales.voltage == pytest.approx(LOAD * current)
        power = LOAD * current**2
        assert coil.load_power(v, state) * scales.power == pytest.approx(power)
        loss = coil.loss(v, state, coil.current(v, state)) * scales.power
        assert loss == pytest.approx(WINDING * current**2)
        stored = 0.5 * inductance * current**2
        assert coil.stored_energy(state) * scales.power == pytest.approx(stored)
    assert not coil.lossless
    impedance = WINDING + LOAD + 1j * FREQUENCY * inductance
    assert coil.loss_rate(FREQUENCY) == pytest.approx((COUPLING**2 / MASS / impedance).real)


@pytest.mark.parametrize("leak", [None, LEAK])
def test_a_piezo_charges_its_capacitance_beside_load_and_leak(leak):
    theta, load = 4e-4, 2e5
    piezo = {"coupling": theta, "capacitance": CAPACITANCE}
    piezo |= {"leakage_resistance": leak} if leak else {}
    tables = Scene.read("paper_si").to_tables() | {"piezo": piezo}
    scene = Scene.from_tables(tables).replace(
        {"oscillator.mass": MASS, "load.resistance": load, "oscillator.linear_stiffness": 4.0}
    )
    part, scales, push = made(scene)
    length, leaking = scales.displacement, 1.0 / leak if leak else 0.0
    for velocity, volts in states():
        v, state = velocity / length, volts / scales.voltage
        rise = (theta * velocity - volts * (1.0 / load + leaking)) / CAPACITANCE
        assert part.state_rate(v, state) * scales.voltage == pytest.approx(rise)
        assert part.force(v, state) == pytest.approx(theta * volts / push)
        assert part.voltage(v, state) * scales.voltage == pytest.approx(volts)
        assert part.load_power(v, state) * scales.power == pytest.approx(volts**2 / load)
        assert part.loss(v, state, 0.0) * scales.power == pytest.approx(volts**2 * leaking)
        stored = 0.5 * CAPACITANCE * volts**2
        assert part.stored_energy(state) * scales.power == pytest.approx(stored)
    assert part.lossless == (leak is None)
    admittance = 1.0 / load + leaking + 1j * FREQUENCY * CAPACITANCE
    assert part.loss_rate(FREQUENCY) == pytest.approx((theta**2 / MASS / admittance).real)
    assert part.stiffness(4.0) == pytest.approx(theta**2 / (MASS * CAPACITANCE))
