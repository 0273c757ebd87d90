import numpy as np
import pytest
from scipy import signal
from truths import flat

from harvester.averaging.of_scene import average
from harvester.device import timescales
from harvester.excitation.ornstein_uhlenbeck import OrnsteinUhlenbeck
from harvester.excitation.spectrum_fit import fit_spectrum
from harvester.results import figures
from harvester.scene.model import Scene

INTENSITY, TIME = 0.02, 0.4


def recorded(folder, samples, rate=40.0, **keys):
    """The device of `paper` under a record."""
    np.save(folder / "motion.npy", samples)
    tables = Scene.read("paper").to_tables()
    tables["excitation"] = {
        "kind": "record",
        "file": str(folder / "motion.npy"),
        "unit": "scaled",
        "sampling_rate": rate,
        **keys,
    }
    tables["run"] = {"duration": 100.0}
    return Scene.from_tables(tables, name="paper")


def noise(seed, count=24001):
    """600 s of the source paper's noise at 40 Hz."""
    noise = OrnsteinUhlenbeck(INTENSITY, TIME)
    return noise.path(0.025, 1.0, np.random.SeedSequence(seed)).read(count)


def device_frequency(scene):
    return timescales.angular_frequency(flat(scene).system) / (2 * np.pi)


def test_the_fit_finds_the_noise_with_errors_that_hold(tmp_path):
    """Thirty records: the mean deviation in errors, and their spread; 1 % false alarms.

    Sampling folds the tail back, so that τ1 may be too short by a fiftieth.
    """
    deviations = []
    for seed in range(30):
        scene = recorded(tmp_path, noise(seed))
        fit = fit_spectrum(scene.excitation, device_frequency(scene))
        deviations.append(
            [
                (fit.intensity - INTENSITY) / fit.intensity_error,
                (fit.correlation_time - TIME) / fit.correlation_time_error,
            ]
        )
        assert fit.intensity_error < 0.15 * INTENSITY
        assert fit.correlation_time_error < 0.15 * TIME
    folding = 0.02 * TIME / fit.correlation_time_error
    mean, spread = np.mean(deviations, axis=0), np.std(deviations, axis=0)
    assert abs(mean[0]) < 2.8 / np.sqrt(30)
    assert -2.8 / np.sqrt(30) - folding < mean[1] < 2.8 / np.sqrt(30)
    # χ² of 29 degrees: within ±35 % of 1 at 1 %.
    assert np.all(np.abs(spread - 1.0) < 0.35)


def test_record_and_fit_have_no_more_than_all_of_their_variance_in_common(tmp_path):
    """A band of noise: ∫|P − S| is over twice ∫P, as the fit is high where there is none."""
    assert fit_spectrum(recorded(tmp_path, noise(1)).excitation, 0.469).unexplained < 0.2
    band = signal.butter(4, [2.0, 4.5], "bandpass", fs=40.0, output="sos")
    white = np.random.default_rng(2).normal(size=24001)
    fit = fit_spectrum(recorded(tmp_path, signal.sosfiltfilt(band, white)).excitation, 0.469)
    assert abs(fit.density - fit.fitted).sum() > 2.0 * fit.density.sum()
    assert 0.5 < fit.unexplained < 1.0
    shared = f"only {1.0 - fit.unexplained:.0%} of their variance in common"
    assert any(shared in reason for reason in fit.reasons)


@pytest.mark.slow
def test_averaging_takes_the_fitted_noise_and_shows_it(tmp_path):
    scene = recorded(tmp_path, noise(1))
    result = average(scene, fit=True)
    fit = result.spectrum_fit
    assert not fit.reasons
    changes = {"intensity": fit.intensity, "correlation_time": fit.correlation_time}
    expected = average(Scene.read("paper").replace(excitation=changes)).scaled_quantities
    for name, estimate in result.scaled_quantities.items():
        assert estimate.estimate == pytest.approx(expected[name].estimate, rel=1e-9)
    assert "D = 0.0" in result.notes[0]
    assert "close to it" in result.notes[1]
    content = result.to_dict()
    assert content["spectrum_fit"]["far"] is False
    assert content["scene"]["excitation"]["kind"] == "record"


@pytest.mark.slow
def test_the_fit_is_in_the_figure(tmp_path):
    result = average(recorded(tmp_path, noise(1)), fit=True)
    figure = result.figure()
    panels = [axes.get_xlabel() for axes in figure.axes]
    figures.write(figure, tmp_path / "fit.png")
    assert panels[-1] == "frequency [Hz]"
    assert len(panels) == 1 + len(result.densities)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tone", "low-pass", "envelope"])
def test_a_record_that_is_no_such_noise_is_called_far(tmp_path, kind):
    samples = noise(1)
    time = 0.025 * np.arange(samples.size)
    word = "dB"
    if kind == "tone":
        # At the device's own frequency.
        samples += 0.5 * np.sin(2 * np.pi * 0.469 * time)
    elif kind == "low-pass":
        samples = signal.sosfiltfilt(signal.butter(2, 0.2, fs=40.0, output="sos"), samples)
    else:
        samples = samples * np.exp(-((time - 200.0) ** 2) / 80.0**2)
        word = "kurtosis"
    notes = average(recorded(tmp_path, samples), fit=True).notes
    assert "FAR from Ornstein–Uhlenbeck" in notes[1]
    assert word in notes[1]
