"""Figure of an identification: measurement and prediction by the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.identification.sensors import OUTPUT_UNITS
from harvester.identification.validation_record import ResponseRecord
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import Panel, Series, draw_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURED, PREDICTED, RESIDUAL = "0.35", CIRCUIT, MONTE_CARLO
SHOWN_PERIODS = 12.0
BINS = 60
# Number of segments over which a spectrum is averaged.
SEGMENTS = 12


def draw(identification: Any) -> Figure:
    """Draw an `Identification`'s prediction of the first record's validation data.

    Panels are waveforms, spectra, densities and the residuals' autocorrelation; for a response its
    outputs.
    """
    record = identification.fitted.records[0]
    panels = (
        _of_lines(record)
        if isinstance(record, ResponseRecord)
        else _in_time(identification, record)
    )
    title = f"{identification.scene.name}: {record.aside} of {record.name}, validation data"
    return draw_panels(panels, title, size=(4.6, 2.9), columns=2)


def _compared(x, columns, labels, width=2.2, **shown):
    """Series of the measured and the predicted columns, and of the residuals."""
    styles = ((MEASURED, width), (PREDICTED, 1.0), (RESIDUAL, 0.8))
    return [
        Series(x, y, label, colour=colour, width=thickness, **shown)
        for y, label, (colour, thickness) in zip(columns, labels, styles, strict=False)
    ]


def _of_lines(record):
    """Panels of a response's outputs: validation lines, their prediction, and the difference."""
    panels = []
    for n, name in enumerate(record.outputs):
        label = f"{name} [rad]" if name == "phase" else name
        label = label if record.quantity == "impedance" else f"{name} of voltage over acceleration"
        columns = [values[:, n] for values in (record.measured, record.windowed, record.residuals)]
        labels = ("measured", "predicted", "difference")
        panels.append(Panel("frequency [Hz]", label, _compared(record.frequency, columns, labels)))
    return panels


def _in_time(identification, record):
    """Panels of a time record."""
    from scipy import signal

    name, values = record.outputs[0], record.measured[:, 0]
    unit = OUTPUT_UNITS[name] if identification.scene.units == "SI" else "scaled"
    crossings = np.count_nonzero(np.diff(np.sign(values - values.mean())))
    count = int(min(values.size, SHOWN_PERIODS * 2.0 * values.size / max(crossings, 1)))
    waves = [part[:count, 0] for part in (record.measured, record.windowed, record.residuals)]
    segment = max(16, values.size // SEGMENTS)
    series = np.column_stack([values, record.free[:, 0], record.residuals[:, 0]])
    f, densities = signal.welch(series, record.rate, nperseg=segment, axis=0)
    both = series[:, :2]
    bins = np.linspace(both.min(), both.max(), BINS + 1)
    shares = [np.histogram(column, bins, density=True)[0] for column in both.T]
    white = identification.records[0].whiteness()
    lags = np.arange(1, white.correlations.size + 1) / record.rate
    labels = ("measured", "predicted", "residuals in windows")
    quantity, unlabelled = f"{name} [{unit}]", (None,) * 3
    return [
        Panel("time [s]", quantity, _compared(np.arange(count) / record.rate, waves, unlabelled)),
        Panel(
            "frequency [Hz]",
            f"density of the {name} [{unit}²/Hz]",
            _compared(f[1:], densities[1:].T, labels),
            log_y=True,
        ),
        Panel(
            quantity,
            "probability density",
            _compared(0.5 * (bins[1:] + bins[:-1]), shares, unlabelled),
            # Values in volts have long labels: more than seven would overlap.
            more=lambda axes: axes.locator_params(axis="x", nbins=6),
        ),
        Panel(
            "lag [s]",
            "autocorrelation of residuals",
            [Series(lags, white.correlations, colour=RESIDUAL, width=1.0)],
            more=lambda axes: axes.axhspan(-white.bound, white.bound, color="0.85", lw=0),
        ),
    ]


def draw_posterior(identification: Any) -> Figure:
    """Draw the posterior of every value and of every pair; 95 % sandwich intervals are grey."""
    from matplotlib.figure import Figure

    sampled: Any = identification.posterior
    keys, draws = sampled.keys, sampled.draws
    figure = Figure(figsize=(2.0 * len(keys) + 1.0, 2.0 * len(keys) + 1.0))
    panels: Any = figure.subplots(len(keys), len(keys), squeeze=False, sharex="col")
    for row, column in np.ndindex(panels.shape):
        axes = panels[row, column]
        if column > row:
            axes.remove()
            continue
        axes.axvspan(*identification.intervals[keys[column]], color="0.85", lw=0)
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
