"""The result of a tolerance study and its computation."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import HarvesterError, OutOfTime
from harvester.base.formatting import (
    NOT_KNOWN,
    Printed,
    prefixed,
    quantity,
    share_with_error,
    with_error,
)
from harvester.base.method import Method
from harvester.base.serialising import fields_of, plain
from harvester.base.symbols import definitions
from harvester.base.tables import csv_text
from harvester.engines.request import Request
from harvester.engines.runner import Runner
from harvester.results.palette import CIRCUIT, MONTE_CARLO
from harvester.results.panels import legend_below, set_title
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.tables import key_column, key_words
from harvester.statistics.estimate import Estimate
from harvester.statistics.units import unit_of
from harvester.studies.answers import (
    first_answer,
    is_complete,
    is_noisy,
    missing_from,
    reason_of,
    value_of,
)
from harvester.studies.sensitivity.population import (
    ENDS,
    Population,
    Yield,
    effects,
    population,
    share_above,
)
from harvester.studies.sensitivity.sobol import Indices, design, indices
from harvester.studies.sensitivity.tolerances import devices, parameters

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Minimum number of rows of a design for meaningful intervals, and maximum number.
FEWEST_ROWS, MOST_ROWS = 16, 65536
# Number of runs per device, each with different noise.
REPLICATES = 2
# The study fails if more than this share of its rows fails.
LARGEST_FAILURE = 0.1
# A note states the noise's share of the measured variance if it exceeds this.
NOTED_NOISE = 0.2
COLOURS = CIRCUIT, MONTE_CARLO
BINS = 30


@dataclass(frozen=True, repr=False)
class Sensitivity(ResultBase):
    """Dependence of a quantity on parameters that scatter between devices; in the scene's units.

    Attributes
    ----------
    nominal
        The quantity for the unchanged scene.
    effects : list of (Interval, Interval)
        For each parameter: change of the quantity's mean at the parameter's 5 % and 95 % quantiles,
        averaged over the others.
    shares : ndarray, shape (rows, parameters + 2, parameters)
        The design; see `harvester.studies.sensitivity.sobol.design`.
    values : ndarray, shape (replicates, rows, parameters + 2)
    failures
        Reasons why rows were excluded.
    seconds
        Wall-clock time of this call (s).
    notes
        Note on the followed orbit, without noise.
    """

    scene: Scene
    tolerances: list
    quantity: str
    unit: str
    method: str
    nominal: Estimate
    indices: Indices
    population: Population
    effects: list
    yield_above: Yield | None
    shares: np.ndarray
    values: np.ndarray
    rows_asked: int
    failures: tuple
    out_of_time: bool
    seconds: float = 0.0
    notes: tuple = ()

    @property
    def devices(self) -> int:
        """Number of independent devices among those simulated."""
        return self.population.values.size

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            pictures=[
                Picture(draw_tornado, self, "tornado"),
                Picture(draw_distribution, self, "distribution"),
            ],
            records=self._records,
            texts=lambda: {"-devices.csv": self._devices()},
        )

    def _table(self) -> tuple:
        """Header and rows of the table as text, the most influential parameter first."""
        low, high = (f"effect at {end:.0%}" for end in ENDS)
        header = ["parameter", "values", "first-order index", "total index", low, high]
        rows = []
        for k in self.order():
            both = (self.indices.first, self.indices.total)
            index_values = [
                Printed(str(e[k]), e[k].estimate, ends=e[k].interval) if e else NOT_KNOWN
                for e in both
            ]
            effect_texts = [_signed(e, self.population.mean.estimate) for e in self.effects[k]]
            parameter = self.tolerances[k]
            rows.append([parameter.key, str(parameter), *index_values, *effect_texts])
        return header, rows

    def _records(self):
        """Header and one row per parameter: its indices and effects with their intervals."""
        low, high = (f"effect at {end:.0%} [{self.unit}]" for end in ENDS)
        columns = ["first-order index", "total index", low, high]
        header = ["parameter", "values"]
        header += [f"{name}{end}" for name in columns for end in ("", ", low", ", high")]
        rows = []
        for k in self.order():
            both = (self.indices.first, self.indices.total)
            intervals = [*(indices[k] if indices else None for indices in both), *self.effects[k]]
            numbers = [(i.estimate, i.low, i.high) if i else (None,) * 3 for i in intervals]
            rows.append(
                [self.tolerances[k].key, str(self.tolerances[k]), *itertools.chain(*numbers)]
            )
        return header, rows

    def order(self) -> list:
        """Indices of the parameters, the one with the largest total index first."""
        size = [abs(high.estimate - low.estimate) for low, high in self.effects]
        if self.indices.total is not None:
            size = [index.estimate for index in self.indices.total]
        return sorted(range(len(self.tolerances)), key=lambda k: -size[k])

    def _findings(self) -> list:
        """Sentences on the distribution, the yield and the runs."""
        name, p = self.quantity.replace("_", " "), self.population
        lines = [
            f"{name} of the unchanged scene: {with_error(self.nominal, self.unit)}; of "
            f"{self.devices} devices: mean {self._spread(p.mean)}, standard deviation "
            f"{self._spread(p.deviation)}",
            "of the devices "
            + ", ".join(
                f"{q:.0%} are below {self._spread(quantile)}" for q, quantile in p.quantiles.items()
            ),
            *definitions([self.quantity]),
        ]
        if self.yield_above is not None:
            share, limit = self.yield_above.share, quantity(self.yield_above.limit, self.unit)
            lines.append(
                f"yield: {share.estimate:.1%} ({share.low:.1%} … {share.high:.1%}) of the devices "
                f"are above {limit}; {self.yield_above.counted:.1%} as counted with "
                "the noise"
            )
        lines += [*missing_from(self.quantity, self.nominal), *self._on_noise()]
        replicates, rows, devices = self.values.shape
        lines.append(
            f"{self.method}: {rows} rows of {devices} devices × {replicates} "
            f"{'replicates' if replicates > 1 else 'run'}, seed {self.scene.run.seed}; intervals: "
            f"95 %, rows resampled; {self.seconds:.1f} s"
        )
        return [*lines, *self.notes, *self.failures]

    def _spread(self, interval):
        """A quantity's interval as text."""
        words = (
            quantity(number, self.unit)
            for number in (interval.estimate, interval.low, interval.high)
        )
        return "{} ({} … {})".format(*words)

    def _on_noise(self):
        if self.indices.first is None:
            return [
                "the parameters' scatter does not exceed the runs' noise: no indices; "
                "request a finer precision, or raise run.duration, run.realizations or rows"
            ]
        noise, of_parameters = self.indices.noise_variance, self.indices.variance.estimate
        share = noise / (noise + of_parameters)
        if len(self.values) == 1:
            return []
        advice = "; longer runs make the intervals narrower" if share > NOTED_NOISE else ""
        return [f"noise of the runs: {share:.1%} of the measured variance, removed{advice}"]

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        sobol_indices, limit = self.indices, self.yield_above
        return plain(
            {
                "scene": self.scene,
                "quantity": self.quantity,
                "unit": self.unit,
                "method": self.method,
                "nominal": {
                    "estimate": self.nominal.estimate,
                    "standard_error": self.nominal.standard_error,
                },
                "parameters": {
                    parameter.key: {
                        "distribution": parameter.kind,
                        "of": [parameter.first, parameter.second],
                        "first_order_index": sobol_indices.first and sobol_indices.first[k],
                        "total_index": sobol_indices.total and sobol_indices.total[k],
                        "effect_low": self.effects[k][0],
                        "effect_high": self.effects[k][1],
                    }
                    for k, parameter in enumerate(self.tolerances)
                },
                "variance": sobol_indices.variance,
                "noise_variance": sobol_indices.noise_variance,
                "mean": self.population.mean,
                "standard_deviation": self.population.deviation,
                "quantiles": self.population.quantiles,
                "yield": limit
                and {"above": limit.limit, **fields_of(limit.share), "counted": limit.counted},
                "devices": self.devices,
                "rows": self.values.shape[1],
                "rows_asked": self.rows_asked,
                "replicates": len(self.values),
                "outcome": "out of time" if self.out_of_time else "complete",
                "notes": [*self._on_noise(), *self.notes, *self.failures],
                "seconds": self.seconds,
            }
        )

    def _devices(self):
        """CSV: one line for each simulated device, its parameters and its values."""
        varied = parameters(self.tolerances, self.shares[0][0])
        replicates = (f"replicate_{k + 1}" for k in range(len(self.values)))
        header = ["row", "device", *(key_column(key, self.scene.units) for key in varied)]
        header += [f"{replicate} {self.quantity} [{self.unit}]" for replicate in replicates]
        names = ["a", "b", *(f"a with b's {parameter.key}" for parameter in self.tolerances)]
        rows = [
            [
                row,
                name,
                *parameters(self.tolerances, shares[column]).values(),
                *self.values[:, row, column],
            ]
            for row, shares in enumerate(self.shares)
            for column, name in enumerate(names)
        ]
        return csv_text(header, rows)


def study_of(
    scene: Scene,
    tolerances: list,
    quantity: str,
    method: Method,
    above: float | None,
    shape: tuple[int, int],
    precision: float | None,
    runner: Runner,
) -> Sensitivity:
    """Compute a `Sensitivity` except its wall time; `shape` is (rows, devices in a row)."""
    nominal = first_answer(runner, Request(scene, method))
    shares = design(shape[0], len(tolerances), scene.run.seed)
    replicates = REPLICATES if is_noisy(scene, method) else 1
    scenes = devices(scene, tolerances, shares, replicates)
    asked: dict[str, Any] = {"precision": precision, "quantities": (quantity,)}
    answers = runner.answer([Request(device, method, **asked) for row in scenes for device in row])
    failures = [reason_of(run) for run in answers if run is not None and not is_complete(run)]
    values = np.array([value_of(run, quantity) for run in answers]).reshape(*shape, replicates)
    complete = np.isfinite(values).all(axis=(1, 2))
    _check_rows(complete, failures, runner.out_of_time)
    values = np.moveaxis(values[complete], 2, 0)
    sobol_indices = indices(values, scene.run.seed)
    return Sensitivity(
        scene=scene,
        tolerances=tolerances,
        quantity=quantity,
        unit=unit_of(scene, nominal.in_units()[quantity].dimension),
        method=method.name,
        nominal=nominal.in_units()[quantity],
        indices=sobol_indices,
        population=population(values[:, :, :2], sobol_indices.variance, scene.run.seed),
        effects=effects(shares[complete], values.mean(axis=0), scene.run.seed),
        yield_above=None if above is None else share_above(values[:, :, :2], above),
        shares=shares[complete],
        values=values,
        rows_asked=shape[0],
        notes=nominal.on_orbits,
        failures=_notes(complete, failures, runner.out_of_time),
        out_of_time=runner.out_of_time,
    )


def _check_rows(complete, failures, out_of_time):
    if complete.sum() >= FEWEST_ROWS and (out_of_time or complete.mean() >= 1.0 - LARGEST_FAILURE):
        return
    if failures:
        raise HarvesterError(
            f"{len(failures)} devices failed, and {complete.sum()} of {complete.size} rows are "
            f"complete: {failures[0]}"
        )
    raise OutOfTime(
        f"the time budget was spent after {complete.sum()} of {complete.size} rows, but indices "
        f"need {FEWEST_ROWS}"
    )


def _notes(complete, failures, out_of_time):
    lines = []
    if failures:
        lines.append(
            f"{len(failures)} runs failed; their rows are excluded, also from the "
            f"yield: {failures[0]}"
        )
    if out_of_time:
        lines.append(f"out of time: {complete.sum()} of {complete.size} rows")
    return tuple(lines)


def _signed(effect, mean):
    """An effect as a share of the mean, followed by half the width of its interval."""
    if mean == 0.0:
        return NOT_KNOWN
    share, ends = effect.estimate / mean, sorted((effect.low / mean, effect.high / mean))
    text = share_with_error(Estimate(share, 0.5 * (ends[1] - ends[0]), None, "1"))
    return Printed(text, share, None, "1", (ends[0], ends[1]))


def draw_tornado(study: Sensitivity) -> Figure:
    """Draw each parameter's effect on the quantity, with its Sobol indices."""
    from matplotlib.figure import Figure

    order = study.order()[::-1]
    names = [key_words(study.tolerances[k].key, study.scene.units)[0] for k in order]
    figure = Figure(figsize=(8.0, 1.5 + 0.5 * len(names)))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.3, 1.0))
    _draw_effects(left, study, order)
    left.set_yticks(range(len(names)), names)
    left.set_ylim(-0.7, len(names) - 0.3)
    _draw_indices(right, study, order)
    legend_below(figure, [left, right])
    set_title(
        figure,
        f"{study.scene.name}: {study.quantity.replace('_', ' ')} by {study.method}, bars: 95 % "
        "intervals",
    )
    return figure


def _draw_effects(axes, study, order):
    # If the mean is 0, all changes are 0 too.
    mean = abs(study.population.mean.estimate) or 1.0
    for end, (colour, label) in enumerate(
        zip(COLOURS, ("low: 5 % of devices are below", "high: 95 % are below"), strict=True)
    ):
        at_end = [study.effects[k][end] for k in order]
        widths = 100.0 * np.array([effect.estimate for effect in at_end]) / mean
        ends = 100.0 * np.array([[effect.low, effect.high] for effect in at_end]).T / mean
        # The two bars are one above the other, since both may have the same sign.
        heights = np.arange(len(order)) + (0.14, -0.14)[end]
        axes.barh(heights, widths, height=0.26, color=colour, label=label)
        axes.errorbar(widths, heights, xerr=_bars(widths, ends), fmt="none", color="0.2", capsize=2)
    axes.axvline(0.0, color="0.2", linewidth=0.8)
    axes.set_xlabel("change of the mean where a parameter is low or high [%]")


def _draw_indices(axes, study, order):
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the variance")
    if study.indices.first is None:
        axes.text(0.5, 0.5, "hidden by noise", transform=axes.transAxes, ha="center")
        return
    pairs = (
        ("first-order", study.indices.first, "o", 0.12),
        ("total", study.indices.total, "s", -0.12),
    )
    for name, intervals, marker, height in pairs:
        values = np.array([intervals[k].estimate for k in order])
        ends = np.array([[intervals[k].low, intervals[k].high] for k in order]).T
        axes.errorbar(
            values,
            np.arange(len(order)) + height,
            xerr=_bars(values, ends),
            fmt=marker,
            markersize=4,
            capsize=2,
            color="0.1" if name == "total" else "0.55",
            label=f"{name} Sobol index",
        )
    axes.set_xlim(min(0.0, axes.dataLim.x0) - 0.02, max(1.0, axes.dataLim.x1) + 0.02)


def _bars(values, ends):
    """Lengths of error bars; 0 on a side where a resampled interval does not reach its estimate."""
    low, high = np.minimum(*ends), np.maximum(*ends)
    return np.maximum([values - low, high - values], 0.0)


def draw_distribution(study: Sensitivity) -> Figure:
    """Draw the quantity among devices, its quantiles, the unchanged scene's value and the limit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 3.2))
    axes = figure.add_subplot()
    values = study.population.values
    hidden = study.indices.first is None
    factor, unit = prefixed(float(np.abs(values).max()), study.unit.split()[0])
    if hidden:
        # If the variance without noise is not above 0, the histogram shows the measured values with
        # noise.
        values = study.values.mean(axis=0)[:, :2].ravel()
    values = factor * values
    axes.hist(values, bins=min(BINS, max(5, values.size // 6)), density=True, color="0.8")
    for share, quantile in () if hidden else study.population.quantiles.items():
        centre, ends = factor * quantile.estimate, (factor * quantile.low, factor * quantile.high)
        axes.axvline(centre, color=COLOURS[0], linewidth=1.0)
        axes.axvspan(*ends, color=COLOURS[0], alpha=0.15, linewidth=0)
        axes.text(
            centre, 1.0, f"{share:.0%}", transform=axes.get_xaxis_transform(),
            fontsize=7, ha="center", va="bottom", color=COLOURS[0],
        )  # fmt: skip
    axes.axvline(
        factor * study.nominal.estimate, color="0.1", linestyle=":", label="unchanged scene"
    )
    if study.yield_above is not None:
        share = study.yield_above.share
        axes.axvline(
            factor * study.yield_above.limit,
            color=COLOURS[1],
            linestyle="--",
            label=f"limit: {share.estimate:.1%} above ({share.low:.1%} … {share.high:.1%})",
        )
    axes.set_xlabel(f"{study.quantity.replace('_', ' ')} [{unit}]")
    axes.set_ylabel("probability density")
    legend_below(figure, [axes])
    set_title(
        figure,
        f"{study.scene.name}: {study.devices} devices by {study.method}, "
        + ("as measured, with noise" if hidden else "spread without noise"),
    )
    return figure
