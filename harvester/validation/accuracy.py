"""`accuracy`: error of every method against run time, and time to an error of 10, 3 and 1 %."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from harvester.base.formatting import NOT_KNOWN, UNCERTAIN, Printed, number, share_with_error
from harvester.base.serialising import fields_of, plain
from harvester.base.symbols import SYMBOLS
from harvester.engines.request import Answer, relative_error
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.statistics.agreement import SIGNIFICANT_SIGMAS
from harvester.statistics.estimate import TOO_SHORT, Estimate
from harvester.statistics.units import unit_of
from harvester.validation import MEANS, STATES, VOLTAGE
from harvester.validation.accuracy_measurement import (
    LIMITS,
    MethodRow,
    TotalError,
    is_reference,
)
from harvester.validation.accuracy_methods import ComparedMethod
from harvester.validation.throughput import ratios

# Required relative errors: of the timed answer, and of the bias.
WANTED_ERROR = WANTED_BIAS = 0.01
# The order of convergence is fitted only if the longest mean step is at least this multiple of the
# shortest. With a piecewise-linear (PWL) source the tolerance hardly changes the steps, since
# ngspice restarts with a short step at each corner of the source.
LEAST_RATIO = 2.0
# Units of time in seconds, from the longest down.
UNITS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"), (1e-3, "ms"))


@dataclass(frozen=True, repr=False)
class Accuracy(ResultBase):
    """Errors and run times of all methods on one scene.

    Attributes
    ----------
    reference : ComparedMethod
        The method relative to which biases are measured.
    answer : Answer
        The reference's long run.
    errors : dict of str to TotalError
        Total errors of the reference, without bias, by timed quantity.
    closures : dict of str to dict
        `quantities` (scaled) and `seconds` of each valid stationary method.
    refused : dict of str to str
        Reasons of invalid stationary methods, and of a missing throughput.
    exact_paths : str
        Name of the reference solution for strong errors.
    horizon : float
        Length of the paths (s).
    speeds : dict
        `rows` of Throughput, empty for a netlist of more than a resistor, and the `machine`.
    """

    scene: Scene
    rows: list[MethodRow]
    reference: ComparedMethod
    answer: Answer
    errors: dict[str, TotalError]
    closures: dict
    refused: dict
    exact_paths: str
    horizon: float
    paths: int
    speeds: dict

    @cached_property
    def orders(self) -> dict[str, dict[str, float]]:
        """Measured order of each state and family: slope of log error over log mean step."""
        orders = {}
        for family in dict.fromkeys(row.method.family for row in self.rows):
            ours = [row for row in self.rows if row.method.family == family and row.mean_step > 0.0]
            steps = np.log([row.mean_step for row in ours])
            orders[family] = dict.fromkeys(STATES, math.nan)
            if len(ours) < 2 or np.ptp(steps) < math.log(LEAST_RATIO):
                continue
            for name in STATES:
                errors = np.log([row.strong[name] for row in ours])
                orders[family][name] = float(np.polyfit(steps, errors, 1)[0])
        return orders

    def needed_time(self) -> float:
        """Simulated time to a standard error of 1 % of E[V²] (s); infinite without an error bar."""
        return self.answer.simulated_time * (self.sampling_error(VOLTAGE) / WANTED_ERROR) ** 2

    def sampling_error(self, name: str) -> float:
        """Relative standard error of a mean in the long run."""
        return relative_error(self.answer.quantities[name])

    def run_seconds(self, row: MethodRow) -> float:
        """Seconds of one core for a run as long as the reference's."""
        return row.seconds_per_unit * self.answer.simulated_time

    def deviation(self, closure: str, name: str) -> Estimate:
        """A stationary method's relative deviation from the reference, with both errors."""
        ours = self.closures[closure]["quantities"][name]
        ratio = ours.estimate / self.answer.quantities[name].estimate
        errors = relative_error(ours), self.sampling_error(name)
        error = abs(ratio) * math.hypot(*errors)
        return Estimate(ratio - 1.0, error if math.isfinite(error) else None, None, "1")

    def view(self) -> View:
        """Errors and times of every method; error against run time."""
        from harvester.validation.accuracy_drawing import draw

        pictures = [Picture(draw, self)]
        return View(self._table(), self._findings(), self._headline(), pictures=pictures)

    def _headline(self) -> str:
        """Whether the circuit's default step keeps every bias below 1 %, in a few words."""
        rows = [row for row in self._of_the_circuit() if row.method.refinement == 1]
        if not rows:
            return ""
        unclear = [SYMBOLS[n] for n, bias in rows[0].bias.items() if _verdict(bias) != "below 1 %"]
        names = " and ".join(unclear)
        verdict = f"{names} not shown to be below" if unclear else "every mean below"
        return f"bias of the circuit's default step: {verdict} 1 %"

    def _of_the_circuit(self):
        """Rows with biases of the circuit with default settings, at any step."""
        kinds = ((row, (row.method.source, row.method.scheme)) for row in self.rows if row.bias)
        return [row for row, kind in kinds if kind == ("external", "trapezoidal")]

    def strong_error(self, row: MethodRow, name: str) -> float:
        """Error of a state of all paths, in the scene's units."""
        return row.strong[name] * self.answer.prepared_scene.scales.of(name)

    def _table(self) -> tuple[list[str], list[list[str]]]:
        states = [f"error {SYMBOLS[name]} [{unit_of(self.scene, name)}]" for name in STATES]
        header = ["method", "setting", *states, "order of X", "order in theory"]
        header += [*(f"bias {SYMBOLS[name]}" for name in MEANS), "core time [µs/simulated s]"]
        header += [f"{SYMBOLS[name]} to {limit:.0%}" for name in self.errors for limit in LIMITS]
        rows = [self._cells(row) for row in self.rows]
        for closure, answer in self.closures.items():
            biases = [_percent(self.deviation(closure, name)) for name in MEANS]
            rows.append([f"averaging, {closure}", *6 * [""], *biases, ""])
            for name in self.errors:
                error = TotalError(self.deviation(closure, name), 0.0, 0.0)
                rows[-1] += [reached(error, limit, answer["seconds"]) for limit in LIMITS]
        return header, rows

    def _setting(self, method):
        return method.setting(self.answer.prepared_scene)

    def longest_step(self, method: ComparedMethod) -> float:
        """Longest step of a method on the scene (s)."""
        return method.step(self.answer.prepared_scene)

    def _cells(self, row):
        order = self.orders[row.method.family]["displacement"]
        errors = [row.errors.get(name) for name in self.errors]
        return [
            row.method.family,
            self._setting(row.method) + (" (brief run)" if row.method.brief else ""),
            *(number(self.strong_error(row, name), 2) for name in STATES),
            number(order, 3),
            number(row.method.order),
            *(_percent(row.bias.get(name)) for name in MEANS),
            number(1e6 * row.seconds_per_unit, 3),
            *(reached(error, limit) for error in errors for limit in LIMITS),
        ]

    def _findings(self) -> list[str]:
        """Verdict on the default step, and notes on the method."""
        answer, machine, speeds = self.answer, self.speeds["machine"], self.speeds["rows"]
        errors = {SYMBOLS[name]: self.sampling_error(name) for name in MEANS}
        sampling = ", ".join(
            f"{name} {error:.2%}" for name, error in errors.items() if error < math.inf
        )
        needed = self.needed_time()
        lines = [
            *self.verdicts(),
            f"error: root mean square over {self.paths} paths of {self.horizon:g} s against "
            f"{self.exact_paths}; order: least squares over the mean steps, none if these follow "
            "the restarts of a PWL run",
            f"bias: against {self.reference.family} ({self.longest_step(self.reference):g} s), on "
            f"the same noise, with the error of the paired difference; {answer.realizations} × "
            f"{answer.simulated_time / answer.realizations:g} s, fewer and shorter in a brief run",
            *[
                "bias of a stationary method: ± covers its numerical and the reference's sampling "
                "error; its time is the engine_seconds of a second call of `average`, without "
                "compilation"
            ]
            * bool(self.closures),
            "a brief run without a rare event, such as a jump between the wells, has too small "
            "an error bar",
            f"sampling error of the long run: {sampling or TOO_SHORT}",
            *[f"1 % of E[V²] takes {needed:.3g} simulated seconds"] * (needed < math.inf),
            "to 10, 3 and 1 %: √(bias² + sampling variance); wall time of one core, with settling "
            "and without the start of the program; never: the bias alone is larger by over two "
            "standard errors; unknown or (?): the bias is too uncertain to show whether this error "
            "is reached",
            *(f"{name}: {ratio:.3g}" for name, ratio in ratios(speeds).items()),
            f"{machine['date']}, {machine['cores']} cores, {machine['processor']}",
        ]
        lines += [f"{row.method.family}: {row.note}" for row in self.rows if row.note]
        return [*lines, *(f"{name}: refused: {why}" for name, why in self.refused.items())]

    def verdicts(self) -> list[str]:
        """Verdict on the bias at the circuit's default step, and the longest step below 1 %."""
        rows = self._of_the_circuit()
        if not rows:
            return []
        lines = [
            f"{row.method.family}: the circuit's default step: {bias_verdict(row)}"
            for row in rows
            if row.method.refinement == 1
        ]
        # A brief run misses rare events, such as jumps between wells, also in its error bar.
        steps = [
            self.longest_step(row.method)
            for row in rows
            if not row.method.brief and {*map(_verdict, row.bias.values())} == {"below 1 %"}
        ]
        if steps:
            return [*lines, f"longest step with every bias shown to be below 1 %: {max(steps):g} s"]
        return [
            *lines,
            "this run is too short to show that any step keeps every bias below 1 %: raise "
            "run.duration, or use --thorough",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN becomes null."""
        content = {
            "scene": self.scene,
            "machine": self.speeds["machine"],
            "strong": {"paths": self.paths, "duration": self.horizon, "orders": self.orders},
            "reference": {
                **self.answer.to_dict(),
                "method": self.reference.family,
                "errors": self.errors,
            },
            "needed_time": self.needed_time(),
            "methods": [self._entry(row) for row in self.rows],
            "closures": {
                closure: {
                    "seconds": answer["seconds"],
                    "bias": {n: self.deviation(closure, n) for n in (*MEANS, *self.errors)},
                }
                for closure, answer in self.closures.items()
            },
            "refused": self.refused,
            "verdicts": self.verdicts(),
            "throughput": {"rows": self.speeds["rows"], "ratios": ratios(self.speeds["rows"])},
        }
        return plain(content)

    def _entry(self, row):
        return {
            **fields_of(row.method),
            **fields_of(row),
            "setting": self._setting(row.method),
            "longest_step": self.longest_step(row.method),
            "simulated_time": row.simulated_time,
            "seconds_per_unit": row.seconds_per_unit,
            "seconds_to_one_percent": row.seconds_per_unit * self.needed_time(),
        }


def bias_verdict(row: MethodRow) -> str:
    """Each bias of a row and its verdict (limit 1 %), as text."""
    return ", ".join(
        f"{SYMBOLS[name]} {_percent(bias)} ({_verdict(bias)})" for name, bias in row.bias.items()
    )


def _verdict(bias):
    """ "below 1 %" or "above 1 %" with significance, or "not resolved"."""
    size, error = abs(bias.estimate), bias.standard_error
    margin = math.inf if error is None else SIGNIFICANT_SIGMAS * error
    if size + margin <= WANTED_BIAS:
        return "below 1 %"
    return "above 1 %" if size - margin > WANTED_BIAS else "not resolved"


# No run is long enough, since the bias alone exceeds the error.
NEVER = Printed("never", math.inf, None, "s")


def reached(error: Any, limit: float, whole: float = 0.0) -> str:
    """The wall time to a `TotalError`, if there is one, as text.

    `whole`: seconds of a method without noise, whose answer takes the same time at any error.
    """
    seconds = whole + error.seconds_to(limit) if error else math.nan
    if math.isinf(seconds):
        return NEVER
    if math.isnan(seconds):
        bare = not error or error.bias.standard_error is None
        return NOT_KNOWN if bare else Printed(f"unknown (bias {_percent(error.bias)})", seconds)
    return Printed(duration(seconds) + UNCERTAIN * (not error.is_shown(limit)), seconds, None, "s")


def duration(seconds: float) -> Printed:
    """A duration with two digits and a suitable unit."""
    size, unit = next((pair for pair in UNITS if seconds >= pair[0]), (1e-6, "µs"))
    return Printed(f"{float(f'{seconds / size:.2g}'):g} {unit}", seconds, None, "s")


def _percent(estimate):
    if estimate is None or not math.isfinite(estimate.estimate):
        return NOT_KNOWN
    if is_reference(estimate):
        return Printed("reference", 0.0)
    if estimate.standard_error is None:
        return Printed(f"{estimate.estimate:+.1%} (no error bar)", estimate.estimate, None, "1")
    return share_with_error(estimate)
