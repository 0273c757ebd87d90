"""`work-precision`: the error of every method over its run time, on one scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

import numpy as np

from harvester.base.formatting import share_with_error
from harvester.base.serialising import fields_of, plain
from harvester.base.symbols import SYMBOLS
from harvester.engines.opening import RunnerOptions, open_runner
from harvester.engines.request import Answer
from harvester.engines.simulate import require_noise
from harvester.scene.calling import takes_scene
from harvester.scene.model import Scene
from harvester.statistics.estimate import Estimate
from harvester.validation import MEANS, SIGNIFICANT_SIGMAS, STATES, VOLTAGE
from harvester.validation.accuracy_measurement import (
    Measured,
    MethodRow,
    by_own_length,
    sampling_error,
)
from harvester.validation.accuracy_methods import ComparedMethod
from harvester.validation.throughput import ratios

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Relative errors: of the answer that is timed, and of the bias that is asked for.
WANTED_ERROR = 0.01
WANTED_BIAS = 0.01
# An order is fitted if the longest mean step is at least twice the shortest. A tolerance changes
# the steps of a PWL run little, since these follow the restarts at its corners.
LEAST_RATIO = 2.0


@dataclass(frozen=True)
class WorkPrecision:
    """Errors and run times of all methods on one scene.

    Attributes
    ----------
    orders : dict of str to dict of str to float
        Measured order in each state of each family.
    reference : Answer
        Monte Carlo run that the means are compared with.
    """

    measured: Measured
    orders: dict[str, dict[str, float]]
    reference: Answer
    means: ClassVar = MEANS

    @classmethod
    def of(cls, measured: Measured) -> WorkPrecision:
        """Build it from a measurement with the scene's own run; see `by_own_length`."""
        assert measured.answer is not None
        return cls(measured, _orders(measured.rows), measured.answer)

    @property
    def rows(self) -> list[MethodRow]:
        return self.measured.rows

    @property
    def scene(self) -> Scene:
        return self.measured.scene

    def needed_time(self) -> float:
        """Simulated time to a standard error of 1 % of E[V²] (s); nan without an error bar."""
        share = sampling_error(self.reference, VOLTAGE)
        return self.reference.simulated_time * (share / WANTED_ERROR) ** 2

    def deviation(self, closure: str, name: str) -> Estimate:
        """A closure's deviation from the reference as a share, with the reference's error."""
        value = self.measured.closures[closure]["quantities"][name].estimate
        mean = self.reference.quantities[name].estimate
        share = sampling_error(self.reference, name)
        error = None if math.isnan(share) else share * value / mean
        return Estimate(value / mean - 1.0, error, None, "1")

    def answer_seconds(self, row: MethodRow) -> float:
        """Seconds of one core to a standard error of 1 % of E[V²]."""
        return row.seconds_per_unit * self.needed_time()

    def table(self) -> tuple[list[str], list[list[str]]]:
        header = ["method", "setting", *(f"error {SYMBOLS[name]}" for name in STATES)]
        header += ["order of X (theory)", *(f"bias {SYMBOLS[name]}" for name in MEANS)]
        header += ["µs per unit", "s to 1 %"]
        rows = [self._cells(row) for row in self.rows]
        for closure, answer in self.measured.closures.items():
            biases = [_percent(self.deviation(closure, name)) for name in MEANS]
            seconds = _number(answer["seconds"], ".3g")
            rows.append([f"averaging, {closure}", *5 * [""], *biases, "", seconds])
        return header, rows

    def _cells(self, row):
        order = self.orders[row.method.family]["displacement"]
        return [
            row.method.family,
            row.method.setting(self.scene),
            *(_number(row.strong[name], ".1e") for name in STATES),
            f"{_number(order, '.2f')} ({row.method.order})",
            *(_percent(row.bias.get(name)) for name in MEANS),
            _number(1e6 * row.seconds_per_unit, ".3g"),
            _number(self.answer_seconds(row), ".3g"),
        ]

    def sentences(self) -> list[str]:
        reference, data, method = self.reference, self.measured, self.measured.reference
        machine, speeds = data.speeds["machine"], data.speeds["rows"]
        sampling = ", ".join(f"{SYMBOLS[n]} {sampling_error(reference, n):.2%}" for n in MEANS)
        lines = [
            f"error: root mean square over {data.paths} paths of {data.horizon:g} s against "
            f"{data.exact_paths}, in scaled units; order: least squares over the mean steps, none "
            "where these follow the restarts of a PWL run",
            f"bias: against {method.family} ({method.step(reference.scene):g} s), on the "
            f"same noise, with the error of the paired difference; {reference.realizations} × "
            f"{reference.simulated_time / reference.realizations:g} s, brief runs for "
            f"{'; '.join(self._brief_settings())}",
            "a brief run that saw no rare event, such as a jump between the wells, has too small "
            "an error bar",
            f"sampling error of the long run itself: {sampling}",
            f"1 % of E[V²] takes {self.needed_time():.3g} simulated seconds",
            *self.verdicts(),
            *(f"{name}: {ratio:.3g}" for name, ratio in ratios(speeds).items()),
            f"{machine['date']}, {machine['cores']} cores, {machine['processor']}",
        ]
        lines += [f"{row.method.family}: {row.note}" for row in self.rows if row.note]
        refused = data.refused.items()
        return [*lines, *(f"closure {name} refused: {why}" for name, why in refused)]

    def verdicts(self) -> list[str]:
        """Whether the circuit's default step keeps every bias below 1 %, and which step does."""
        fixed = [
            row
            for row in self.rows
            if row.method.engine == "circuit"
            and row.method.source == "external"
            and row.method.scheme == "trapezoidal"
        ]
        default = [row for row in fixed if row.method.refinement == 1]
        lines = [f"the circuit's default step: {judged(row)}" for row in default if row.bias]
        # A brief run misses rare events, such as jumps between wells, and so does its error bar.
        below = [
            row
            for row in fixed
            if row.bias and not row.method.brief and set(_verdicts(row).values()) == {"below"}
        ]
        if below:
            step = max(row.method.step(self.scene) for row in below)
            lines.append(f"longest step with every bias shown to be below 1 %: {step:g} s")
        else:
            lines.append(
                "this run is too short to show that any step keeps every bias below 1 %: raise "
                "run.duration, or take --thorough"
            )
        return lines

    def _brief_settings(self):
        """Families with their settings that had a shorter run, and its length."""
        families: dict[str, list[str]] = {}
        for row in self.rows:
            if row.method.brief:
                name = f"{row.method.family} ({row.simulated_time:g} s)"
                families.setdefault(name, []).append(row.method.setting(self.scene))
        return [f"{name} at {', '.join(settings)}" for name, settings in families.items()]

    def figure(self) -> Figure:
        from harvester.results import figures
        from harvester.validation.accuracy_drawing import draw_work_precision

        return figures.drawn(draw_work_precision, self)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN becomes null."""
        measured, speeds = self.measured, self.measured.speeds
        return {
            "scene": self.reference.scene.to_dict(),
            "machine": speeds["machine"],
            "strong": {
                "paths": measured.paths,
                "duration": measured.horizon,
                "orders": plain(self.orders),
            },
            "reference": self.reference.to_dict(),
            "needed_time": plain(self.needed_time()),
            "methods": [self._entry(row) for row in self.rows],
            "closures": {
                closure: {
                    "seconds": answer["seconds"],
                    "bias": {name: self.deviation(closure, name).to_dict("1") for name in MEANS},
                }
                for closure, answer in self.measured.closures.items()
            },
            "refused": dict(self.measured.refused),
            "verdicts": self.verdicts(),
            "throughput": plain({"rows": speeds["rows"], "ratios": ratios(speeds["rows"])}),
        }

    def _entry(self, row):
        return {
            **fields_of(row.method),
            **fields_of(row),
            "setting": row.method.setting(self.scene),
            "longest_step": row.method.step(self.scene),
            "bias": {name: estimate.to_dict("1") for name, estimate in row.bias.items()},
            "simulated_time": plain(row.simulated_time),
            "seconds_per_unit": plain(row.seconds_per_unit),
            "seconds_to_one_percent": plain(self.answer_seconds(row)),
        }


@takes_scene
def work_precision(
    scene: Scene,
    *,
    thorough: bool = False,
    methods: Sequence[ComparedMethod] | None = None,
    **running: Unpack[RunnerOptions],
) -> WorkPrecision:
    """Measure the error and the run time of every method on a scene.

    Parameters
    ----------
    scene : Scene, str or Path
        The scene; means are compared over its own [run].
    thorough : bool
        More paths, steps and realizations.
    methods : sequence of ComparedMethod or None
        None: all of them, and the throughput of every way to run the circuit.
    **running
        See `harvester.engines.open_runner`. What is kept holds the times that were measured.

    Raises
    ------
    HarvesterError
        The excitation is no noise, or the reference itself failed.
    OutOfTime
        The time budget was spent before it was there.
    """
    require_noise(scene, "work-precision")
    with open_runner(**running) as runner:
        return WorkPrecision.of(by_own_length(scene, runner, thorough=thorough, methods=methods))


def _orders(rows):
    """Least-squares slope of log error over log mean step, by family and state."""
    orders = {}
    for family in dict.fromkeys(row.method.family for row in rows):
        ours = [row for row in rows if row.method.family == family and row.mean_step > 0.0]
        steps = np.log([row.mean_step for row in ours])
        if len(ours) < 2 or np.ptp(steps) < math.log(LEAST_RATIO):
            orders[family] = dict.fromkeys(STATES, math.nan)
            continue
        orders[family] = {
            name: float(np.polyfit(steps, np.log([row.strong[name] for row in ours]), 1)[0])
            for name in STATES
        }
    return orders


def judged(row: MethodRow) -> str:
    """Each bias of a row with its verdict against 1 %, as text."""
    return ", ".join(
        f"{SYMBOLS[name]} {_percent(row.bias[name])} ({verdict})"
        for name, verdict in _verdicts(row).items()
    )


def _verdicts(row):
    """{mean: "below" or "above" 1 % beyond chance, or "not resolved"}."""
    verdicts = {}
    for name, bias in row.bias.items():
        size, error = abs(bias.estimate), bias.standard_error
        margin = math.inf if error is None else SIGNIFICANT_SIGMAS * error
        verdicts[name] = "not resolved"
        if size + margin <= WANTED_BIAS:
            verdicts[name] = "below"
        elif size - margin > WANTED_BIAS:
            verdicts[name] = "above"
    return verdicts


def _number(value, form):
    return format(value, form) if math.isfinite(value) else "—"


def _percent(estimate):
    if estimate is None or not math.isfinite(estimate.estimate):
        return "—"
    if estimate.estimate == 0.0 == estimate.standard_error:
        # This method is the reference itself.
        return "reference"
    return share(estimate)


def share(estimate: Estimate) -> str:
    """A share with its standard error, in percent."""
    if estimate.standard_error is None:
        return f"{estimate.estimate:+.1%} (no error bar)"
    return share_with_error(estimate)
