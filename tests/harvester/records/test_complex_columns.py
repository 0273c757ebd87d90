"""Columns of complex numbers are frequency responses, in every kind of file that has them."""

import numpy as np
import pytest
from scipy.io import savemat

from harvester.base.errors import SceneError
from harvester.identification.measurement import read_measurement
from harvester.records.quantities import heading

FREQUENCY = np.linspace(10.0, 60.0, 40)
RESPONSE = 1.0 / (1.0 - (FREQUENCY / 30.0) ** 2 + 0.1j)
NAMED = {"frequency": "f:Hz", "response": "H:V/g"}


def mat(path):
    savemat(path, {"f": FREQUENCY, "H": RESPONSE, "fs": np.array([1.0 + 2.0j])})
    return NAMED


def structure(path):
    savemat(path, {"s": {"f": FREQUENCY, "H": np.column_stack([2.0 * RESPONSE, RESPONSE])}})
    return {"frequency": "s.f:Hz", "response": "s.H[1]:V/g"}


def plain(path):
    np.save(path, np.column_stack([FREQUENCY, RESPONSE]))
    return {"frequency": "0:Hz", "response": "1:V/g"}


def fields(path):
    record = np.zeros(FREQUENCY.size, [("f", float), ("H", complex)])
    record["f"], record["H"] = FREQUENCY, RESPONSE
    np.save(path, record)
    return NAMED


def hdf5(path):
    import h5py

    with h5py.File(path, "w") as file:
        file["f"], file["H"] = FREQUENCY, RESPONSE
    return NAMED


def seven(path):
    """As MATLAB writes complex numbers in version 7.3."""
    import h5py

    pairs = np.zeros(FREQUENCY.size, [("real", float), ("imag", float)])
    pairs["real"], pairs["imag"] = RESPONSE.real, RESPONSE.imag
    with h5py.File(path, "w") as file:
        file["f"], file["H"] = FREQUENCY, pairs
    return NAMED


def lines(form, separator=",", decimal="."):
    """Of text, each complex number by a form of its parts."""
    for f, h in zip(FREQUENCY, RESPONSE, strict=True):
        number = form.format(h.real, "+-"[int(h.imag < 0.0)], abs(h.imag))
        yield f"{float(f)!r}{separator}{number}".replace(".", decimal)


def commas(path):
    rows = lines("{:.17g}{}{:.17g}i")
    path.write_text("\n".join(["frequency [Hz],response [V/g]", *rows]))
    return {}


def semicolons(path):
    rows = lines("({:.17g} {} {:.17g}j)", ";", ",")
    path.write_text("\n".join(["f [Hz];FRF [V/g]", *rows]) + "\n")
    return {}


def tabs(path):
    rows = lines("{:.16e}{}{:.16e}*i", "\t")
    path.write_text("\n".join(["f\tH", *rows]))
    return NAMED


@pytest.mark.parametrize(
    ("file", "write"),
    [
        ("a.mat", mat),
        ("b.mat", structure),
        ("a.npy", plain),
        ("b.npy", fields),
        ("a.h5", hdf5),
        ("c.mat", seven),
        ("a.csv", commas),
        ("b.csv", semicolons),
        ("c.txt", tabs),
    ],
)
def test_complex_numbers_are_a_response(tmp_path, file, write):
    settings = write(tmp_path / file)
    read = read_measurement(tmp_path / file, settings)
    assert read.frequency == pytest.approx(FREQUENCY)
    assert read.response == pytest.approx(RESPONSE / 9.80665)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"response": "H:V/g"}, "no column of frequencies is named"),
        ({"acceleration": "H:V/g", "frequency": "f:Hz"}, "H contains complex numbers"),
        ({"frequency": "f:Hz", "response": "f:V/g"}, "no complex numbers: name it by amplitude="),
    ],
)
def test_what_complex_columns_are_not(tmp_path, settings, said):
    savemat(tmp_path / "a.mat", {"f": FREQUENCY, "H": RESPONSE})
    # A heading that names no quantity.
    savemat(tmp_path / "b.mat", {"x": FREQUENCY, "H": RESPONSE})
    file = "a.mat" if "frequency" in settings else "b.mat"
    with pytest.raises(SceneError, match=said):
        read_measurement(tmp_path / file, settings)


@pytest.mark.parametrize("unit", ["", ":s"])
def test_a_place_in_brackets_is_no_unit(tmp_path, unit):
    times = np.arange(400) / 200.0
    table = np.column_stack([times, np.sin(30.0 * times), np.cos(31.0 * times) + 0.1 * times])
    savemat(tmp_path / "a.mat", {"X1": table})
    columns = {"time": f"X1[0]{unit}", "acceleration": "X1[1]:g", "voltage": "X1[2]:mV"}
    read = read_measurement(tmp_path / "a.mat", columns)
    assert read.sampling_rate == pytest.approx(200.0)
    assert read.voltage == pytest.approx(1e-3 * table[:, 2])
    assert [heading(name).unit for name in ("X1[0]", "X1[0,1]", "X1[-1]")] == ["", "", ""]
