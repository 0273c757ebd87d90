"""Rounded, drifting and jittering time stamps of a sine whose amplitude is known."""

import numpy as np
import pytest

from harvester.base.errors import SceneError
from harvester.excitation.recorded import RecordedMotion, one_pass
from harvester.identification.measurement import read_measurement

RATE, COUNT, FREQUENCY = 360.0, 7200, 46.0
TIMES = np.arange(COUNT) / RATE
KEPT = np.ones(COUNT, bool)
KEPT[[*range(2000, 2030), 5000]] = False


def wave(times):
    return 2.0 * np.sin(2.0 * np.pi * FREQUENCY * times)


def drifting(spacings):
    return TIMES + spacings / RATE * np.sin(2.0 * np.pi * TIMES / 25.0)


def jittering(share):
    return TIMES + share / RATE * np.random.default_rng(1).uniform(-1.0, 1.0, COUNT)


# Stamps, true times, and whether it takes mend = ["uneven"].
STAMPS = {
    "to 1 ms": (np.round(TIMES, 3), TIMES, False),
    "cut to 1 ms": (np.floor(1e3 * TIMES) / 1e3, TIMES, False),
    "milliseconds of an epoch": (np.round(TIMES + 1.7e9, 3), TIMES, False),
    "ticks of 1/128 s": (np.round(128.0 * TIMES) / 128.0, TIMES, False),
    "to 10 ms, equal ones": (np.round(TIMES, 2), TIMES, False),
    "drift": (drifting(2.5), drifting(2.5), False),
    "drift, to 1 ms": (np.round(drifting(2.5), 3), drifting(2.5), False),
    "gap, to 1 ms": (np.round(TIMES, 3)[KEPT], TIMES[KEPT], True),
    "taken unevenly": (jittering(0.25), jittering(0.25), True),
}


def saved(folder, stamps, values):
    path = folder / "a.npy"
    np.save(path, np.column_stack([stamps, values]))
    return str(path)


def power(values, interval):
    """Power of the sine in the middle of a record, as a share of the true one."""
    middle = slice(values.size // 20, -values.size // 20)
    phase = 2.0 * np.pi * FREQUENCY * interval * np.arange(values.size)
    basis = np.column_stack([np.sin(phase), np.cos(phase)])[middle]
    found = np.linalg.lstsq(basis, values[middle], rcond=None)[0]
    return float(found @ found) / 4.0


@pytest.mark.parametrize("name", STAMPS)
def test_the_sine_is_found_at_its_frequency_with_its_power(tmp_path, name):
    stamps, times, mended = STAMPS[name]
    path = saved(tmp_path, stamps, wave(times))
    keys = {"unit": "m/s^2", "column": 1, "time_column": 0}
    if mended:
        with pytest.raises(SceneError, match="uneven"):
            assert RecordedMotion(path, **keys).samples.size
        keys["mend"] = ("uneven",)
    values, interval, remarks = one_pass(RecordedMotion(path, **keys))
    assert 1.0 / interval == pytest.approx(RATE, rel=2e-3 if "drift" in name else 1e-5)
    assert power(values, interval) == pytest.approx(1.0, abs=0.01)
    assert any(word in remarks[0] for word in ("rounded", "drifts", "interpolated"))


def test_stamps_too_coarse_for_a_rate_need_one(tmp_path):
    path = saved(tmp_path, np.floor(TIMES), wave(TIMES))
    keys = {"unit": "m/s^2", "column": 1, "time_column": 0}
    with pytest.raises(SceneError, match="does not rise"):
        assert RecordedMotion(path, **keys).samples.size
    found = RecordedMotion(path, sampling_rate=RATE, **keys)
    np.testing.assert_allclose(found.samples, wave(TIMES), atol=1e-3)


@pytest.mark.parametrize("name", ["to 1 ms", "drift"])
def test_identification_has_the_same_time_base(tmp_path, name):
    stamps, times, _ = STAMPS[name]
    table = np.column_stack([stamps, wave(times), 3.0 * wave(times)])
    np.savetxt(tmp_path / "a.csv", table, "%.9g", ",", header="t [s],a [m/s^2],voltage [V]")
    read = read_measurement(tmp_path / "a.csv")
    assert power(read.voltage, 1.0 / read.sampling_rate) == pytest.approx(9.0, rel=0.01)
    assert any("rounded" in remark or "drifts" in remark for remark in read.remarks)
