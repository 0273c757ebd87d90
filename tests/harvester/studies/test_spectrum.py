"""What `harvester spectrum` says of records whose density and moments are known."""

import itertools
import math

import numpy as np
import pytest

import harvester
from harvester.command_line import main
from harvester.errors import HarvesterError
from harvester.scene.model import Scene

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


def test_of_a_scene_and_what_is_refused(folder):
    scene = Scene.load("linear")
    found = harvester.spectrum(scene, duration=2000.0)
    noise = scene.excitation
    assert found.rms**2 == pytest.approx(noise.intensity / noise.correlation_time, rel=0.1)
    centre, width, share = found.device_band()
    assert 0.0 < share < 1.0
    assert width > 0.0
    assert centre > 0.0
    with pytest.raises(HarvesterError, match="is for a record"):
        harvester.spectrum("linear", unit="g")
    with pytest.raises(HarvesterError, match="is for a scene"):
        harvester.spectrum(folder / "white.npy", duration=1.0)
    with pytest.raises(HarvesterError, match="take a longer one"):
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
    scene = Scene.load("bimorph").replace({"run.seed": seed}).to_tables()
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
