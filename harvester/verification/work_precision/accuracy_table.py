"""What `time-to-accuracy` measured of each method on one scene, and how it is told."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from harvester.files.writing import finite
from harvester.scene.model import Scene
from harvester.verification.work_precision.accuracy import LIMITS, OUTPUT_POWER, TotalError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SYMBOLS = {
    "mean_square_voltage": "E[V²]",
    "power_conversion_efficiency": "PCE",
    OUTPUT_POWER: "output power",
}


@dataclass(frozen=True)
class Line:
    """What was measured of one method.

    Attributes
    ----------
    name : str
    errors : dict of str to TotalError
        By quantity; empty where the method failed.
    simulated_time : float
        Measured time of all its realizations (s).
    cost : float
        Seconds of one core for one measured second, settling included: of its fastest task.
    note : str
        Why there is nothing, or empty.
    """

    name: str
    errors: dict = field(default_factory=dict)
    simulated_time: float = 0.0
    cost: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Point:
    """A closure's answer: its wall time, and its deviation from the reference by quantity."""

    name: str
    seconds: float
    deviations: dict


@dataclass(frozen=True)
class TimeToAccuracy:
    """How long every method takes on one scene.

    Attributes
    ----------
    scene : Scene
    quantities : tuple of str
    reference : Line
        Its errors hold no bias.
    lines : list of Line
    points : list of Point
    refused : dict of str to str
        Closures that do not hold, with the reason.
    """

    scene: Scene
    quantities: tuple
    reference: Line
    lines: list
    points: list
    refused: dict

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        header = ["method", "wall time per second"]
        for name in self.quantities:
            header += [f"bias of {SYMBOLS[name]}", *(f"to {limit:.0%}" for limit in LIMITS)]
        rows = [self._cells(line) for line in self.lines if line.errors]
        return header, rows + [self._point_cells(point) for point in self.points]

    def _cells(self, line):
        cells = [line.name, duration(line.cost)]
        for name in self.quantities:
            error = line.errors[name]
            cells += [_share(error.bias), *(reached(error, limit) for limit in LIMITS)]
        return cells

    def _point_cells(self, point):
        cells = [f"averaging, {point.name}", "—"]
        for name in self.quantities:
            deviation = point.deviations[name]
            cells.append(_share(deviation))
            for limit in LIMITS:
                holds = abs(deviation.estimate) <= limit
                cells.append(duration(point.seconds) if holds else "never")
        return cells

    def sentences(self) -> list[str]:
        """What the numbers rest on, one line each."""
        known = ", ".join(
            f"{SYMBOLS[name]} {error.scatter / math.sqrt(self.reference.simulated_time):.2%}"
            for name, error in self.reference.errors.items()
        )
        lines = [
            "total error: √(bias² + sampling variance); wall time of one core, with settling and "
            "without the start of the program; never: the bias alone is larger; (?): the bias is "
            "not known well enough to say that this error is reached",
            f"bias: against {self.reference.name}, {self.reference.simulated_time:.3g} s on the "
            f"same noise, known to {known}; standard errors",
        ]
        lines += [f"{line.name}: {line.note}" for line in self.lines if line.note]
        return [*lines, *(f"closure {name} refused: {why}" for name, why in self.refused.items())]

    def figure(self) -> Figure:
        """Total error over wall time."""
        from harvester.show import accuracy_figure, figures

        return figures.drawn(accuracy_figure.draw, [self])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "scene": self.scene.to_dict(),
            "quantities": list(self.quantities),
            "reference": _line_to_dict(self.reference),
            "methods": [_line_to_dict(line) for line in self.lines],
            "closures": [
                {
                    "closure": point.name,
                    "seconds": point.seconds,
                    "deviation": {n: each.to_dict() for n, each in point.deviations.items()},
                }
                for point in self.points
            ],
            "refused": dict(self.refused),
        }


def reached(error: TotalError, limit: float) -> str:
    """The wall time to a total error, as text."""
    seconds = error.seconds_to(limit)
    if not math.isfinite(seconds):
        return "never" if math.isinf(seconds) else "—"
    return duration(seconds) + ("" if error.is_shown(limit) else " (?)")


def duration(seconds: float) -> str:
    """Two digits with a fitting unit."""
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"), (1e-3, "ms")):
        if seconds >= size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{1e6 * seconds:.2g}'):g} µs"


def _share(estimate):
    if estimate.standard_error is None:
        return f"{estimate.estimate:+.1%} (no error bar)"
    return f"{estimate.estimate:+.2%} ± {estimate.standard_error:.2%}"


def _line_to_dict(line):
    return {
        "method": line.name,
        "simulated_time": line.simulated_time,
        "wall_seconds_per_second": line.cost,
        "note": line.note,
        "errors": {
            name: {
                "bias": finite(error.bias.estimate),
                "standard_error": finite(error.bias.standard_error),
                "scatter": finite(error.scatter),
                "seconds_to": {f"{limit:g}": finite(error.seconds_to(limit)) for limit in LIMITS},
                "shown": {f"{limit:g}": error.is_shown(limit) for limit in LIMITS},
            }
            for name, error in line.errors.items()
        },
    }
