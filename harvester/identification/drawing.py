"""Figure of an identification: measurement and prediction by the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.identification.sensors import OUTPUT_UNITS
from harvester.identification.validation_record import ResponseRecord
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import legend_below, set_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURED, PREDICTED, RESIDUAL = "0.35", CIRCUIT, MONTE_CARLO
SHOWN_PERIODS = 12.0
BINS = 60
# Number of segments that a spectrum is averaged over.
SEGMENTS = 12


def draw(found: Any) -> Figure:
    """Draw an `Identification`'s prediction of the first record's validation part.

    Panels are waveforms, spectra, densities and the residuals' correlation.
    """
    from matplotlib.figure import Figure

    record = found.fitted.records[0]
    if isinstance(record, ResponseRecord):
        return _response_figure(found, record)
    figure = Figure(figsize=(10.0, 6.4))
    wave, spectrum, density, correlation = figure.subplots(2, 2).ravel()
    name = record.outputs[0]
    unit = OUTPUT_UNITS[name] if found.scene.units == "SI" else "scaled"
    _draw_waveform(wave, record, f"{name} [{unit}]")
    _draw_spectra(spectrum, record, f"density of the {name} [{unit}²/Hz]")
    _draw_densities(density, record, f"{name} [{unit}]")
    _draw_correlation(correlation, found)
    legend_below(figure, [spectrum])
    set_title(figure, f"{found.scene.name}: the {record.aside} of {record.name}, kept aside")
    return figure


def _response_figure(found, record):
    """Validation lines, the model's prediction, and their difference."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.0))
    panels = figure.subplots(1, len(record.outputs), squeeze=False)[0]
    for n, (axes, name) in enumerate(zip(panels, record.outputs, strict=True)):
        axes.plot(record.frequency, record.measured[:, n], ".", color=MEASURED, label="measured")
        axes.plot(record.frequency, record.windowed[:, n], color=PREDICTED, label="predicted")
        axes.plot(record.frequency, record.residuals[:, n], color=RESIDUAL, label="difference")
        of = f"{name} [rad]" if name == "phase" else name
        of = of if record.quantity == "impedance" else f"{name} of voltage over acceleration"
        axes.set(xlabel="frequency [Hz]", ylabel=of)
    legend_below(figure, panels[:1])
    set_title(figure, f"{found.scene.name}: {record.aside} of {record.name}, kept aside")
    return figure


def draw_posterior(found: Any) -> Figure:
    """Draws of every value and of every pair of them; 95 % intervals of the sandwich in grey."""
    from matplotlib.figure import Figure

    sampled: Any = found.posterior
    keys, draws = sampled.keys, sampled.draws
    figure = Figure(figsize=(2.0 * len(keys) + 1.0, 2.0 * len(keys) + 1.0))
    panels: Any = figure.subplots(len(keys), len(keys), squeeze=False, sharex="col")
    for row, column in np.ndindex(panels.shape):
        axes = panels[row, column]
        if column > row:
            axes.remove()
            continue
        axes.axvspan(*found.intervals[keys[column]], color="0.85", lw=0)
        if column == row:
            axes.hist(draws[:, row], BINS // 2, color=PREDICTED)
        else:
            pair = draws[:, column], draws[:, row]
            axes.hist2d(*pair, BINS // 2, cmap="Blues", cmin=1, rasterized=True)
        axes.set(yticks=[])
        axes.locator_params(axis="x", nbins=3)
        if row == len(keys) - 1:
            axes.set(xlabel=keys[column].rpartition(".")[2])
        if column == 0 and row > 0:
            axes.set(ylabel=keys[row].rpartition(".")[2])
    return figure


def _draw_waveform(axes, record, label):
    values = record.measured[:, 0]
    crossings = np.count_nonzero(np.diff(np.sign(values - values.mean())))
    per_period = 2.0 * values.size / max(crossings, 1)
    count = int(min(values.size, SHOWN_PERIODS * per_period))
    time = np.arange(count) / record.rate
    axes.plot(time, values[:count], color=MEASURED, lw=2.2)
    axes.plot(time, record.windowed[:count, 0], color=PREDICTED, lw=1.0)
    axes.plot(time, record.residuals[:count, 0], color=RESIDUAL, lw=0.8)
    axes.set(xlabel="time [s]", ylabel=label)


def _draw_spectra(axes, record, label):
    from scipy import signal

    segment = max(16, record.measured.shape[0] // SEGMENTS)
    for values, colour, text, width in (
        (record.measured, MEASURED, "measured", 2.2),
        (record.free, PREDICTED, "predicted", 1.0),
        (record.residuals, RESIDUAL, "residuals in windows", 0.8),
    ):
        f, density = signal.welch(values[:, 0], record.rate, nperseg=segment)
        axes.semilogy(f[1:], density[1:], color=colour, lw=width, label=text)
    axes.set(xlabel="frequency [Hz]", ylabel=label)


def _draw_densities(axes, record, label):
    both = np.concatenate([record.measured[:, 0], record.free[:, 0]])
    bins = np.linspace(both.min(), both.max(), BINS + 1)
    for values, colour, width in (
        (record.measured, MEASURED, 2.2),
        (record.free, PREDICTED, 1.0),
    ):
        share, _ = np.histogram(values[:, 0], bins, density=True)
        axes.stairs(share, bins, color=colour, lw=width)
    axes.set(xlabel=label, ylabel="probability density")
    # Volts have long labels: more than seven would touch.
    axes.locator_params(axis="x", nbins=6)


def _draw_correlation(axes, found):
    record = found.records[0]
    white, rate = record.whiteness(), record.rate
    lags = np.arange(1, white.correlations.size + 1) / rate
    axes.plot(lags, white.correlations, color=RESIDUAL, lw=1.0)
    axes.axhspan(-white.bound, white.bound, color="0.85", lw=0)
    axes.set(xlabel="lag [s]", ylabel="autocorrelation of residuals")
