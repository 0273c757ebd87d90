"""Identification from measured frequency responses, against closed forms written out here."""

import sys
from html import escape

import numpy as np
import pytest
from measured_records import off, scene_of

from harvester.base.errors import HarvesterError, IdentificationError, SceneError
from harvester.identification import posterior as sampling
from harvester.identification.identify import identify
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.measurement import read_measurement
from harvester.scene.numbers import numbers

MASS, DAMPING, RESISTANCE = 0.01, 0.05, 3e5
STIFFNESS = MASS * (2.0 * np.pi * 30.0) ** 2
PIEZO = {"coupling": 1.2e-3, "capacitance": 4e-8}
COIL = {"coupling": 9.0, "resistance": 300.0}
FREQUENCY = np.linspace(18.0, 48.0, 90)
# Standard errors of the truth that a value may lie off: one false alarm in 16 000 for each value.
SURE = 4.0


def linear():
    return scene_of(MASS, DAMPING, [0.0, STIFFNESS], {"piezo": PIEZO}, RESISTANCE)


def response(rng, noise=0.01):
    """V/a of the linear device: (k − Mω² + iωC + iωθ²/(iωCp + 1/R)) x = −M a."""
    rate = 2j * np.pi * FREQUENCY
    volts = rate * PIEZO["coupling"] / (rate * PIEZO["capacitance"] + 1.0 / RESISTANCE)
    stiffness = STIFFNESS + MASS * rate**2 + rate * DAMPING + PIEZO["coupling"] * volts
    true = -MASS * volts / stiffness
    size = noise * np.abs(true).max()
    return true + size * (rng.standard_normal(true.size) + 1j * rng.standard_normal(true.size))


def agree(found, truth):
    known = numbers(truth)
    for key, value in found.values.items():
        assert abs(value - known[key][0]) < SURE * found.standard_errors[key], key


@pytest.mark.slow
@pytest.mark.parametrize("parts", ["complex", "amplitude"])
def test_a_linear_device_is_found_from_its_response(parts):
    truth = linear()
    rng = np.random.default_rng(3)
    keys = ["oscillator.restoring_force[1]", "oscillator.damping", "piezo.coupling"]
    start = off(truth, keys, rng, 0.5)
    seen = response(rng)
    made = MeasuredResponse(FREQUENCY, seen if parts == "complex" else np.abs(seen))
    found = identify(start, made, free=keys)
    agree(found, truth)
    assert found.standard_errors[keys[0]] < 0.01 * STIFFNESS
    assert found.verdict.good
    if parts == "complex":
        assert "every third frequency" in found.texts()[".html"]
        assert len(found.figure().axes) == 2


@pytest.mark.exhaustive
def test_the_charge_that_the_base_moves_by_itself_is_in_the_response():
    # Q of a tenth of what the mass moves far below its resonance.
    charge = -0.1 * PIEZO["coupling"] * MASS / STIFFNESS
    truth = linear().replace({"piezo.base_charge": charge})
    rate = 2j * np.pi * FREQUENCY
    moved = 1.0 / (STIFFNESS + MASS * rate**2 + rate * DAMPING)
    volts = -rate * (PIEZO["coupling"] * MASS * moved + charge)
    volts /= 1.0 / RESISTANCE + rate * (PIEZO["capacitance"] + PIEZO["coupling"] ** 2 * moved)
    rng = np.random.default_rng(5)
    noise = rng.standard_normal(rate.size) + 1j * rng.standard_normal(rate.size)
    seen = MeasuredResponse(FREQUENCY, volts + 1e-3 * np.abs(volts).max() * noise)
    keys = ["oscillator.restoring_force[1]", "oscillator.damping", "piezo.coupling"]
    found = identify(off(truth, keys, rng, 0.3), seen, free=keys)
    agree(found, truth)
    assert found.verdict.good


@pytest.mark.slow
def test_a_response_at_a_known_amplitude_tells_the_cubic_spring():
    # Harmonic balance of a hardening coil device: [(k + 3/4 k3 a² − Mω²)² + ω²c²] a² = (M A)².
    cubic = STIFFNESS / 2e-3**2
    truth = scene_of(MASS, DAMPING, [0.0, STIFFNESS, 0.0, cubic], {"coil": COIL}, 600.0)
    base = 1.2
    rate = 2.0 * np.pi * FREQUENCY
    damping = DAMPING + COIL["coupling"] ** 2 / 900.0
    amplitude = []
    for w in rate:
        a, b = 0.75 * cubic, STIFFNESS - MASS * w**2
        squares = np.roots([a * a, 2.0 * a * b, b * b + (w * damping) ** 2, -((MASS * base) ** 2)])
        amplitude.append(np.sqrt(min(squares.real[np.abs(squares.imag) < 1e-9 * abs(squares)])))
    stiffness = STIFFNESS + 0.75 * cubic * np.array(amplitude) ** 2 - MASS * rate**2
    motion = -MASS / (stiffness + 1j * rate * damping)
    seen = 1j * rate * motion * COIL["coupling"] * 600.0 / 900.0
    rng = np.random.default_rng(4)
    size = 0.005 * np.abs(seen).max()
    seen = seen + size * (rng.standard_normal(90) + 1j * rng.standard_normal(90))
    keys = [f"oscillator.restoring_force[{n}]" for n in (1, 3)]
    made = MeasuredResponse(FREQUENCY, seen, np.full(90, base))
    found = identify(off(truth, keys, rng), made)
    agree(found, truth)
    assert found.standard_errors[keys[1]] < 0.1 * cubic
    # Without the amplitude the same curve has no linear device.
    plain = scene_of(MASS, DAMPING, [0.0, STIFFNESS], {"coil": COIL}, 600.0)
    assert not identify(plain, MeasuredResponse(FREQUENCY, seen)).verdict.good


@pytest.mark.exhaustive
def test_the_posterior_of_a_nearly_linear_problem_is_as_wide_as_the_intervals(monkeypatch):
    truth, keys = linear(), ["oscillator.damping", "piezo.coupling"]
    monkeypatch.setattr(sampling, "MOST_STEPS", 600)
    made = MeasuredResponse(FREQUENCY, response(np.random.default_rng(7)))
    found = identify(truth, made, free=keys, posterior=True)
    drawn = found.posterior
    assert drawn.independent > 100.0
    for key, (low, high) in drawn.intervals.items():
        error = found.standard_errors[key]
        # The quantiles of 100 independent draws scatter by a quarter of the standard error, and the
        # sandwich of 60 residuals by a tenth: three times that.
        assert abs(0.5 * (low + high) - found.values[key]) < 0.75 * error
        assert high - low == pytest.approx(3.92 * error, rel=0.4)
    content = found.to_dict()["posterior"]
    assert np.array(content["correlations"]).shape == (2, 2)
    assert len(found.table()[0]) == len(found.table()[1][0]) == 5
    assert escape("posterior's 95 %") in found.texts()[".html"]
    monkeypatch.setattr(sampling, "MOST_STEPS", sampling.STEPS)
    once, twice, other = (sampling.posterior(found.fitted, seed).draws for seed in (3, 3, 4))
    assert np.array_equal(once, twice)
    assert not np.array_equal(once, other)
    monkeypatch.setitem(sys.modules, "emcee", None)
    with pytest.raises(HarvesterError, match=r"posterior needs emcee: pip install"):
        sampling.posterior(found.fitted)


def test_columns_of_a_response_have_units(tmp_path):
    seen = response(np.random.default_rng(1))
    polar = np.column_stack(
        [FREQUENCY, 9.80665e3 * np.abs(seen), np.degrees(np.angle(seen)), 0.1 + 0.0 * FREQUENCY]
    )
    file = tmp_path / "polar.csv"
    header = "frequency [Hz],voltage amplitude [mV/g],phase [deg],acceleration [g]"
    np.savetxt(file, polar, delimiter=",", header=header, comments="")
    read = read_measurement(file, {"load.resistance": 2e5})
    assert read.response == pytest.approx(seen)
    assert read.acceleration == pytest.approx(0.980665)
    assert read.changes == {"load.resistance": 2e5}
    np.save(tmp_path / "parts.npy", np.column_stack([FREQUENCY, seen.real, seen.imag]))
    units = {"frequency": "0:Hz", "real": "1:V/(m/s^2)", "imaginary": "2:V/(m/s²)"}
    assert read_measurement(tmp_path / "parts.npy", units).response == pytest.approx(seen)
    with pytest.raises(SceneError, match=r"amplitude has no unit"):
        read_measurement(tmp_path / "parts.npy", {"frequency": "0:Hz", "amplitude": "1"})
    with pytest.raises(SceneError, match=r"no column of the response"):
        read_measurement(tmp_path / "parts.npy", {"frequency": "0:Hz"})


def test_responses_that_tell_nothing_are_refused():
    seen, truth = response(np.random.default_rng(2)), linear()
    stoppers = {"gap": 1e-3, "stiffness": 1e5, "restitution": 0.7}
    whole = MeasuredResponse(FREQUENCY, seen)
    for made, scene, words in (
        (MeasuredResponse(FREQUENCY[:40:4], seen[:40:4]), truth, "too short: 10 frequencies"),
        (MeasuredResponse(FREQUENCY[:30], seen[:30]), truth, "where the record ends"),
        (whole, truth.replace(stoppers=stoppers), "cannot determine stoppers"),
    ):
        with pytest.raises(IdentificationError, match=words):
            identify(scene, made)
    with pytest.raises(SceneError, match="must be monotonic"):
        MeasuredResponse(np.abs(FREQUENCY - FREQUENCY.mean()) + 1.0, seen)
    for lines in ([], [[1.0, 2.0]]):
        with pytest.raises(
            SceneError, match=r"frequency has the shape .*: must be a list of numbers"
        ):
            MeasuredResponse(lines, lines)
    downwards = MeasuredResponse(list(FREQUENCY[::-1]), seen[::-1])
    np.testing.assert_array_equal(downwards.frequency, FREQUENCY)
    np.testing.assert_array_equal(downwards.response, seen)


@pytest.mark.parametrize("turned", [1.0, -1.0, 1j])
def test_a_conjugated_response_is_told_by_its_rising_phase(turned):
    """Whatever the polarity or a constant phase of the sensor; a phase of noise is not refused."""
    rng = np.random.default_rng(8)
    seen = turned * response(rng, 0.05)
    MeasuredResponse(FREQUENCY, seen).check()
    with pytest.raises(IdentificationError, match=r"the response is conjugated; reverse the sign"):
        MeasuredResponse(FREQUENCY, seen.conj()).check()
    phases = np.exp(2j * np.pi * rng.random(FREQUENCY.size))
    MeasuredResponse(FREQUENCY, np.abs(seen) * phases).check()
    MeasuredResponse(FREQUENCY, np.abs(seen)).check()
