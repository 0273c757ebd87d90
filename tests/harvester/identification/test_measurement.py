"""Reading of measured records: columns, units, refusals."""

import numpy as np
import pytest
from scipy.io import savemat

from harvester.base.errors import SceneError
from harvester.identification.measurement import read_measurement

RATE = 500.0
TIMES = np.arange(400) / RATE
ACCELERATION, VOLTAGE = np.sin(30.0 * TIMES), np.cos(31.0 * TIMES) + 0.1 * TIMES


def text(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    return path


def test_a_header_says_quantities_and_units(tmp_path):
    file = text(tmp_path / "a.csv", "time [ms],Acceleration [g],voltage (mV)", 1e3 * TIMES,
                ACCELERATION, VOLTAGE)  # fmt: skip
    read = read_measurement(file)
    assert read.sampling_rate == pytest.approx(RATE)
    assert read.acceleration == pytest.approx(9.80665 * ACCELERATION)
    assert read.voltage == pytest.approx(1e-3 * VOLTAGE)


def test_columns_are_named_by_place_in_a_mat_and_in_a_npy_file(tmp_path):
    savemat(tmp_path / "a.mat", {"base": ACCELERATION, "u": VOLTAGE, "note": "text", "n": 3.0})
    np.save(tmp_path / "a.npy", np.column_stack([ACCELERATION, VOLTAGE]))
    for file, names in (("a.mat", ("base", "u")), ("a.npy", ("0", "1"))):
        settings = {
            "acceleration": f"{names[0]}:m/s^2",
            "voltage": f"{names[1]}:V",
            "sampling_rate": "500",
            "load.resistance": 1e5,
        }
        read = read_measurement(tmp_path / file, settings)
        assert read.voltage == pytest.approx(VOLTAGE)
        assert read.changes == {"load.resistance": 1e5}


def test_a_mat_file_gives_numbers_only(tmp_path):
    savemat(tmp_path / "a.mat", {"cells": np.array([{"a": 1}], dtype=object), "s": {"x": 1.0}})
    with pytest.raises(SceneError, match="no samples"):
        read_measurement(tmp_path / "a.mat", {"acceleration": "s:g"})
    (tmp_path / "b.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(SceneError, match=r"not a (whole .mat|readable)"):
        read_measurement(tmp_path / "b.mat")


def uneven():
    times = TIMES.copy()
    times[200:] += 0.05
    return times


def gap():
    values = VOLTAGE.copy()
    values[17] = np.nan
    return values


@pytest.mark.parametrize(
    ("header", "columns", "settings", "words"),
    [
        ("time,acceleration,voltage", (TIMES, ACCELERATION, VOLTAGE), {}, "has no unit"),
        ("time,acceleration [gg],voltage [V]", (TIMES, ACCELERATION, VOLTAGE), {},
         "unknown unit gg"),
        ("time,acceleration [g],voltage [V]", (uneven(), ACCELERATION, VOLTAGE), {},
         "unevenly sampled"),
        ("time,acceleration [g],voltage [V]", (TIMES, ACCELERATION, np.clip(VOLTAGE, -0.5, 0.5)),
         {}, "voltage: .* are clipped"),
        ("time,acceleration [g],voltage [V]", (TIMES, ACCELERATION, gap()), {}, "without a number"),
        ("time,acceleration [g],voltage [V]", (TIMES, ACCELERATION, VOLTAGE),
         {"voltge": "2:V"}, "did you mean voltage"),
        ("time,acceleration [g],voltage [V]", (TIMES, ACCELERATION, VOLTAGE),
         {"velocity": "veloc:m/s"}, "no such column"),
        ("time,acceleration [g],voltage [V]", (TIMES, ACCELERATION, VOLTAGE),
         {"velocity": "2:m/s:absolut"}, "after the unit write absolute"),
        ("a,acceleration [g],voltage [V]", (TIMES, ACCELERATION, VOLTAGE), {}, "sampling_rate=HZ"),
        ("time,acceleration [g],u", (TIMES, ACCELERATION, VOLTAGE), {}, "acceleration alone is"),
        ("time,a,voltage [V]", (TIMES, ACCELERATION, VOLTAGE), {}, "no column of the base"),
        ("time,acceleration [g],voltage [V]", (TIMES[:40], ACCELERATION[:40], VOLTAGE[:40]), {},
         "too short"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_in_one_line(tmp_path, header, columns, settings, words):
    file = text(tmp_path / "a.csv", header, *columns)
    with pytest.raises(SceneError, match=words) as caught:
        read_measurement(file, settings)
    assert "\n" not in str(caught.value)


def test_a_scaled_scene_takes_columns_without_units(tmp_path):
    file = text(tmp_path / "a.csv", "time,acceleration,voltage", TIMES, ACCELERATION, VOLTAGE)
    assert read_measurement(file, units="scaled").acceleration == pytest.approx(ACCELERATION)
    file = text(tmp_path / "b.csv", "time,acceleration [g],voltage", TIMES, ACCELERATION, VOLTAGE)
    with pytest.raises(SceneError, match='units = "scaled"'):
        read_measurement(file, units="scaled")
