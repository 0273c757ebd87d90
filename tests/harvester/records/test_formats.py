"""Formats of other packages; what the readers of columns have in common, whatever asks for them."""

import entry_points
import numpy as np
import pytest

from harvester.base.errors import SceneError
from harvester.excitation.recorded import RecordedMotion
from harvester.identification.measurement import read_measurement
from harvester.records.formats import FORMATS
from harvester.records.points import read_points

COUNTS = np.round(1000.0 * np.sin(0.3 * np.arange(300)))
TIMES = np.arange(300) / 100.0


@pytest.fixture
def counts(tmp_path, monkeypatch):
    """A file of a format that an installed package adds."""
    entry_points.install(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(FORMATS, "data", dict(FORMATS.data))
    path = tmp_path / "a.counts"
    path.write_bytes(b"100\n" + COUNTS.astype("<i2").tobytes())
    return path


def test_a_format_is_one_module_that_returns_columns(counts):
    found = RecordedMotion(str(counts), detrend="none")
    assert found.interval == pytest.approx(0.01)
    np.testing.assert_allclose(found.samples, 9.80665e-3 * COUNTS)
    with pytest.raises(SceneError, match=r"excitation\.unit = 'g': the heading .* says mg"):
        assert RecordedMotion(str(counts), unit="g").samples.size
    read = read_measurement(counts, {"voltage": "0:mV", "voltage_scale": 2.0})
    assert read.sampling_rate == 100.0
    np.testing.assert_allclose(read.voltage, 2e-3 * COUNTS)


def test_a_time_column_that_ends_where_it_begins_is_refused(tmp_path):
    np.savetxt(tmp_path / "a.csv", np.column_stack([TIMES * (TIMES[-1] - TIMES), COUNTS]))
    record = RecordedMotion(
        str(tmp_path / "a.csv"), unit="g", column=1, time_column=0, sampling_rate=100.0
    )
    with pytest.raises(SceneError, match="column 0 says inf Hz"):
        assert record.samples.size


def test_a_record_of_one_line_is_too_short_for_identify(tmp_path):
    (tmp_path / "a.csv").write_text("time [s],acc [g],voltage [V]\n0.1,2,3\n")
    with pytest.raises(SceneError, match="too short: 1 samples"):
        read_measurement(tmp_path / "a.csv")


def test_points_are_read_from_any_format(tmp_path):
    points = np.column_stack([TIMES, COUNTS])
    np.save(tmp_path / "a.npy", points)
    found, units = read_points(tmp_path / "a.npy", "spectrum", ("frequency", "density"))
    np.testing.assert_array_equal(found, points)
    assert units == ["", ""]
    (tmp_path / "a.csv").write_text("x;F\n" + "".join(f"{k};1,{700 + k}\n" for k in range(9)))
    with pytest.raises(SceneError, match=r"a\.csv: .* is ambiguous"):
        read_points(tmp_path / "a.csv", "table of force", ("displacement", "force"))


@pytest.mark.parametrize(
    ("header", "settings", "words"),
    [
        ("time,elapsed,acc [g],u [V]", {"voltage": "u"}, r"several columns .* time=COLUMN:UNIT"),
        ("time,v,acc [mV],u", {"acceleration": "2:g", "voltage": "u:V"}, "unknown unit mV.*_scale"),
        ("time,v,acc [g],u", {"voltage": "u"}, "voltage has no unit: write voltage .V. in the"),
        ("v,w,acc [g],u [V]", {"voltage": "u"}, "sampling_rate is missing .*time=COLUMN:UNIT"),
    ],
)
def test_identify_has_the_rules_of_scenes(tmp_path, header, settings, words):
    table = np.column_stack([TIMES, TIMES, COUNTS, np.cos(TIMES)])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="")
    with pytest.raises(SceneError, match=words) as caught:
        read_measurement(tmp_path / "a.csv", settings)
    assert "\n" not in str(caught.value)
