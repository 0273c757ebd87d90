"""`time-to-accuracy`: how long every method takes to an error of 10, 3 and 1 % on one scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

from harvester.base.errors import SceneError
from harvester.base.serialising import fields_of, key
from harvester.base.symbols import SYMBOLS
from harvester.engines.opening import RunnerOptions, open_runner
from harvester.engines.simulate import require_noise
from harvester.scene.calling import takes_scene
from harvester.scene.model import Scene
from harvester.statistics.estimate import Estimate
from harvester.validation import EFFICIENCY, OUTPUT_POWER, VOLTAGE
from harvester.validation.accuracy_measurement import Measured, by_time
from harvester.validation.total_error import LIMITS, TotalError, bias_of, scatter_of
from harvester.validation.work_precision import share

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A method's run may take so many seconds of one core.
SECONDS = 10.0
# Units of time in seconds, from the longest down.
UNITS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"), (1e-3, "ms"))


@dataclass(frozen=True)
class Line:
    """Errors and cost of one method.

    Attributes
    ----------
    errors : dict of str to TotalError
        Total errors by quantity; empty if the method failed.
    simulated_time : float
        Measured time of all its realizations (s).
    cost : float
        Seconds of one core for one measured second, settling included: of its fastest task.
    note : str
        Why there is nothing, or empty.
    """

    name: str = field(metadata=key("method"))
    errors: dict[str, TotalError] = field(default_factory=dict)
    simulated_time: float = 0.0
    cost: float = field(default=0.0, metadata=key("wall_seconds_per_second"))
    note: str = ""


@dataclass(frozen=True)
class ClosurePoint:
    """A closure's answer: its wall time, and its deviation from the reference by quantity."""

    name: str = field(metadata=key("closure"))
    seconds: float
    deviations: dict[str, Estimate] = field(metadata=key("deviation"))


@dataclass(frozen=True)
class TimeToAccuracy:
    """How long every method takes on one scene.

    Attributes
    ----------
    reference : Line
        The reference method; its errors hold no bias.
    refused : dict of str to str
        Closures that do not hold, with the reason.
    """

    scene: Scene
    quantities: tuple[str, ...]
    reference: Line
    lines: list[Line] = field(metadata=key("methods"))
    points: list[ClosurePoint] = field(metadata=key("closures"))
    refused: dict[str, str]
    limits: ClassVar = LIMITS

    @classmethod
    def of(cls, measured: Measured) -> TimeToAccuracy:
        exact = measured.references[False]
        means = exact.quantities()
        last = OUTPUT_POWER if OUTPUT_POWER in means else VOLTAGE
        quantities = (last, EFFICIENCY)
        scatter = {name: scatter_of(exact, name) for name in quantities}
        none = Estimate(0.0, 0.0, None, "1")
        errors = {name: TotalError(none, spread, exact.cost) for name, spread in scatter.items()}
        lines = [
            _line(row, measured.references[row.method.brief], scatter) for row in measured.rows
        ]
        points = [
            ClosurePoint(
                name, answer["seconds"], {n: _deviation(answer, means, n) for n in quantities}
            )
            for name, answer in measured.closures.items()
        ]
        first = Line(measured.reference.family, errors, exact.measured_time, exact.cost)
        return cls(measured.scene, quantities, first, lines, points, measured.refused)

    def table(self) -> tuple[list[str], list[list[str]]]:
        header = ["method", "wall time per second"]
        for name in self.quantities:
            header += [f"bias of {SYMBOLS[name]}", *(f"to {limit:.0%}" for limit in LIMITS)]
        rows = []
        for line in self.lines:
            if line.errors:
                rows.append([line.name, duration(line.cost)])
                for error in line.errors.values():
                    rows[-1] += [share(error.bias), *(reached(error, limit) for limit in LIMITS)]
        for point in self.points:
            rows.append([f"averaging, {point.name}", "—"])
            for deviation in point.deviations.values():
                holds = [abs(deviation.estimate) <= limit for limit in LIMITS]
                times = [duration(point.seconds) if held else "never" for held in holds]
                rows[-1] += [share(deviation), *times]
        return header, rows

    def sentences(self) -> list[str]:
        """Sentences on the runs behind the numbers, one line each."""
        precision = ", ".join(
            f"{SYMBOLS[name]} {error.scatter / math.sqrt(self.reference.simulated_time):.2%}"
            for name, error in self.reference.errors.items()
        )
        lines = [
            "total error: √(bias² + sampling variance); wall time of one core, with settling and "
            "without the start of the program; never: the bias alone is larger; (?): the bias is "
            "not known well enough to say that this error is reached",
            f"bias: against {self.reference.name}, {self.reference.simulated_time:.3g} s on the "
            f"same noise, known to {precision}; standard errors",
        ]
        lines += [f"{line.name}: {line.note}" for line in self.lines if line.note]
        return [*lines, *(f"closure {name} refused: {why}" for name, why in self.refused.items())]

    def figure(self) -> Figure:
        from harvester.results import figures
        from harvester.validation import accuracy_drawing as accuracy_figure

        return figures.drawn(accuracy_figure.draw, [self])

    def to_dict(self) -> dict[str, Any]:
        return fields_of(self)


@takes_scene
def time_to_accuracy(
    scene: Scene, *, seconds: float = SECONDS, **running: Unpack[RunnerOptions]
) -> TimeToAccuracy:
    """Measure how the error of every method falls with its wall time.

    Parameters
    ----------
    scene : Scene, str or Path
        The scene; its [run] gives the length of each realization.
    seconds : float
        Seconds of one core that each method's run may take: the longer, the better are biases
        known.
    **running
        See `harvester.engines.open_runner`. What is kept holds the times that were measured.

    Raises
    ------
    HarvesterError
        The excitation is no noise, or the reference failed.
    OutOfTime
        The time budget was spent before the reference was there.
    """
    require_noise(scene, "time-to-accuracy")
    if not seconds > 0.0:
        raise SceneError(f"time-to-accuracy: {seconds:g} seconds a method: must be > 0")
    with open_runner(**running) as runner:
        return TimeToAccuracy.of(by_time(scene, runner, seconds))


def _line(row, reference, scatter):
    name, run = row.method.family, row.run
    if run is None:
        return Line(name, note=row.note)
    errors = {
        quantity: TotalError(bias_of(quantity, run, reference), spread, run.cost)
        for quantity, spread in scatter.items()
    }
    return Line(name, errors, run.measured_time, run.cost)


def _deviation(answer, means, quantity):
    """A closure's deviation from the reference, as a share with both errors."""
    ours, theirs = answer["quantities"][quantity], means[quantity]
    ratio = ours.estimate / theirs.estimate
    closure_error = (ours.standard_error or 0.0) / abs(theirs.estimate)
    far = abs(ratio) * (theirs.standard_error or 0.0) / abs(theirs.estimate)
    return Estimate(ratio - 1.0, math.hypot(closure_error, far), None, "1")


def reached(error: TotalError, limit: float) -> str:
    """The wall time to a total error, as text."""
    seconds = error.seconds_to(limit)
    if not math.isfinite(seconds):
        return "never" if math.isinf(seconds) else "—"
    return duration(seconds) + ("" if error.is_shown(limit) else " (?)")


def duration(seconds: float) -> str:
    """A duration as text: two digits with a fitting unit."""
    for size, unit in UNITS:
        if seconds >= size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{1e6 * seconds:.2g}'):g} µs"
