"""Springs that a cubic does not follow, and the factor of the base, identified from records."""

import numpy as np
import pytest
from measured_records import band_noise, measured, scene_of

from harvester.identification.identify import identify
from harvester.identification.measurement import Measurement

# 10 g at 20 Hz; millimetres.
STIFFNESS, REACH, RATE = 0.01 * (2.0 * np.pi * 20.0) ** 2, 2e-3, 1000.0
PIEZO = {"piezo": {"coupling": 1e-3, "capacitance": 5e-8}}


def device(force):
    return scene_of(0.01, 0.03, force, PIEZO, 2e5)


def record(scene, seed, samples=8000, rms=12.0, outputs=("voltage",)):
    rng = np.random.default_rng(seed)
    return measured(scene, band_noise(rng, samples, RATE, 4.0, 60.0, rms), RATE, rng, outputs)


def near(fitted, key, truth):
    """Within 4 standard errors: one false alarm in 16 000."""
    place = fitted.keys.index(key)
    return abs(fitted.values[place] - truth) < 4.0 * fitted.standard_errors[place]


@pytest.mark.exhaustive
def test_a_softening_spring_is_proposed_with_its_range():
    force = [0.0, STIFFNESS, 0.0, -0.12 * STIFFNESS / REACH**2]
    truth = device([0.0, STIFFNESS])
    truth = truth.replace(
        {
            "oscillator.restoring_force": force,
            "oscillator.restoring_force_range": [-2.5 * REACH, 2.5 * REACH],
        }
    )
    start = device([0.0, STIFFNESS])
    found = identify(start, record(truth, 21, rms=4.0))
    assert found.proposed.name == "softening spring"
    made = found.proposed.fitted
    assert near(made, "oscillator.restoring_force[3]", force[3])
    low, high = made.scene.oscillator.restoring_force_range
    assert low < 0.0 < high
    assert "restoring_force_range" in found.scene_text(found.proposed)


@pytest.mark.exhaustive
def test_a_spring_of_the_fifth_power_is_proposed():
    force = [0.0, STIFFNESS, 0.0, -0.3 * STIFFNESS / REACH**2, 0.0, 0.25 * STIFFNESS / REACH**4]
    start = device([0.0, STIFFNESS, 0.0, 0.1 * STIFFNESS / REACH**2])
    found = identify(start, record(device(force), 22))
    assert found.proposed.name == "spring up to power 5"
    made = found.proposed.fitted
    for power in (1, 3, 5):
        assert near(made, f"oscillator.restoring_force[{power}]", force[power])


@pytest.mark.exhaustive
def test_the_bases_factor_is_found_where_the_sensors_scale_is_known():
    truth = device([0.0, STIFFNESS, 0.0, 0.4 * STIFFNESS / REACH**2])
    driven = record(truth, 23, outputs=("voltage", "displacement"))
    # The record's base moves less by the factor than what drives the mode.
    made = Measurement(
        driven.acceleration / 1.4, RATE, voltage=driven.voltage, displacement=driven.displacement
    )
    free = ["oscillator.damping", "oscillator.base_factor", "oscillator.restoring_force[1]"]
    found = identify(truth.replace({"oscillator.damping": 0.035}), made, free=free, compare=False)
    assert near(found.fitted, "oscillator.base_factor", 1.4)
    assert near(found.fitted, "oscillator.damping", 0.03)
    assert found.values["oscillator.base_factor"] == pytest.approx(1.4, rel=0.02)
    assert "accelerometer's scale" in found.scene_text()


@pytest.mark.exhaustive
def test_a_table_stays_as_it_is_and_the_rest_is_found():
    force = [0.0, STIFFNESS, 0.0, 0.4 * STIFFNESS / REACH**2]
    truth = device(force)
    x = np.linspace(-2.0 * REACH, 2.0 * REACH, 33)
    table = [[float(each), float(force[1] * each + force[3] * each**3)] for each in x]
    start = truth.replace({"oscillator.force_table": table, "oscillator.damping": 0.035})
    found = identify(start, record(truth, 24, samples=6000), compare=False)
    assert found.scene.oscillator.force_table == start.oscillator.force_table
    # The interpolation of the table is 3e-3 of the stiffness off, more than the record's noise.
    assert found.values["oscillator.damping"] == pytest.approx(0.03, rel=0.01)
    assert found.values["piezo.coupling"] == pytest.approx(1e-3, rel=0.01)
    assert found.values["piezo.capacitance"] == pytest.approx(5e-8, rel=0.01)
