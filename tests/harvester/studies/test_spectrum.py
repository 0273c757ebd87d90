"""What `harvester spectrum` says of records whose density and moments are known."""

import itertools
import math

import numpy as np
import pytest

import harvester
from harvester.base.errors import HarvesterError
from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.studies.spectrum import SpectrumAnalysis

RATE, ROWS = 500.0, 60_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """White noise of density 2 σ²/rate; the same of a strength that drifts; with bursts."""
    place = tmp_path_factory.mktemp("records")
    rng = np.random.default_rng(11)
    white = rng.standard_normal(ROWS)
    np.save(place / "white.npy", white + 0.5)
    np.save(place / "drift.npy", white * np.linspace(0.5, 1.5, ROWS))
    np.save(place / "laplace.npy", rng.laplace(size=ROWS))
    return place


def analysed(folder, name, **more):
    return harvester.spectrum(folder / name, unit="m/s^2", sampling_rate=RATE, **more)


def test_white_noise_is_flat_gaussian_and_stationary(folder):
    found = analysed(folder, "white.npy")
    assert found.rms == pytest.approx(1.0, rel=0.01)
    assert found.bandwidth == pytest.approx(RATE / 2.0, rel=0.05)
    low, high = found.confidence_band
    inside = (found.density * low < 2.0 / RATE) & (found.density * high > 2.0 / RATE)
    assert inside.mean() == pytest.approx(0.95, abs=0.02)
    kurtosis, error = found.kurtosis()
    # √(24/n) is the standard error of independent values.
    assert error == pytest.approx(math.sqrt(24.0 / ROWS), rel=0.5)
    assert abs(kurtosis - 3.0) < 3.0 * error
    assert found.runs_test()[1] > 0.01
    assert not any("not " in line for line in found.sentences())


def test_errors_and_p_values_of_gaussian_noise_hold():
    """Of 150 records: deviations over errors have a mean square of 1, p-values a mean of a half.

    Of 32 stretches each error is known to 13 %, so that the mean square is 1.07; p-values of whole
    numbers of runs are 0.05 above a half.
    """
    draws, off, probabilities = np.random.default_rng(1), [], []
    nothing = np.array([1.0, 2.0])
    for _ in range(150):
        values = draws.normal(size=(32, 200))
        moments = np.stack([np.mean(values**k, axis=1) for k in (1, 2, 3, 4)], axis=1)
        found = SpectrumAnalysis(
            "noise", None, "SI", nothing, nothing, 1.0, 64, 1.0, moments, nothing, (1.0, 0.0), 0.0
        )  # fmt: skip
        (kurtosis, error), (skewness, spread) = found.kurtosis(), found.skewness()
        off.append(((kurtosis - 3.0) / error, skewness / spread))
        probabilities.append(found.runs_test()[1])
    assert np.mean(np.square(off), axis=0) == pytest.approx([1.07, 1.07], rel=0.3)
    assert np.mean(probabilities) == pytest.approx(0.55, abs=0.1)


def test_drift_and_bursts_are_told(folder):
    assert any("not stationary" in line for line in analysed(folder, "drift.npy").sentences())
    found = analysed(folder, "laplace.npy")
    assert found.kurtosis()[0] == pytest.approx(6.0, rel=0.1)
    assert any("not Gaussian" in line for line in found.sentences())


@pytest.mark.parametrize("frequency", [46.0, 46.39, 2.39, 7.3])
def test_a_steady_sine_does_not_drift_and_a_growing_one_does(tmp_path, frequency):
    """Whether its stretches alternate (46 Hz) or beat slowly with them."""
    time = np.arange(10_000) / RATE
    sine = 2.0 * np.sin(2.0 * np.pi * frequency * time)
    np.save(tmp_path / "sine.npy", sine)
    np.save(tmp_path / "growing.npy", sine * np.linspace(0.8, 1.2, time.size))
    said = [analysed(tmp_path, f"{name}.npy").sentences() for name in ("sine", "growing")]
    assert ["not stationary" in "".join(lines) for lines in said] == [False, True]


def test_a_record_becomes_a_specification(folder, tmp_path, capsys):
    """The scene that takes it has the record's rms; its device's power is that of white noise."""
    command = ["spectrum", str(folder / "white.npy"), "--unit", "m/s^2", "--sampling-rate", "500"]
    assert main([*command, "--breakpoints", "3", "--output", str(tmp_path), "--quiet"]) == 0
    capsys.readouterr()
    (file,) = tmp_path.glob("*-profile.csv")
    scene = Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {"mass": 0.0141, "damping": 0.22, "linear_stiffness": 1158.0},
            "piezo": {"coupling": 2.327e-3, "capacitance": 41.26e-9},
            "load": {"resistance": 47e3},
            "excitation": {
                "kind": "spectrum",
                "unit": "(m/s^2)^2/Hz",
                "breakpoints": str(file),
            },
            "run": {"duration": 60.0, "seed": 3},
        }
    )
    assert len(scene.excitation.breakpoints) == 3
    power = harvester.average(scene, method="spectral").quantities["mean_power"].estimate
    white = scene.to_tables() | {"excitation": {"kind": "white", "intensity": 0.5 / RATE}}
    exact = harvester.average(Scene.from_tables(white), method="spectral").quantities["mean_power"]
    assert power == pytest.approx(exact.estimate, rel=0.2)


PEAK = [[38.0, 0.001], [39.5, 1.0], [40.5, 1.0], [42.0, 0.001]]
PLATEAU = [[5.0, 0.01], [39.5, 0.01], [40.0, 1.0], [41.0, 1.0], [41.5, 0.01], [300.0, 0.01]]


def shaken(breakpoints, frequency=40.0, quality=40.0, **run):
    spectrum = {"kind": "spectrum", "unit": "(m/s^2)^2/Hz", "breakpoints": breakpoints}
    return Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {"mass": 0.01, "frequency": frequency, "quality_factor": quality},
            # A coupling this weak leaves the quality factor to the damper.
            "piezo": {"coupling": 1e-5, "capacitance": 50e-9},
            "load": {"resistance": 80e3},
            "excitation": spectrum,
            "run": {"duration": 60.0, "settle": 5.0, "seed": 1, **run},
        }
    )


def power(breakpoints, frequency, quality):
    scene = shaken(breakpoints, frequency, quality)
    return harvester.average(scene, method="spectral").quantities["mean_power"].estimate


@pytest.mark.parametrize("points", [PEAK, PLATEAU])
def test_a_specification_keeps_the_power_of_a_device(points):
    """Of a scene's own spectrum, at any frequency in it and Q up to 100, within 5 %, exactly."""
    found = harvester.spectrum(shaken(points), breakpoints=20)
    assert abs(found.departure[1]) < 0.05
    assert not any("use more" in line for line in found.sentences())
    for frequency in (38.5, 39.4, 40.0, 40.6, 41.5):
        for quality in (10.0, 40.0, 100.0):
            kept = power(found.profile.tolist(), frequency, quality)
            assert kept == pytest.approx(power(points, frequency, quality), rel=0.05)


def test_too_few_breakpoints_are_told_with_the_device_that_loses_most():
    found = harvester.spectrum(shaken(PEAK), breakpoints=4)
    frequency, share = found.departure
    centre, width, _ = found.device_band()
    assert found.quality == pytest.approx(centre / width)
    kept = power(found.profile.tolist(), frequency, found.quality)
    assert kept / power(PEAK, frequency, found.quality) - 1.0 == pytest.approx(share, abs=0.02)
    (line,) = [line for line in found.sentences() if "use more" in line]
    assert f"Q = {found.quality:.3g} changes most at {frequency:.4g} Hz, by {share:+.1%}" in line


def test_a_specification_of_known_noise_has_its_density_however_short_the_path():
    scene = Scene.read("linear")
    found = harvester.spectrum(scene, duration=200.0 * scene.excitation.correlation_time)
    low = found.profile[0, 0], 1.0 / found.profile[-1, 0]
    assert low[0] == pytest.approx(1.0 / found.duration, rel=0.01)
    frequencies = np.geomspace(3.0 * low[0], 0.3 / low[1], 50)
    lines = np.exp(np.interp(np.log(frequencies), *np.log(found.profile.T)))
    assert lines == pytest.approx(scene.excitation.density(frequencies), rel=0.1)
    assert not any("too short to resolve" in line for line in found.sentences())


def test_a_sine_has_no_specification(tmp_path):
    np.save(tmp_path / "sine.npy", np.sin(2.0 * np.pi * 40.3 / RATE * np.arange(ROWS)))
    found = harvester.spectrum(tmp_path / "sine.npy", unit="m/s^2", sampling_rate=RATE)
    assert found.rms == pytest.approx(0.5**0.5, rel=1e-3)
    assert any(
        "no specification: the density is a single line" in line for line in found.sentences()
    )
    assert not found.texts()
    assert found.figure().axes


def test_a_line_near_the_device_is_not_within_its_band(tmp_path):
    """Against the record's own periodogram: the half width is 1 Hz, the line 0.9 Hz outside."""
    device = Scene.read("cantilever", ["oscillator.damping_ratio=0.02"])
    centre, width, _ = harvester.spectrum(device, duration=20.0).device_band()
    time = np.arange(int(40.0 * 500.0)) / 500.0
    values = np.random.default_rng(3).normal(size=time.size)
    values += np.sqrt(2.0) * np.sin(2.0 * np.pi * (centre - 0.5 * width - 0.9) * time)
    np.save(tmp_path / "line.npy", values)
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    f = np.fft.rfftfreq(time.size, 1.0 / 500.0)
    share = power[abs(f - centre) < 0.5 * width].sum() / power.sum()
    keys = {"unit": "m/s^2", "sampling_rate": 500.0, "device": device}
    found = harvester.spectrum(tmp_path / "line.npy", **keys)
    # Segments of Hann weigh the parts of the noise differently: 80 values scatter by 11 %.
    assert found.device_band() == pytest.approx((centre, width, share), rel=0.35)
    coarse = harvester.spectrum(tmp_path / "line.npy", resolution=1.5, **keys)
    assert coarse.table()[1][-1][-1].endswith("of the power, lines within 1.5 Hz of it included")


@pytest.mark.slow
def test_a_record_s_specification_keeps_the_power_that_the_record_gives(tmp_path):
    """Within 5 % of ∫ |H|² over the record's own periodogram: nothing is by chance but the path."""
    ready = prepared(shaken(PEAK))
    path = noise_path(ready, 0)
    values = ready.excitation_unit * path.read(int(120.0 / path.spacing))
    np.save(tmp_path / "peak.npy", values)
    found = harvester.spectrum(
        tmp_path / "peak.npy", unit="m/s^2", sampling_rate=1.0 / path.spacing, breakpoints=20
    )
    # Segments of 30 s resolve 1.5/30 Hz, a quarter of the width of Q = 100 at 20 Hz.
    assert found.resolved_from == pytest.approx(20.0, rel=0.01)
    density = 2.0 * path.spacing / values.size * np.abs(np.fft.rfft(values)) ** 2
    f = np.fft.rfftfreq(values.size, path.spacing)
    fine = np.geomspace(found.profile[0, 0], found.profile[-1, 0], 20_001)
    lines = np.exp(np.interp(np.log(fine), *np.log(found.profile).T))
    for centre in (39.0, 40.0, 40.5, 41.0):
        for quality in (20.0, 100.0):

            def response(f, centre=centre, quality=quality):
                return f**2 / ((centre**2 - f**2) ** 2 + (centre * f / quality) ** 2)

            recorded = float((response(f) * density).sum()) * f[1]
            specified = np.trapezoid(response(fine) * lines, fine)
            assert specified == pytest.approx(recorded, rel=0.05)


def test_of_a_scene_and_what_is_refused(folder):
    scene = Scene.read("linear")
    found = harvester.spectrum(scene, duration=2000.0)
    noise = scene.excitation
    assert found.rms**2 == pytest.approx(noise.intensity / noise.correlation_time, rel=0.1)
    centre, width, share = found.device_band()
    assert 0.0 < share < 1.0
    assert width > 0.0
    assert centre > 0.0
    louder = [f"excitation.intensity={4.0 * noise.intensity}"]
    doubled = harvester.spectrum("linear", overrides=louder, duration=2000.0)
    assert doubled.rms == pytest.approx(2.0 * found.rms)
    with pytest.raises(HarvesterError, match="is for a record"):
        harvester.spectrum("linear", unit="g")
    with pytest.raises(HarvesterError, match=r"overrides: is for a scene, .*: give device"):
        harvester.spectrum(folder / "white.npy", overrides=louder)
    with pytest.raises(HarvesterError, match=r"8e\+14 values .* at most 1.25e\+06"):
        harvester.spectrum("device", duration=1e12)
    with pytest.raises(HarvesterError, match="is for a scene"):
        harvester.spectrum(folder / "white.npy", duration=1.0)
    with pytest.raises(HarvesterError, match="use a longer duration"):
        harvester.spectrum("linear", duration=0.5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(10))
def test_an_hour_has_the_density_of_a_drawn_profile(seed):
    """Every sixth octave within 0.5 dB, rms within 1 %, of straight lines drawn at random."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 9))
    ends = [rng.uniform(5.0, 20.0), rng.uniform(300.0, 2000.0)]
    frequencies = np.sort([*ends, *np.exp(rng.uniform(*np.log(ends), count - 2))])
    densities = 10.0 ** rng.uniform(-4.0, -1.0, count)
    excitation = {
        "kind": "spectrum",
        "unit": "(m/s^2)^2/Hz",
        "breakpoints": [[float(f), float(g)] for f, g in zip(frequencies, densities, strict=True)],
    }
    scene = Scene.read("bimorph").replace({"run.seed": seed}).to_tables()
    found = harvester.spectrum(Scene.from_tables(scene | {"excitation": excitation}), duration=3600)
    fine = np.geomspace(*ends, 1_000_001)
    wanted = np.exp(np.interp(np.log(fine), np.log(frequencies), np.log(densities)))
    assert found.rms == pytest.approx(math.sqrt(np.trapezoid(wanted, fine)), rel=0.01)
    edges = ends[0] * 2.0 ** (np.arange(int(6.0 * math.log2(ends[1] / ends[0])) + 1) / 6.0)
    worst = 0.0
    for low, high in itertools.pairwise(edges):
        inside = (found.frequencies >= low) & (found.frequencies < high)
        exact = np.interp(np.linspace(low, high, 1001), fine, wanted).mean()
        worst = max(worst, abs(10.0 * math.log10(found.density[inside].mean() / exact)))
    print(f"seed {seed}: worst {worst:.3f} dB, rms {found.rms:.4g}")
    assert worst < 0.5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"unit": "furlong"}, "excitation.unit = 'furlong': must be one of"),
        ({"sampling_rate": -5.0}, "sampling_rate -5.0: must be a number of hertz > 0"),
        ({"mend": ["uneven times"]}, "excitation.mend"),
    ],
)
def test_options_of_a_record_are_checked_as_in_a_scene(folder, options, words):
    given = {"unit": "m/s^2", "sampling_rate": RATE, **options}
    with pytest.raises(HarvesterError, match=words):
        harvester.spectrum(folder / "white.npy", **given)


def test_a_spectrum_takes_the_mends_of_a_scene(tmp_path):
    values = np.sin(0.7 * np.arange(4000))
    values[100:103] = np.nan
    np.save(tmp_path / "gap.npy", values)
    with pytest.raises(HarvesterError, match=r'mend = \["nan"\]'):
        analysed(tmp_path, "gap.npy")
    assert analysed(tmp_path, "gap.npy", mend=["nan"]).rms == pytest.approx(0.5**0.5, rel=0.01)


def test_nothing_has_no_spectrum():
    sine = {"kind": "sine", "amplitude": 0.0, "frequency": 8.0}
    with pytest.raises(HarvesterError, match="the density is 0"):
        harvester.spectrum(Scene.read("device").replace({"excitation": sine}))
