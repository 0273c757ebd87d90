"""A work-precision diagram: what was measured of each method, and how it is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harvester.estimates.estimate import Estimate
from harvester.files.writing import finite
from harvester.running import Answer
from harvester.scene.model import Scene
from harvester.verification.work_precision.methods import Method
from harvester.verification.work_precision.throughput import ratios
from harvester.verification.work_precision.throughput import to_dict as throughput_to_dict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATES = ("displacement", "velocity", "voltage")
MEANS = ("mean_square_voltage", "mean_square_velocity", "power_conversion_efficiency")
SYMBOLS = dict(zip((*STATES, *MEANS), ("X", "X'", "V", "E[V²]", "E[X'²]", "PCE"), strict=True))
# The answer that is timed, and the bias that is asked for: shares of the mean.
WANTED_ERROR = 0.01
WANTED_BIAS = 0.01
# Standard errors that decide whether a bias is below or above.
SIGNIFICANT_SIGMAS = 3.0


@dataclass(frozen=True)
class Row:
    """What was measured of one method.

    Attributes
    ----------
    method : Method
    mean_step : float
        Of the strong runs (s); nan when they failed.
    strong : dict of str to float
        RMS error of each state over knots and paths, scaled; nan when a path failed.
    bias : dict of str to Estimate
        Of each mean as a share, paired; empty when the run failed.
    sampling : dict of str to float
        Standard error of each mean itself in a run of this length, as a share: σ/√N.
    simulated_time : float
        Of the run for the means (s).
    seconds_per_unit : float
        Seconds of one core per simulated second.
    note : str
        How the run failed, or empty.
    """

    method: Method
    mean_step: float
    strong: dict
    bias: dict
    sampling: dict
    simulated_time: float
    seconds_per_unit: float
    note: str


@dataclass(frozen=True)
class WorkPrecision:
    """Errors and run times of all methods on one scene.

    Attributes
    ----------
    scene : Scene
    rows : list of Row
    orders : dict of str to dict of str to float
        Measured order in each state of each family.
    reference : Answer
        Monte Carlo run that the means are compared with.
    reference_method : Method
        Of that run.
    exact_paths : str
        What the paths' errors are reckoned against.
    closures : dict of str to dict
        Of those that hold `quantities`, scaled, and `seconds`.
    refused : dict of str to str
        Closures that do not hold, with the reason.
    horizon : float
        Length of the paths for the strong error (s).
    paths : int
    machine : dict
        That the throughput was measured on, and when.
    throughput : list of harvester.verification.work_precision.throughput.Throughput
        Empty where the load is a netlist of more than a resistor.
    """

    scene: Scene
    rows: list
    orders: dict
    reference: Answer
    reference_method: Method
    exact_paths: str
    closures: dict
    refused: dict
    horizon: float
    paths: int
    machine: dict
    throughput: list

    def needed_time(self) -> float:
        """Simulated time to a standard error of 1 % of E[V²] (s); nan without an error bar."""
        share = relative_error(self.reference, "mean_square_voltage")
        return self.reference.simulated_time * (share / WANTED_ERROR) ** 2

    def deviation(self, closure: str, name: str) -> Estimate:
        """A closure's deviation from the reference as a share, with the reference's error."""
        value = self.closures[closure]["quantities"][name].estimate
        mean = self.reference.quantities[name].estimate
        share = relative_error(self.reference, name)
        error = None if math.isnan(share) else share * value / mean
        return Estimate(value / mean - 1.0, error, None, "1")

    def answer_seconds(self, row: Row) -> float:
        """Seconds of one core to a standard error of 1 % of E[V²]."""
        return row.seconds_per_unit * self.needed_time()

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        header = ["method", "setting"]
        header += [f"error {SYMBOLS[name]}" for name in STATES]
        header += ["order of X (theory)"]
        header += [f"bias {SYMBOLS[name]}" for name in MEANS]
        header += ["µs per unit", "s to 1 %"]
        rows = [self._cells(row) for row in self.rows]
        return header, rows + [self._closure_cells(closure) for closure in self.closures]

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

    def _closure_cells(self, closure):
        biases = [_percent(self.deviation(closure, name)) for name in MEANS]
        seconds = _number(self.closures[closure]["seconds"], ".3g")
        return [f"averaging, {closure}", "", "", "", "", "", *biases, "", seconds]

    def sentences(self) -> list[str]:
        """What the numbers say, one line each."""
        reference, method, machine = self.reference, self.reference_method, self.machine
        sampling = ", ".join(
            f"{SYMBOLS[name]} {relative_error(reference, name):.2%}" for name in MEANS
        )
        lines = [
            f"error: root mean square over {self.paths} paths of {self.horizon:g} s against "
            f"{self.exact_paths}, in scaled units; order: least squares over the mean steps, none "
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
            *(f"{name}: {ratio:.3g}" for name, ratio in ratios(self.throughput).items()),
            f"{machine['date']}, {machine['cores']} cores, {machine['processor']}",
        ]
        lines += [f"{row.method.family}: {row.note}" for row in self.rows if row.note]
        return [*lines, *(f"closure {name} refused: {why}" for name, why in self.refused.items())]

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
        # A brief run misses what is rare, jumps between the wells first, and its error bar too.
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
        families = {}
        for row in self.rows:
            if row.method.brief:
                name = f"{row.method.family} ({row.simulated_time:g} s)"
                families.setdefault(name, []).append(row.method.setting(self.scene))
        return [f"{name} at {', '.join(settings)}" for name, settings in families.items()]

    def figure(self) -> Figure:
        """Error against run time."""
        from harvester.show import figures

        return figures.drawn(figures.draw_work_precision, self)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN becomes null."""
        return {
            "scene": self.reference.scene.to_dict(),
            "machine": self.machine,
            "strong": {
                "paths": self.paths,
                "duration": self.horizon,
                "orders": {
                    family: {name: finite(order) for name, order in orders.items()}
                    for family, orders in self.orders.items()
                },
            },
            "reference": self.reference.to_dict(),
            "needed_time": finite(self.needed_time()),
            "methods": [self._entry(row) for row in self.rows],
            "closures": {
                closure: {
                    "seconds": found["seconds"],
                    "bias": {name: self.deviation(closure, name).to_dict("1") for name in MEANS},
                }
                for closure, found in self.closures.items()
            },
            "refused": dict(self.refused),
            "verdicts": self.verdicts(),
            "throughput": throughput_to_dict(self.throughput),
        }

    def _entry(self, row):
        method = row.method
        return {
            "family": method.family,
            "setting": method.setting(self.scene),
            "engine": method.engine,
            "source": method.source,
            "scheme": method.scheme,
            "tolerance": method.tolerance,
            "device": method.device,
            "copies": method.copies,
            "longest_step": method.step(self.scene),
            "mean_step": finite(row.mean_step),
            "theoretical_order": method.order,
            "strong_error": {name: finite(row.strong[name]) for name in STATES},
            "bias": {name: each.to_dict("1") for name, each in row.bias.items()},
            "sampling_error": {name: finite(error) for name, error in row.sampling.items()},
            "simulated_time": finite(row.simulated_time),
            "seconds_per_unit": finite(row.seconds_per_unit),
            "seconds_to_one_percent": finite(self.answer_seconds(row)),
            "note": row.note,
        }


def relative_error(reference: Answer, name: str) -> float:
    """Standard error of a mean as a share of it; nan without an error bar."""
    estimate = reference.quantities[name]
    if estimate.standard_error is None or not estimate.estimate:
        return math.nan
    return estimate.standard_error / abs(estimate.estimate)


def judged(row: Row) -> str:
    """Each bias of a row with its verdict against 1 %, as text."""
    return ", ".join(
        f"{SYMBOLS[name]} {_percent(row.bias[name])} ({verdict})"
        for name, verdict in _verdicts(row).items()
    )


def _verdicts(row):
    """Per mean: "below" or "above" 1 % beyond chance, or "not resolved"."""
    verdicts = {}
    for name, bias in row.bias.items():
        size = abs(bias.estimate)
        margin = (
            math.inf if bias.standard_error is None else SIGNIFICANT_SIGMAS * bias.standard_error
        )
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
        # The same run as the reference.
        return "reference"
    if estimate.standard_error is None:
        return f"{estimate.estimate:+.1%} (no error bar)"
    return f"{estimate.estimate:+.2%} ± {estimate.standard_error:.2%}"
