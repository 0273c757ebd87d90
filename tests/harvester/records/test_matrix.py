"""Every cell of the table "Metadata by kind of file" of docs/reference/files.md is a test."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat, wavfile

from harvester.base.errors import SceneError
from harvester.excitation.recorded import RecordedMotion, one_pass

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "files.md"
RATE, COUNT, G = 360.0, 720, 9.80665
TIMES = np.arange(COUNT) / RATE
MOTION = 30.0 * np.sin(2.0 * np.pi * 9.0 * TIMES + 0.4)
GAP = np.zeros(COUNT, bool)
GAP[300:310] = True
LVM = """LabVIEW Measurement
Separator\tTab
Decimal_Separator\t{mark}
X_Columns\tOne
***End_of_Header***\t

Channels\t1
Y_Unit_Label\t{unit}
X_Dimension\tTime
Delta_X\t0.004
***End_of_Header***\t
X_Value\tBase
"""


def text(path, times, values, unit="g", mark=".", form=".9f", stamp=".9f"):
    def written(value, kind):
        number = "" if np.isnan(value) else format(value, kind)
        return number if mark == "." else number.translate(str.maketrans(",.", ".,"))

    separator = "\t" if path.suffix == ".lvm" else ";"
    head = LVM.format(mark=mark, unit=unit)
    head = head if path.suffix == ".lvm" else f"time [s];acceleration [{unit}]\n"
    rows = zip(times, values, strict=True)
    lines = [f"{written(t, stamp)}{separator}{written(a, form)}" for t, a in rows]
    path.write_text(head + "\n".join(lines) + "\n")


def npy(path, times, values, unit="g"):
    table = np.zeros(times.size, [("t_s", "f8"), (f"acc_{unit}", "f8")])
    table["t_s"], table[f"acc_{unit}"] = times, values
    np.save(path, table)


def wav(path, times, values, unit=""):
    wavfile.write(path, round(1.0 / np.median(np.diff(times))), (values * G).astype(np.float32))


def mat(path, times, values, unit="g", **more):
    savemat(path, {"t_s": times, f"acc_{unit}": values, **more})


def hdf5(path, times, values, unit="g", rate=None, **attributes):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["time"], file["acceleration"] = times, values
        file["acceleration"].attrs.update({"units": unit, **attributes})
        if rate:
            file.attrs["fs"] = rate


def tdms(path, times, values, unit="g", **properties):
    nptdms = pytest.importorskip("nptdms")
    said = {"unit_string": unit, **properties}
    with nptdms.TdmsWriter(str(path)) as writer:
        clock = nptdms.ChannelObject("log", "time", times, {"unit_string": "s"})
        writer.write_segment([clock, nptdms.ChannelObject("log", "acceleration", values, said)])


def ide(path, times, values, unit="g", ticks=1e6, slope=1e-3):
    pytest.importorskip("idelib")
    schema = importlib.import_module("ebmlite").loadSchema("mide_ide.xml")
    axis = {"SubChannelID": 0, "SubChannelName": "X", "SubChannelLabel": "Acceleration",
            "SubChannelUnits": unit, "SubChannelCalibrationIDRef": 1}  # fmt: skip
    channel = {"ChannelID": 8, "ChannelName": "Base", "ChannelFormat": "<h",
               "TimeCodeScale": f"1/{ticks:.0f}", "SubChannel": [axis]}  # fmt: skip
    line = {"CalID": 1, "CalReferenceValue": 0.0, "PolynomialCoef": [slope, 0.0]}
    stamps = np.round(times * ticks).astype(int)
    blocks = [
        {"ChannelIDRef": 8, "StartTimeCodeAbs": int(stamps[part[0]]),
         "EndTimeCodeAbs": int(stamps[part[-1]]),
         "ChannelDataPayload": np.round(values[part] / slope).astype("<i2").tobytes()}
        for part in np.split(np.arange(times.size), range(60, times.size, 60))
    ]  # fmt: skip
    parts = {
        "CalibrationList": {"UnivariatePolynomial": [line]},
        "RecordingProperties": {"ChannelList": {"Channel": [channel]}},
        "ChannelDataBlock": blocks,
    }
    with path.open("wb") as stream:
        schema.encode(stream, parts, headers=True)


KINDS = {"text": (text, ".csv"), "`.lvm`": (text, ".lvm"), "`.npy`": (npy, ".npy"),
         "`.wav`": (wav, ".wav"), "`.mat`": (mat, ".mat"), "HDF5, NetCDF 4": (hdf5, ".h5"),
         "`.tdms`": (tdms, ".tdms"), "`.IDE`": (ide, ".ide")}  # fmt: skip
LINEAR = {"NI_Scaling_Status": "unscaled", "NI_Number_Of_Scales": 1,
          "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 1e-3,
          "NI_Scale[0]_Linear_Y_Intercept": 0.5,
          "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF}  # fmt: skip
COUNTS = np.round((MOTION / G - 0.5) * 1e3).astype("i2")
WITH_GAP = np.where(GAP, np.nan, MOTION / G)
# What is written in another way than usual, and keys of the scene, by feature and kind.
WRITTEN = {
    "scale and offset": {
        "HDF5, NetCDF 4": (COUNTS, {"scale_factor": 1e-3, "add_offset": 0.5}),
        "`.tdms`": (COUNTS, LINEAR),
        "`.IDE`": (MOTION / G, {"slope": 2e-3}),
    },
    "decimal comma": {"text": (MOTION / G, {"mark": ","}), "`.lvm`": (MOTION / G, {"mark": ","})},
    "thousands separator": {
        "text": (1e3 * MOTION / G, {"unit": "mg", "form": ",.0f"}),
        "`.lvm`": (1e3 * MOTION / G, {"unit": "mg", "form": ",.0f"}),
    },
    "rate in addition to times": {
        "`.mat`": (MOTION / G, {"fs": 2.0 * RATE}),
        "HDF5, NetCDF 4": (MOTION / G, {"rate": 2.0 * RATE}),
        "`.tdms`": (MOTION / G, {"wf_increment": 0.5 / RATE}),
    },
    "gaps": {
        "HDF5, NetCDF 4": (np.where(GAP, -99.0, MOTION / G), {"_FillValue": -99.0}),
    },
}
FEATURES = ("unit", "contradicting unit", "scale and offset", "rate in addition to times",
            "decimal comma", "thousands separator", "gaps", "rounded stamps")  # fmt: skip


def table():
    """{(kind, feature): what the page says}."""
    page = PAGE.read_text(encoding="utf-8")
    part = page.partition("## Metadata by kind of file")[2].partition("\n## ")[0]
    rows = [re.split(r"\s*\|\s*", line)[1:-1] for line in part.splitlines() if line[:1] == "|"]
    header, _, *lines = rows
    return {
        (row[0], name): said
        for row in lines
        for name, said in zip(header[1:], row[1:], strict=True)
    }


def recorded(kind, feature, folder):
    """A record whose file has a feature, and the keys of the scene."""
    write, ending = KINDS[kind]
    path, times, options = folder / f"a{ending}", TIMES, {}
    values = WITH_GAP if feature == "gaps" else MOTION / G
    if feature in WRITTEN:
        values, options = WRITTEN[feature].get(kind, (values, {}))
    if kind == "`.IDE`" and feature == "gaps":
        times, values = TIMES + np.where(TIMES < 1.0, 0.0, 10.0 / RATE), MOTION / G
    if feature == "rounded stamps":
        times = TIMES if write is ide else np.round(TIMES, 3)
        options = (
            {"ticks": 32768.0} if kind == "`.IDE`" else {"stamp": ".3f"} if write is text else {}
        )
    write(path, times, values, **options)
    keys = {"unit": "m/s^2"} if kind == "`.wav`" or feature == "contradicting unit" else {}
    if feature == "rate in addition to times" and kind not in WRITTEN[feature]:
        keys["sampling_rate"] = 2.0 * RATE
    return str(path), {"detrend": "none", **keys}


def read(path, keys):
    values, interval, _ = one_pass(RecordedMotion(path, **keys))
    assert 1.0 / interval == pytest.approx(RATE, rel=2e-4)
    return values


@pytest.mark.parametrize(
    ("kind", "feature"), [cell for cell, said in table().items() if said != "—"]
)
def test_each_cell_of_the_table_holds(tmp_path, kind, feature):
    said = table()[kind, feature]
    path, keys = recorded(kind, feature, tmp_path)
    if said != "read":
        with pytest.raises(SceneError) as caught:
            read(path, keys)
        assert "\n" not in str(caught.value)
    if said == "rejected":
        return
    if said.startswith("`mend"):
        keys["mend"] = tuple(re.findall(r'"(\w+)"', said))
        assert f'mend = ["{keys["mend"][0]}"]' in str(caught.value)
    found = read(path, keys)
    good = ~GAP if feature == "gaps" else np.ones(COUNT, bool)
    if kind == "`.IDE`" and feature == "gaps":
        found, good = np.delete(found, np.arange(360, 370)), np.ones(COUNT, bool)
    # A thousandth of g is the step of the whole numbers that are written.
    size = min(found.size, COUNT)
    assert size >= COUNT - 1
    error = np.abs(found[:size] - MOTION[:size])[good[:size]]
    assert error.max() < (0.01 if kind != "`.IDE`" else 0.02) * 30.0


@pytest.mark.parametrize("key", ["valid_range", "valid_max"])
def test_numbers_outside_the_valid_range_of_a_data_set_are_gaps(tmp_path, key):
    packing = {
        "scale_factor": 1e-3,
        "add_offset": 0.5,
        key: [-9000, 9000] if key == "valid_range" else 9000,
    }
    hdf5(tmp_path / "a.h5", TIMES, np.where(GAP, 9001, COUNTS), **packing)
    with pytest.raises(SceneError, match="10 of 720 samples are without a number"):
        read(str(tmp_path / "a.h5"), {})
    found = read(str(tmp_path / "a.h5"), {"mend": ("nan",), "detrend": "none"})
    assert np.abs(found - MOTION)[~GAP].max() < 0.01 * 30.0


@pytest.mark.parametrize(
    ("packing", "fault"),
    [({"scale_factor": [1e-3, 2e-3]}, "scale_factor has 2 numbers instead of 1"),
     ({"valid_range": 5.0}, "valid_range has 1 numbers instead of 2"),
     ({"_Unsigned": "true"}, "_Unsigned changes the numbers' type")],
)  # fmt: skip
def test_packing_that_is_not_read_is_refused(tmp_path, packing, fault):
    hdf5(tmp_path / "a.h5", TIMES, COUNTS, **packing)
    with pytest.raises(SceneError, match=f"acceleration: {fault}"):
        read(str(tmp_path / "a.h5"), {})


def test_the_times_of_a_labview_file_go_before_its_step(tmp_path):
    text(tmp_path / "a.lvm", TIMES, MOTION / G)
    assert "Delta_X\t0.004" in (tmp_path / "a.lvm").read_text()
    assert read(str(tmp_path / "a.lvm"), {}).size == COUNT


def test_the_table_has_a_row_for_each_kind_and_a_column_for_each_feature():
    assert set(table()) == {(kind, feature) for kind in KINDS for feature in FEATURES}
