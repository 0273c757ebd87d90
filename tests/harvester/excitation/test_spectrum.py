"""Vibration by its spectrum: density, moments and bytes of the path, what a scene may say."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

from harvester.base.errors import SceneError
from harvester.excitation.base import realization_seed
from harvester.excitation.profiles import PROFILES
from harvester.excitation.shaped import ShapedPath, density_between, mean_square, path_density
from harvester.excitation.spectrum import Spectrum
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared

# Not the page of any standard: a flat part, a slope, a step, an octave's rise of 6 dB.
POINTS = ((8.0, 0.02), (30.0, 0.02), (60.0, 0.002), (61.0, 0.01), (120.0, 0.04), (200.0, 0.001))
G = 9.80665


def scene_with(**more):
    tables = {
        "units": "SI",
        "oscillator": {"mass": 0.0141, "damping": 0.22, "linear_stiffness": 1158.0},
        "piezo": {"coupling": 2.327e-3, "capacitance": 41.26e-9},
        "load": {"resistance": 47e3},
        "excitation": {"kind": "spectrum", "unit": "g^2/Hz", "breakpoints": POINTS, **more},
        "run": {"duration": 20.0, "settle": 1.0, "seed": 3, "realizations": 2},
    }
    return Scene.from_tables(tables)


def in_g(frequency):
    """Straight lines on log–log axes, written out."""
    for (low, first), (high, last) in itertools.pairwise(POINTS):
        if low <= frequency <= high:
            slope = math.log(last / first) / math.log(high / low)
            return first * (frequency / low) ** slope
    return 0.0


def test_density_and_mean_square_are_those_of_straight_lines():
    excitation = scene_with().excitation
    for frequency in (7.9, 8.0, 45.0, 60.4, 90.0, 199.0, 201.0):
        assert excitation.density(np.array([frequency]))[0] == pytest.approx(
            in_g(frequency) * G**2, rel=1e-12
        )
    square = sum(
        quad(in_g, low, high, epsrel=1e-12)[0] for (low, _), (high, _) in itertools.pairwise(POINTS)
    )
    assert mean_square(excitation.points) == pytest.approx(square * G**2, rel=1e-9)


def test_the_path_has_the_density_asked_for():
    """The mean of |filter|² over each sixth octave is within 0.3 dB, without any chance."""
    spacing = 1.0 / 2400.0
    path = ShapedPath(POINTS, spacing, realization_seed(1, 0))
    taps = np.fft.irfft(path._spectrum)
    power = np.abs(np.fft.rfft(taps, 4 * taps.size)) ** 2 * 2.0 * spacing
    frequencies = np.fft.rfftfreq(4 * taps.size, spacing)
    power *= np.sinc(frequencies * spacing) ** 4
    logarithms = np.log(np.array(POINTS)).T
    edges = 8.0 * 2.0 ** (np.arange(28) / 6.0)
    for low, high in itertools.pairwise(edges):
        band = (frequencies >= low) & (frequencies < high)
        wanted = np.mean(np.exp(np.interp(np.log(frequencies[band]), *logarithms)))
        assert abs(10.0 * math.log10(power[band].mean() / wanted)) < 0.3, low
    assert power[1:].sum() * frequencies[1] == pytest.approx(mean_square(POINTS), rel=1e-3)


@pytest.mark.parametrize("per_period", [4.0, 8.0])
def test_a_flat_density_is_flat_between_knots_that_are_far_apart(per_period):
    """Welch's density of a path, with what straight lines take, in thirds of 20 to 200 Hz.

    At four knots a period of the highest frequency the lines take 34 % of its density.
    """
    spacing = 1.0 / (200.0 * per_period)
    path = ShapedPath(((20.0, 1.0), (200.0, 1.0)), spacing, realization_seed(1, 0))
    f, density = welch(path.read(2**20), 1.0 / spacing, nperseg=2048)
    density *= np.sinc(f * spacing) ** 4
    for low, high in ((30.0, 80.0), (80.0, 140.0), (140.0, 190.0)):
        band = (f > low) & (f < high)
        # Three standard errors of noise that lasts so long, one false alarm of 370.
        chance = 3.0 / math.sqrt((high - low) * 2**20 * spacing)
        assert density[band].mean() == pytest.approx(1.0, abs=chance + 0.01)


@pytest.mark.parametrize("kurtosis", [3.0, 6.0])
def test_blocks_of_any_size_give_the_same_bytes(kurtosis):
    ready = prepared(scene_with(kurtosis=kurtosis))
    whole = noise_path(ready, 1).read(150_000)
    path = noise_path(ready, 1)
    parts = [path.read(count) for count in (1, 0, 70_000, 65_536, 14_463)]
    assert whole.tobytes() == np.concatenate(parts).tobytes()
    assert noise_path(ready, 0).read(150_000).tobytes() != whole.tobytes()


@pytest.mark.slow
def test_bursts_give_the_kurtosis_and_keep_the_rms():
    path = ShapedPath(POINTS, 1 / 2400.0, realization_seed(5, 0), kurtosis=5.0, burst_time=0.5)
    stretches = [path.read(2400 * 60) for _ in range(60)]
    second = np.array([np.mean(each**2) for each in stretches])
    fourth = np.array([np.mean(each**4) for each in stretches])
    wanted = mean_square(POINTS)
    # Three standard errors, each a false alarm once in 370 seeds.
    error = second.std() / math.sqrt(60)
    assert abs(second.mean() - wanted * 1.015) < 3.0 * error + 0.015 * wanted
    ratio = fourth.mean() / second.mean() ** 2
    assert abs(ratio - 5.0) < 3.0 * fourth.std() / math.sqrt(60) / second.mean() ** 2


def test_breakpoints_may_stand_in_a_file(tmp_path):
    lines = ["frequency [Hz], density"] + [f"{f}, {g}" for f, g in POINTS]
    (tmp_path / "truck.csv").write_text("\n".join(lines))
    text = """
        units = "SI"
        oscillator = {mass = 0.0141, damping = 0.22, linear_stiffness = 1158.0}
        piezo = {coupling = 2.327e-3, capacitance = 41.26e-9}
        load = {resistance = 47e3}
        excitation = {kind = "spectrum", unit = "g^2/Hz", breakpoints = "truck.csv"}
        run = {duration = 20.0, settle = 1.0, seed = 3, realizations = 2}
    """
    (tmp_path / "beam.toml").write_text(text)
    assert Scene.read(tmp_path / "beam.toml").digest() == scene_with().digest()
    (tmp_path / "truck.csv").write_text("frequency, density\n5, 1\n")
    with pytest.raises(SceneError, match=r"truck\.csv: 1 lines with a frequency"):
        Scene.read(tmp_path / "beam.toml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"unit": "scaled"}, 'takes one of "g\\^2/Hz"'),
        ({"breakpoints": [[10.0, 1.0], [10.0, 2.0]]}, "frequencies must ascend"),
        ({"breakpoints": [[0.0, 1.0], [10.0, 2.0]]}, "a number > 0"),
        ({"breakpoints": "nowhere.csv"}, "nowhere.csv"),
        ({"kurtosis": 2.0}, "kurtosis"),
        ({"knot_spacing": 0.01}, "a quarter of the highest"),
        ({"kurtosis": 5.0, "burst_time": 0.1}, "at least 0.125, a period of the lowest"),
    ],
)
def test_what_makes_no_spectrum_is_refused(change, words):
    with pytest.raises(SceneError, match=words):
        scene_with(**change)


def test_a_named_source_is_written_out():
    notes = Spectrum(((5.0, 1.0), (50.0, 0.1)), "g^2/Hz", source="my logger").notes(
        1e-3, 100.0, None
    )
    assert "my logger" in notes[0]
    assert "5 Hz 1, 50 Hz 0.1" in notes[0]


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_has_the_rms_that_its_source_prints_and_is_written_out(name):
    profile = PROFILES[name]
    pieces = itertools.pairwise(profile.breakpoints)
    square = sum(
        quad(lambda f, a=a, b=b: math.exp(np.interp(math.log(f), *np.log([a, b]).T)), a[0], b[0])[0]
        for a, b in pieces
    )
    assert math.sqrt(square) == pytest.approx(profile.rms, abs=0.05)
    tables = scene_with().to_tables() | {"excitation": {"kind": "spectrum", "profile": name}}
    scene = Scene.from_tables(tables)
    written = scene.to_tables()["excitation"]
    assert [tuple(point) for point in written["breakpoints"]] == list(profile.breakpoints)
    assert profile.source in scene.excitation.notes(1e-5, 300.0, scene.run)[0]
    part = {"kind": "sum", "parts": [tables["excitation"], {"kind": "white", "intensity": 1e-3}]}
    assert Scene.from_tables(tables | {"excitation": part}).excitation.parts[0] == scene.excitation


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"profile": "gevs-qualificaton"}, "did you mean gevs-qualification"),
        ({"profile": 3}, "must be one of gevs-qualification, gevs-acceptance"),
        ({"profile": "gevs-acceptance", "unit": "g^2/Hz"}, "unit: the profile"),
    ],
)
def test_a_profile_that_is_none_or_has_values_beside_it_is_refused(change, words):
    tables = scene_with().to_tables() | {"excitation": {"kind": "spectrum", **change}}
    with pytest.raises(SceneError, match=words):
        Scene.from_tables(tables)


@pytest.mark.parametrize(("fastest", "spacing"), [(46.0, 1 / 2000), (150.0, 1 / 6000)])
def test_knots_are_as_close_as_the_slower_of_device_and_spectrum_asks(fastest, spacing):
    """A quarter to a twelfth of the period of 500 Hz; at 46 Hz 1/1840 s would do for the device."""
    excitation = Spectrum(((10.0, 1.0), (500.0, 0.1)), "g^2/Hz")
    assert excitation.spacing(1.0 / (40.0 * fastest)) == pytest.approx(spacing)
    assert excitation.spacing(1.0 / (40.0 * 400.0)) == pytest.approx(1 / 16000)
    # Of a flat spectrum the knots have 1/sinc⁴, on average, at four knots a period.
    flat = Spectrum(((1e-3, 1.0), (500.0, 1.0)), "(m/s^2)^2/Hz")
    square = quad(lambda x: (math.pi * x / math.sin(math.pi * x)) ** 4, 1e-9, 0.25)[0] / 0.25
    (line,) = [line for line in flat.notes(1 / 2000, 600.0, None) if "rms of the samples" in line]
    assert f"{math.sqrt(square) - 1.0:.1%}" in line


NARROW = ((39.6, 1.0), (41.6, 1.0))
SLOPED = ((38.0, 0.001), (39.5, 1.0), (40.5, 1.0), (42.0, 0.001))
PLATEAU = ((5.0, 0.01), (39.5, 0.01), (40.0, 1.0), (41.0, 1.0), (41.5, 0.01), (500.0, 0.01))


@pytest.mark.parametrize("points", [NARROW, SLOPED, PLATEAU])
def test_the_density_inside_a_narrow_band_is_right(points):
    """Within 0.5 % away from edges, by the filter itself: nothing is by chance."""
    frequencies, density = path_density(points, 1.0 / 2000.0)
    places = np.array([40.1, 40.2, 40.4, 40.8])
    inside = np.interp(places, frequencies, density)
    np.testing.assert_allclose(inside, density_between(points, places), rtol=0.005)
    # What the edges lose is less than a hundredth, and is not given to the interior.
    square = density.sum() * frequencies[1] / mean_square(points)
    assert 0.99 < square < 1.0


def test_what_a_filter_at_its_longest_loses_is_noted():
    lines = Spectrum(((40.2, 1.0), (40.25, 1.0)), "(m/s^2)^2/Hz").notes(6e-4, 253.0, None)
    (line,) = [line for line in lines if "at edges and peaks" in line]
    # Two edges of a band of 0.05 Hz, each blurred over 0.0031 Hz.
    assert "resolves 0.0032 Hz" in line
    assert "2.4%" in line
