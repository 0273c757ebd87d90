"""Every row of the tables of docs/reference/files.md: files of loggers with one known motion."""

import csv
import importlib
import io
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import savemat, wavfile

from harvester.base.errors import SceneError
from harvester.cli.command_line import main
from harvester.excitation.recorded import RecordedMotion
from harvester.identification.measurement import read_measurement
from harvester.records import mat
from harvester.records.quantities import ACCELERATION, QUANTITIES, heading, unit_named
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.source import BUILT_IN
from harvester.statistics import moments
from harvester.statistics.balance import energy_balance_residual

RATE, COUNT, G = 250.0, 500, 9.80665
TIMES = np.arange(COUNT) / RATE
MOTION = 3.0 * np.sin(2.0 * np.pi * 9.0 * TIMES + 0.4)
ONE = ["time [s],acceleration [m/s^2]"]


def written(folder, header, rows, end="\n", name="a.csv"):
    path = folder / name
    path.write_text("\n".join([*header, *rows]) + end, encoding="utf-8")
    return path


def rows(times=TIMES, values=MOTION, form="{:.6f},{:.8f}"):
    return [form.format(t, a) for t, a in zip(times, values, strict=True)]


def assert_read(path, tolerance=1e-6, **keys):
    """The record holds the motion at its rate."""
    found = RecordedMotion(file=str(path), **keys)
    assert found.interval == pytest.approx(1.0 / RATE, rel=1e-6)
    np.testing.assert_allclose(found.samples, MOTION[: found.samples.size], atol=tolerance)
    return found


def scene_of(path, **keys):
    """A linear device of 9 Hz in SI on a record."""
    tables = Scene.read("device").to_tables()
    stiffness = tables["oscillator"]["mass"] * (2.0 * np.pi * 9.0) ** 2
    tables["oscillator"] |= {"linear_stiffness": stiffness, "cubic_stiffness": 0.0}
    tables.pop("stoppers", None)
    tables["excitation"] = {"kind": "record", "file": str(path), **keys}
    tables["run"] = {"duration": 1.5, "realizations": 1}
    return Scene.from_tables(tables, name="a")


def refused(path, *words, **keys):
    with pytest.raises(SceneError) as caught:
        scene_of(path, **keys)
    message = str(caught.value)
    assert message.isprintable()
    for word in words:
        assert word in message


TIME_HEADINGS = {
    "time [s]": 1.0,
    "Time (sec)": 1.0,
    "t/s": 1.0,
    "time [ms]": 1e3,
    "t_ms": 1e3,
    "Elapsed Time, msec": 1e3,
    "milliseconds": 1e3,
    "Time[us]": 1e6,
    "time (µs)": 1e6,
    "timestamp [ns]": 1e9,
    "time in min": 1.0 / 60.0,
    "Time (h)": 1.0 / 3600.0,
}


@pytest.mark.parametrize(("name", "per_second"), TIME_HEADINGS.items())
def test_times_are_read_in_the_unit_of_their_heading(tmp_path, name, per_second):
    header = [f'"{name}";acceleration [m/s^2]']
    path = written(tmp_path, header, rows(per_second * TIMES, form="{:.12g};{:.8f}"))
    assert_read(path)


ACCELERATION_HEADINGS = {
    "acceleration [m/s^2]": 1.0,
    "acc (m/s²)": 1.0,
    "a (m s^-2)": 1.0,
    "accel_m_s2": 1.0,
    "x [ms-2]": 1.0,
    "acceleration [cm/s^2]": 1e2,
    "ground acceleration (Gal)": 1e2,
    "acceleration [mm/s2]": 1e3,
    "acceleration [g]": 1.0 / G,
    "Acceleration X (g)": 1.0 / G,
    "accel_g": 1.0 / G,
    "accel, G": 1.0 / G,
    "a / g": 1.0 / G,
    "ax [mg]": 1e3 / G,
    "acceleration [µg]": 1e6 / G,
    "acceleration [ft/s²]": 1.0 / 0.3048,
    "acceleration [in/s^2]": 1.0 / 0.0254,
}


@pytest.mark.parametrize(("name", "per_si"), ACCELERATION_HEADINGS.items())
def test_accelerations_are_read_in_the_unit_of_their_heading(tmp_path, name, per_si):
    path = written(tmp_path, [f"time;{name}"], rows(values=per_si * MOTION, form="{:.6f};{:.9f}"))
    assert_read(path)
    own = unit_named("acceleration", heading(name).unit)
    assert_read(path, unit=own, column=1, time_column=0)
    other = "g" if own != "g" else "m/s^2"
    refused(path, f"excitation.unit = {other!r}", "the heading of column", unit=other)


def test_every_unit_of_the_page_has_a_row_here():
    read = {unit_named("acceleration", heading(name).unit) for name in ACCELERATION_HEADINGS}
    assert read == set(ACCELERATION)
    read = {unit_named("time", heading(name).unit) for name in TIME_HEADINGS}
    assert read | {"samples"} == set(QUANTITIES["time"])


def test_what_the_file_does_not_say_the_scene_says(tmp_path):
    plain = written(tmp_path, [], rows(1e3 * TIMES, MOTION / G))
    assert_read(plain, unit="g", column=1, time_column=0, time_unit="ms")
    # Milliseconds taken for seconds: 0.125 Hz at most.
    refused(
        plain, "heading", "time_unit", "0.125 Hz", "moves at 9", unit="g", column=1, time_column=0
    )
    refused(plain, "has no unit", "give excitation.unit", column=1, time_column=0, time_unit="ms")
    refused(plain, "no time column", unit="g", column=1, sampling_rate=RATE, time_unit="ms")
    numbered = written(tmp_path, ["sample,acc [g]"], rows(np.arange(7, COUNT + 7), MOTION / G))
    assert_read(numbered, sampling_rate=RATE)
    assert_read(numbered, sampling_rate=RATE, time_column="sample")
    refused(numbered, "contains sample numbers", "sampling_rate", time_column=0)
    bare = written(tmp_path, [], rows(np.arange(COUNT)))
    keys = {"unit": "m/s^2", "column": 1, "time_column": 0, "time_unit": "samples"}
    assert_read(bare, sampling_rate=RATE, **keys)
    refused(bare, "contains sample numbers", **keys)


@pytest.mark.parametrize(
    ("header", "keys", "words"),
    [
        ("time [s],acc [g]", {"time_unit": "ms"}, ["time_unit = 'ms'", "says s"]),
        ("time [s],acc [g]", {"sampling_rate": 100.0}, ["sampling_rate = 100", "250 Hz"]),
        ("time,acc [g]", {"sampling_rate": 1.0, "time_column": 0}, ["sampling_rate = 1", "250 Hz"]),
        ("time [m],acc [g]", {}, ["minutes (min) or milliseconds (ms)", "time_unit"]),
        ("time [sx],acc [g]", {}, ["unknown unit sx", "did you mean s", "time_unit"]),
        ("time,acc [gg]", {}, ["gg", "did you mean g", "scale"]),
        ("time,acc [mV]", {"unit": "g"}, ["unknown unit mV", "units of acceleration", "scale"]),
        ("time,acc [counts]", {"unit": "g"}, ["counts", "excitation.scale"]),
        ("time,elapsed,acc [g]", {}, ["several columns may be the time", "time, elapsed"]),
        ("time,ax [g],ay [g]", {}, ["excitation.column is missing", "ax [g], ay [g]"]),
        ("time,north", {"column": "nord", "unit": "g"}, ["did you mean north"]),
    ],
)
def test_what_is_ambiguous_is_refused_with_both_readings(tmp_path, header, keys, words):
    table = [f"{t:.6f}," * (header.count(",")) + f"{a:.8f}" for t, a in zip(TIMES, MOTION)]  # noqa: B905
    refused(written(tmp_path, [header], table), *words, **keys)


def test_a_unit_behind_any_name_counts_for_the_column_that_the_scene_names(tmp_path):
    motion = MOTION / 9.80665
    table = [f"{t:.6f},{a:.8f}" for t, a in zip(TIMES, motion, strict=True)]
    path = written(tmp_path, ["time,ch2_g"], table)
    for column in ("ch2_g", "ch2", 1):
        assert_read(path, column=column)
    refused(path, "did you mean ch2_g", column="ch3_g")
    heading = tmp_path / "heading.csv"
    heading.write_text("time [s],acc [g]\n")
    refused(heading, "write samples below the heading")


def test_a_label_in_brackets_is_no_unit(tmp_path):
    path = written(tmp_path, ["time,acceleration (north)"], rows())
    assert_read(path, unit="m/s^2")


def test_volts_and_counts_become_accelerations_by_scale_and_offset(tmp_path):
    # 100 mV/g, and 16 bits over ±8 g.
    volts = written(tmp_path, ["time [s],sensor [V]"], rows(values=0.1 * MOTION / G + 1.2))
    assert_read(volts, scale=10.0, offset=-12.0, unit="g", column="sensor", tolerance=1e-5)
    counts = np.round(32768 + MOTION / G * 4096)
    raw = written(tmp_path, ["time [s],raw [counts]"], rows(values=counts))
    assert_read(raw, scale=1 / 4096, offset=-8.0, unit="g", column=1, tolerance=2e-3)
    refused(raw, "scale = 0", scale=0, unit="g", column=1)


def test_columns_of_words_are_named(tmp_path):
    words = [f"at {time},{value}" for time, value in zip(TIMES, MOTION, strict=True)]
    path = written(tmp_path, ONE, words)
    refused(path, "column time [s] contains neither numbers nor time stamps", "sampling_rate")
    refused(path, "column time [s] contains texts", "excitation.time_column", time_column=0)
    refused(
        written(tmp_path, ONE, rows(form="{},v {}")), "column acceleration [m/s^2] contains texts"
    )


def test_keys_are_checked_before_the_record_is_read(tmp_path):
    path = written(tmp_path, ONE, rows())
    for run in ({}, {"duration": 1.0}):
        for key, value, message in (
            ("scale", 0.0, "excitation.scale = 0: must not be 0"),
            (
                "unit",
                "scaled",
                'excitation.unit = "scaled": a scene with units = "SI" takes one of "m/s',
            ),
        ):
            with pytest.raises(SceneError, match=f"^a: {message}"):
                Scene.from_tables(
                    scene_of(path).to_tables()
                    | {"run": run, "excitation": {"kind": "record", "file": str(path), key: value}},
                    origin="a",
                )


def test_start_leaves_out_what_is_before(tmp_path):
    shifted = written(tmp_path, ["t_ms,acc"], rows(1e3 * TIMES + 1.7e12))
    for keys in ({}, {"sampling_rate": RATE, "time_column": None}):
        given = {"unit": "m/s^2", "start": 0.4, "detrend": "none", **keys}
        found = RecordedMotion(file=str(shifted), **given)
        np.testing.assert_allclose(found.samples, MOTION[100:], atol=1e-6)
    refused(shifted, "the record ends earlier: start before 1.99", unit="m/s^2", start=9.0)


def test_stamps_in_whole_seconds_agree_with_a_rate(tmp_path):
    stamps = [f"2026-03-01 12:00:{int(t):02d}" for t in TIMES]
    path = written(tmp_path, ONE, [f"{s},{a:.8f}" for s, a in zip(stamps, MOTION, strict=True)])
    assert_read(path, sampling_rate=RATE)
    refused(path, "does not rise", "give excitation.sampling_rate")


ROWS = {
    "iso": lambda t: (datetime(2026, 3, 1, 23, 59, 59) + timedelta(seconds=t)).isoformat(),
    "blank and zone": lambda t: f"2026-03-01 12:00:{t:09.6f}+01:00",
    "clock over midnight": lambda t: f"{'23:59:59' if t < 1 else '00:00:00'}{t % 1:.6f}".replace(
        "590.", "59."
    ).replace("000.", "00."),
    "one day": lambda t: f"3/1/2026 11:00:{t:09.6f} PM",
    "minutes": lambda t: f"07:{t:09.6f}",
    "nanoseconds": lambda t: f"2026-03-01T12:00:{t:012.9f}Z",
}


@pytest.mark.parametrize("name", ROWS)
def test_dates_and_clock_times_are_read(tmp_path, name):
    stamps = [ROWS[name](float(t)) for t in TIMES]
    path = written(tmp_path, ONE, [f"{s},{a:.8f}" for s, a in zip(stamps, MOTION, strict=True)])
    assert_read(path)
    assert_read(path, time_column=0, column=1, unit="m/s^2")


def test_dates_in_an_unknown_order_may_not_change(tmp_path):
    stamps = [f"{1 + (t > 1.0)}.3.2026 12:00:00" for t in TIMES]
    path = written(tmp_path, ONE, [f"{s},{a:.8f}" for s, a in zip(stamps, MOTION, strict=True)])
    refused(path, "dates change", "ISO 8601")


def quoted():
    stream = io.StringIO()
    table = csv.writer(stream, quoting=csv.QUOTE_ALL, lineterminator="\n")
    table.writerows([f"{t:.6f}".replace(".", ","), f"{a:.8f}".replace(".", ",")]
                    for t, a in zip(TIMES, MOTION, strict=True))  # fmt: skip
    return stream.getvalue().splitlines()


COMMAS = [row.replace(".", ",") for row in rows(form="{:.6f};{:.8f}")]
LAYOUTS = {
    "quoted": (ONE, [f'"{t:.6f}","{a:.8f}"' for t, a in zip(TIMES, MOTION, strict=True)]),
    "quoted commas": (ONE, quoted()),
    "semicolons and decimal commas": (["Zeit [s];Beschleunigung [m/s²]"], COMMAS),
    "tabs and decimal commas": (["time\tacc [m/s²]"], [row.replace(";", "\t") for row in COMMAS]),
    "blanks and decimal commas": (["time acc_ms2"], [row.replace(";", " ") for row in COMMAS]),
    "blanks": (["time [s]  acceleration [m/s^2]"], rows(form="{:.6f}   {:.8f}")),
    "comment": (["# station 7", "# time [s], acceleration [m/s^2]"], rows()),
    "two rows": (["Time,Channel A", "(ms),(cm/s²)", ""], rows(1e3 * TIMES, 1e2 * MOTION)),
    "four rows": (
        ['"TOA5","7"', '"TIMESTAMP","acc"', '"TS","m/s^2"', '"","Smp"'],
        [f'"2026-03-01 12:00:{t:06.3f}",{a:.8f}' for t, a in zip(TIMES, MOTION, strict=True)],
    ),
    "separator at the end": (["time [s],acc [m/s^2]"], rows(form="{:.6f},{:.8f},")),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_text_is_read_in_the_ways_that_loggers_write_it(tmp_path, name):
    found = assert_read(written(tmp_path, *LAYOUTS[name]))
    assert found.samples.size == COUNT


@pytest.mark.parametrize(
    ("last", "kept", "count"),
    [
        (["Rate 200, overflows 0"], COUNT, "last line is"),
        (["", "max,3.0", "# end", "total of 500 samples"], COUNT, "last 2 lines are"),
        (["20.00"], COUNT, "last line is"),
        (["2.000000,0.12"], COUNT, "last line is"),
    ],
)
def test_a_footer_and_a_line_cut_short_are_left_out_and_named(tmp_path, last, kept, count):
    path = written(tmp_path, ONE, [*rows(), *last], end="")
    found = assert_read(path)
    assert found.samples.size == kept
    assert count in found.notes(0.004, 56.5, scene_of(path).run)[0]


def test_a_number_that_happens_to_be_short_is_kept(tmp_path):
    values = [*MOTION[:-1], 0.0]
    path = written(tmp_path, ONE, rows(values=values, form="{:.6f},{:.9g}"), end="")
    assert RecordedMotion(file=str(path)).samples.size == COUNT


LVM = """LabVIEW Measurement
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\t{columns}
***End_of_Header***\t

Channels\t1
Samples\t500
Y_Unit_Label\tg
X_Dimension\tTime
X0\t0.0
Delta_X\t0.004
***End_of_Header***\t
X_Value\tBase\tComment
"""


def lvm(path, columns="One"):
    form = "{:.6f}\t{:.9f}" if columns == "One" else "\t{1:.9f}\t"
    path.write_text(LVM.format(columns=columns) + "\n".join(rows(TIMES, MOTION / G, form)) + "\n")


def hdf5(path, version=""):
    h5py = importlib.import_module("h5py")
    with h5py.File(path, "w", userblock_size=512 if version else 0) as file:
        group = file.create_group("run 1")
        group["time"] = 1e3 * TIMES
        group["time"].attrs["units"] = "ms"
        group.create_dataset("acceleration", data=MOTION / G, compression="gzip")
        group["acceleration"].attrs["unit"] = "g"
    if version:
        content = path.read_bytes()
        path.write_bytes(version.encode().ljust(512, b"\0") + content[512:])


def tdms(path, rates=(RATE,)):
    nptdms = importlib.import_module("nptdms")
    with nptdms.TdmsWriter(str(path)) as writer:
        for index, rate in enumerate(rates):
            properties = {"unit_string": "g", "wf_increment": 1.0 / rate}
            name = f"base{index or ''}"
            writer.write_segment([nptdms.ChannelObject("log", name, MOTION / G, properties)])


def test_channels_of_several_rates_are_refused(tmp_path):
    tdms(tmp_path / "a.tdms", (RATE, 2.0 * RATE))
    refused(tmp_path / "a.tdms", "several sampling rates", "250 Hz", "500 Hz", column="base")


def ide(path, scale="1/1000"):
    """Whole counts of 1/1000 g; the reader's time is in ticks of 1 ms."""
    schema = importlib.import_module("ebmlite").loadSchema("mide_ide.xml")
    counts = np.round(1e3 * MOTION / G).astype("<i2")
    axis = {"SubChannelID": 0, "SubChannelName": "X", "SubChannelLabel": "Acceleration",
            "SubChannelUnits": "g", "SubChannelCalibrationIDRef": 1}  # fmt: skip
    channel = {"ChannelID": 8, "ChannelName": "Base", "ChannelFormat": "<h",
               "TimeCodeScale": scale, "SubChannel": [axis]}  # fmt: skip
    line = {"CalID": 1, "CalReferenceValue": 0.0, "PolynomialCoef": [1e-3, 0.0]}
    end = 4 * (COUNT - 1)
    block = {"ChannelIDRef": 8, "StartTimeCodeAbs": 0, "EndTimeCodeAbs": end,
             "ChannelDataPayload": counts.tobytes()}  # fmt: skip
    parts = {
        "CalibrationList": {"UnivariatePolynomial": [line]},
        "RecordingProperties": {"ChannelList": {"Channel": [channel]}},
        "ChannelDataBlock": block,
    }
    with path.open("wb") as stream:
        schema.encode(stream, parts, headers=True)


def structure(path):
    data = {"time": TIMES, "accel_g": MOTION[:, None] / G, "note": "text", "sub": {"fs": RATE}}
    savemat(path, {"data": data, "cells": np.array([{"a": 1}], dtype=object)}, do_compression=True)


def fields(path):
    table = np.zeros(COUNT, [("t_ms", "f8"), ("acc_g", "f4")])
    table["t_ms"], table["acc_g"] = 1e3 * TIMES, MOTION / G
    np.save(path, table)


KINDS = {
    "a.lvm": lvm,
    "rate.lvm": lambda path: lvm(path, "No"),
    "a.mat": structure,
    "a.npy": fields,
    "a.h5": hdf5,
    "seven.mat": lambda path: hdf5(path, "MATLAB 7.3 MAT-file, Platform: GLNXA64"),
    "a.tdms": tdms,
    "a.ide": ide,
}


@pytest.mark.parametrize("name", KINDS)
def test_other_kinds_of_files_say_their_units_and_times(tmp_path, name):
    for module in ("h5py", "nptdms", "idelib"):
        pytest.importorskip(module)
    KINDS[name](tmp_path / name)
    assert_read(tmp_path / name, tolerance=6e-3 if name == "a.ide" else 1e-6)


def test_a_sound_file_says_its_rate(tmp_path):
    wavfile.write(tmp_path / "a.wav", int(RATE), (MOTION / 8.0).astype(np.float32))
    assert_read(tmp_path / "a.wav", unit="m/s^2", full_scale=8.0)


def test_what_leads_out_of_an_hdf5_file_is_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    hdf5(tmp_path / "other.h5")
    with h5py.File(tmp_path / "link.h5", "w") as file:
        file["a"] = h5py.ExternalLink("other.h5", "/run 1/time")
        file["b"] = MOTION
    refused(tmp_path / "link.h5", "a link to another file")
    with h5py.File(tmp_path / "raw.h5", "w") as file:
        file.create_dataset("v", (10,), "u1", external=[("other.h5", 0, 10)])
    refused(tmp_path / "raw.h5", "are in other files")
    layout = h5py.VirtualLayout((COUNT,), float)
    layout[:] = h5py.VirtualSource("other.h5", "run 1/time", (COUNT,))
    with h5py.File(tmp_path / "virtual.h5", "w") as file:
        file.create_virtual_dataset("v", layout)
    refused(tmp_path / "virtual.h5", "are in other files")
    with h5py.File(tmp_path / "large.h5", "w") as file:
        file.create_dataset("v", (10**12,), "f8", chunks=(1000,))
    refused(tmp_path / "large.h5", "more than 67108864 numbers")
    content = (tmp_path / "other.h5").read_bytes()
    (tmp_path / "cut.h5").write_bytes(content[: len(content) // 2])
    refused(tmp_path / "cut.h5", "not a valid HDF5 file")


def test_a_text_in_place_of_a_number_is_not_evaluated(tmp_path):
    pytest.importorskip("idelib")
    ide(tmp_path / "a.ide", "9**9**9**9")
    refused(tmp_path / "a.ide", "TimeCodeScale is not a number")


def test_a_broken_file_of_a_logger_is_refused_without_a_log(tmp_path, caplog):
    pytest.importorskip("idelib")
    ide(tmp_path / "a.ide")
    content = (tmp_path / "a.ide").read_bytes()
    # The identifier of the axis' unit is broken.
    (tmp_path / "a.ide").write_bytes(content.replace(b"R\xa6\x81g", b"R\xf3\x81g"))
    refused(tmp_path / "a.ide", "not a valid .IDE file", "export it as .csv")
    assert not caplog.records


def test_structures_that_claim_more_than_they_hold_are_refused(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"data": np.array([(TIMES, MOTION)], dtype=[("t", object), ("a", object)])})
    content = bytearray(path.read_bytes())
    # The structure's shape stands behind its flags.
    place = mat.HEADER_BYTES + 8 + 16 + 8
    assert content[place : place + 8] == np.array([1, 1], "<i4").tobytes()
    content[place : place + 8] = np.array([90_000, 90_000], "<i4").tobytes()
    path.write_bytes(content)
    refused(path, "claims more parts than it contains")
    deep = {"a": MOTION}
    for _ in range(20):
        deep = {"d": deep}
    savemat(path, deep)
    refused(path, "nested more than 16 deep")


@pytest.mark.parametrize(
    ("start", "words"),
    [
        (b"\xd0\xcf\x11\xe0", ["Excel", ".csv"]),
        (b"PAR1", ["Parquet", "to_csv"]),
        (b"fLaC", ["FLAC", ".wav"]),
        (b"    -1\n    58\n", ["universal file", "pyuff"]),
        (b'{"a": [1, 2]}', ["JSON"]),
    ],
)
def test_what_is_not_read_says_what_it_is_and_how_to_convert_it(tmp_path, start, words):
    path = tmp_path / "a.csv"
    path.write_bytes(start + bytes(100))
    refused(path, *words)


def test_gaps_of_the_times_are_bridged_up_to_a_tenth_and_named(tmp_path):
    kept = (TIMES < 0.8) | (TIMES >= 0.9)
    path = written(tmp_path, ONE, rows(TIMES[kept], MOTION[kept]))
    refused(path, 'mend = ["uneven"]')
    found = RecordedMotion(file=str(path), mend=("uneven",))
    assert found.samples.size == COUNT
    note = found.notes(0.004, 56.5, scene_of(path, mend=["uneven"]).run)[0]
    assert "5.0% of the samples were missing" in note
    assert "largest step is 0.104 s, after t = 0.796 s" in note
    for gap in (1.3, 100.0):
        far = TIMES + np.where(TIMES > 0.8, gap, 0.0)
        path = written(tmp_path, ONE, rows(far))
        for mend in ([], ["uneven"]):
            refused(path, "cannot be repaired", "after t = 0.8 s", mend=mend)
    assert_read(written(tmp_path, ONE, rows(TIMES[50:], MOTION[50:])), tolerance=9.0)


@pytest.mark.parametrize("marker", [-9999.0, 65535.0, 160.0])
def test_markers_are_named_and_mended_as_gaps(tmp_path, marker):
    values = MOTION.copy()
    values[[40, 41, 42, 200, 333]] = marker
    path = written(tmp_path, ONE, rows(values=values))
    run = scene_of(path).run
    note = RecordedMotion(file=str(path)).notes(0.004, 56.5, run)
    assert any(f"5 of 500 samples are {marker:g}, far outside" in line for line in note)
    mended = RecordedMotion(file=str(path), mend=("nan",))
    assert np.abs(mended.samples).max() < 3.1
    assert np.mean(mended.samples**2) == pytest.approx(4.5, rel=0.01)
    assert any("largest gap has 3 samples" in line for line in mended.notes(0.004, 56.5, run))


def test_shocks_are_no_markers(tmp_path):
    rng = np.random.default_rng(3)
    values = 0.01 * rng.standard_normal(COUNT)
    values[100:130] += 30.0 * np.exp(-0.4 * np.arange(30)) * np.cos(1.3 * np.arange(30))
    path = written(tmp_path, ONE, rows(values=values))
    found = RecordedMotion(file=str(path), mend=("nan",), detrend="none")
    np.testing.assert_allclose(found.samples, values, atol=1e-6)


def test_a_record_that_misses_the_device_says_so_first(tmp_path):
    fast = scene_of(written(tmp_path, [], rows()), column=1, unit="m/s^2", sampling_rate=25_000.0,
                    repetition="periodic")  # fmt: skip
    first = fast.excitation.notes(4e-5, 2.0 * np.pi * 9.0, fast.run)[0]
    assert "does not excite the device" in first
    assert "resonates at 9 Hz" in first


def test_identification_reads_the_same_headings(tmp_path):
    volts = np.cos(31.0 * TIMES)
    table = [f"{1e3 * t:.6f},{a:.8f},{v:.8f}" for t, a, v in zip(TIMES, MOTION / G, volts)]  # noqa: B905
    path = written(tmp_path, ["t_ms,accel_g,voltage (V)"], table)
    for settings in ({}, {"time": "0", "acceleration": "1"}, {"acceleration": "accel_g:g"}):
        read = read_measurement(path, settings)
        assert read.sampling_rate == pytest.approx(RATE)
        np.testing.assert_allclose(read.acceleration, MOTION, atol=1e-6)
    scaled = read_measurement(path, {"voltage_scale": "2", "voltage_offset": 1.0, "time": "0"})
    np.testing.assert_allclose(scaled.voltage, 2.0 * volts + 1.0, atol=1e-6)
    for settings, word in (
        ({"time": "0:s"}, "the heading of column t_ms says ms"),
        ({"acceleration": "1:m/s^2"}, "says g"),
        ({"sampling_rate": "100"}, "250 Hz"),
        ({"voltage_scale": "x"}, "must be a number"),
        ({"voltage_scal": "2"}, "did you mean voltage_scale"),
    ):
        with pytest.raises(SceneError, match=word):
            read_measurement(path, settings)


def test_a_link_into_nothing_is_named(tmp_path):
    (tmp_path / "a.csv").symlink_to("gone.csv")
    with pytest.raises(SceneError, match=r"a link to gone\.csv, which does not exist"):
        RecordedMotion(file=str(tmp_path / "a.csv"))


def test_a_record_given_twice_is_refused(tmp_path, capsys):
    path = str(written(tmp_path, ONE, rows()))
    words = ["identify", "device", "--record", path, "time=0", "--record", path, "time=0"]
    assert main(words) == 2
    assert "is given twice" in capsys.readouterr().err


def test_a_scene_may_begin_with_a_byte_order_mark(tmp_path):
    text = (BUILT_IN / "linear.toml").read_text(encoding="utf-8")
    (tmp_path / "a.toml").write_text(text, encoding="utf-8-sig")
    assert Scene.read(tmp_path / "a.toml").digest() == Scene.read("linear").digest()


def test_a_device_at_rest_that_nothing_drives_is_balanced():
    system = prepared(Scene.read("linear")).system
    rest = np.zeros(9)
    still = SimpleNamespace(integrals=np.zeros((2, len(moments.QUANTITIES))), first=rest, last=rest)
    assert energy_balance_residual([still], system) == 0.0
    # Energy out of nothing is no balance.
    moved = SimpleNamespace(integrals=still.integrals, first=rest, last=np.ones(9))
    assert np.isnan(energy_balance_residual([moved], system))


def test_the_page_lists_every_kind():
    page = Path(__file__).parents[3] / "docs" / "reference" / "files.md"
    text = page.read_text(encoding="utf-8")
    for word in (*ACCELERATION, *QUANTITIES["time"], ".lvm", ".mat", ".h5", ".tdms", ".IDE"):
        assert f"`{word}`" in text, word
