"""Files of points: headings with units of force tables and spectra."""

import numpy as np
import pytest

from harvester.base.errors import SceneError
from harvester.scene.model import Scene

G = 9.80665
# Hz and (m/s²)²/Hz.
DENSITY = [(5.0, 0.05), (20.0, 0.4), (60.0, 0.4), (150.0, 0.06)]
SPRING = [(-0.01, -0.6), (-0.005, -0.35), (0.0, 0.0), (0.005, 0.35), (0.01, 0.6)]


def written(folder, header, points, factors, separator=","):
    rows = [f"{a * factors[0]!r}{separator}{b * factors[1]!r}" for a, b in points]
    path = folder / "p.csv"
    path.write_text("\n".join([header, *rows]))
    return str(path)


def spectrum(file, **keys):
    tables = Scene.read("device").to_tables()
    tables["excitation"] = {"kind": "spectrum", "breakpoints": file, **keys}
    return Scene.from_tables(tables, name="a").excitation


SPECTRA = {
    "Frequency (kHz),PSD (g^2/Hz)": (1e-3, G**-2),
    "f_Hz;psd in mg²/Hz": (1.0, 1e6 / G**2),
    "# f (Hz), G (m²/s³)": (1.0, 1.0),
    "f,psd\n[kHz],[g2/Hz]": (1e-3, G**-2),
    "omega [rad/s],PSD ((mm/s^2)^2/Hz)": (2.0 * np.pi, 1e6),
}


@pytest.mark.parametrize("header", SPECTRA)
def test_breakpoints_are_read_in_the_units_of_their_heading(tmp_path, header):
    file = written(tmp_path, header, DENSITY, SPECTRA[header], ";" if ";" in header else ",")
    np.testing.assert_allclose(spectrum(file).points, DENSITY, rtol=1e-9)


@pytest.mark.parametrize(
    ("header", "unit", "words"),
    [
        ("f [Hz],psd [g^2/Hz]", "(m/s^2)^2/Hz", "heading of column psd .* says g.2/Hz"),
        ("f [Hz],psd [(m/s^2)^2/Hz]", "g^2/Hz", "omit the unit"),
        ("f [Hz],asd [g/√Hz]", "g^2/Hz", "unknown unit g/√Hz.*square"),
        ("f [Hz],PSD g/sqrt(Hz)", "g^2/Hz", "square"),
        ("f [Hz],PSD dB", "g^2/Hz", "unknown unit dB"),
        ("PSD,Frequency", "g^2/Hz", "wrong order"),
        ("f [V],psd", "g^2/Hz", "unknown unit V"),
        ("1,2\nf,psd", "g^2/Hz", "line 2"),
        ("f,psd", None, "unit is missing"),
    ],
)
def test_a_heading_that_contradicts_the_scene_is_refused(tmp_path, header, unit, words):
    file = written(tmp_path, header, DENSITY, (1.0, 1.0))
    keys = {} if unit is None else {"unit": unit}
    with pytest.raises(SceneError, match=words) as caught:
        spectrum(file, **keys)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        ("x [mm],F [mN]", (1e3, 1e3)),
        ("x_um;F_uN", (1e6, 1e6)),
        ("x in mm,F (lbf)", (1e3, 1 / 4.4482216152605)),
    ],
)
def test_a_force_table_is_read_in_the_units_of_its_heading(tmp_path, header, factors):
    file = written(tmp_path, header, SPRING, factors, ";" if ";" in header else ",")
    scene = Scene.read("device").replace({"oscillator.force_table": file})
    np.testing.assert_allclose(scene.oscillator.force_table, SPRING, rtol=1e-12)
    scaled = Scene.read("duffing")
    with pytest.raises(SceneError, match='units = "scaled"'):
        scaled.replace({"oscillator.force_table": file})


@pytest.mark.parametrize("header", ["F [N],x [m]", "force,displacement", "x [parsec],F [N]"])
def test_a_force_table_with_a_wrong_heading_is_refused(tmp_path, header):
    file = written(tmp_path, header, SPRING, (1.0, 1.0))
    with pytest.raises(SceneError, match=r"unknown unit|wrong order"):
        Scene.read("device").replace({"oscillator.force_table": file})


def test_a_heading_in_latin_1_is_read(tmp_path):
    rows = [f"{1e-3 * f};{g}" for f, g in DENSITY]
    (tmp_path / "p.csv").write_bytes("\n".join(["f [kHz];G [m²/s³]", *rows]).encode("latin-1"))
    np.testing.assert_allclose(spectrum(str(tmp_path / "p.csv")).points, DENSITY)


def test_a_refusal_quotes_nothing_of_the_file(tmp_path):
    (tmp_path / "secret").write_text("root:x:0:0:secret\n1,2\nsecret 5 6 7\n")
    with pytest.raises(SceneError) as caught:
        Scene.read("device").replace({"oscillator.force_table": str(tmp_path / "secret")})
    assert "0:secret" not in str(caught.value)
    assert "5 6 7" not in str(caught.value)
