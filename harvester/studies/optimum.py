"""`optimum`: where one parameter makes a mean largest; Eq. 37 is that of PCE over D.

Averaging scans the range and refines its highest point. Simulation then looks there, on common
noise, moves on while the slope asks for it, and fits a cubic to several places: the interval of
the maximum's place is what the paired errors of the values make of it.
"""

import math
import time
from dataclasses import dataclass
from typing import Any

from harvester.averaging import CLOSURES, DEFAULT_CLOSURE
from harvester.errors import HarvesterError
from harvester.estimates.estimate import Estimate
from harvester.estimates.output_side import RATIOS
from harvester.files.writing import finite
from harvester.results.result import with_error
from harvester.running import Request, RunnerOptions, open_runner
from harvester.scene.model import Scene
from harvester.simulation.methods import ENGINES
from harvester.simulation.simulate import check_name
from harvester.studies.axis import Axis
from harvester.studies.objective import answers_in_time, missing_from, on_common_knots
from harvester.studies.optimum_search import Search, amount, averaged

MAXIMISED = ("power_conversion_efficiency", "mean_power", "mean_square_voltage")
# Standard errors to either side of the place that make its interval.
INTERVAL = 2.0


@dataclass(frozen=True)
class Optimum:
    """Where a mean is largest.

    Attributes
    ----------
    scene : Scene
    axis : Axis
    quantity : str
    closure : str
    averaged_place, averaged_value : float or None
        By averaging; None where it refuses or has no maximum inside, with `averaged_reason`.
    averaged_reason : str
    averaged_there : float or None
        By averaging at the place that simulation found.
    method : str
    place, value : Estimate
        By simulation; `place` from the fit, `value` from a run there.
    fitted : list of (float, Estimate)
        Values that the last fit used.
    wall_seconds : float
    """

    scene: Scene
    axis: Axis
    quantity: str
    closure: str
    averaged_place: float | None
    averaged_value: float | None
    averaged_reason: str
    averaged_there: float | None
    method: str
    place: Estimate
    value: Estimate
    fitted: list[tuple[float, Estimate]]
    wall_seconds: float

    @property
    def interval(self) -> tuple[float, float]:
        """Of the place: two standard errors to either side."""
        error = self.place.standard_error
        reach = INTERVAL * (math.nan if error is None else error)
        return self.place.estimate - reach, self.place.estimate + reach

    @property
    def keys(self) -> list[str]:
        """The parameter, in a list of one."""
        return [self.axis.key]

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        header = ["method", "parameter", "optimum at", "interval", self.quantity.replace("_", " ")]
        low, high = self.interval
        rows = [[self.method, self.axis.key, f"{self.place.estimate:.4g}"]]
        rows[0] += [f"{low:.4g} … {high:.4g}", with_error(self.value)]
        if self.averaged_place is not None:
            place, value = f"{self.averaged_place:.4g}", f"{self.averaged_value:.4g}"
            rows.insert(0, [f"averaging, {self.closure}", self.axis.key, place, "", value])
        return header, rows

    def sentences(self) -> list[str]:
        """How far averaging is off, and what was run."""
        lines = []
        if self.averaged_place is None:
            lines.append(f"averaging, {self.closure}: no optimum: {self.averaged_reason}")
        else:
            place, value = self._off()
            lines.append(
                f"averaging, {self.closure}: place {place:+.1%}, value {value:+.1%} off "
                f"{self.method}"
            )
        if self.averaged_there is not None:
            off = self.averaged_there / self.value.estimate - 1.0
            lines.append(f"averaging, {self.closure}, at {self.method}'s optimum: {off:+.1%}")
        low, high = self.fitted[0][0], self.fitted[-1][0]
        lines.append(
            f"{self.method}: cubic through {len(self.fitted)} places in {low:.4g} … {high:.4g} on "
            f"common noise, seed {self.scene.run.seed}; interval: two standard errors"
        )
        lines += missing_from(self.quantity, self.value)
        return [*lines, f"{self.wall_seconds:.1f} s"]

    def figure(self) -> None:
        """A single place has none."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        off = self._off() if self.averaged_place is not None else (None, None)
        return {
            "scene": self.scene.to_dict(),
            "over": self.axis.key,
            "range": [self.axis.low, self.axis.high],
            "maximised": self.quantity,
            "averaging": {
                "closure": self.closure,
                "place": finite(self.averaged_place),
                "value": finite(self.averaged_value),
                "reason": self.averaged_reason,
                "value_at_simulated_place": finite(self.averaged_there),
                "place_deviation": finite(off[0]),
                "value_deviation": finite(off[1]),
            },
            "simulation": {
                "method": self.method,
                "place": self.place.to_dict(),
                "interval": list(self.interval),
                "value": self.value.to_dict(),
                "fitted": [{"place": x, **y.to_dict()} for x, y in self.fitted],
            },
            "seed": self.scene.run.seed,
            "wall_seconds": self.wall_seconds,
        }

    def _off(self):
        """Averaging's deviation of place and value, as shares."""
        place = self.averaged_place / self.place.estimate - 1.0
        return place, self.averaged_value / self.value.estimate - 1.0


def optimum_of_one(
    scene: Scene,
    over: str,
    low: float | None,
    high: float | None,
    maximise: str,
    method: str,
    closure: str | None,
    running: RunnerOptions,
) -> Optimum:
    """Where a mean is largest over one parameter: see `harvester.optimum`."""
    clock = time.perf_counter()
    load = scene.load.circuit
    check_name("quantity", maximise, (*MAXIMISED, *(RATIOS if load and load.has_output else ())))
    check_name("method", method, ENGINES)
    ENGINES[method].check(scene)
    closure = check_name("closure", closure or DEFAULT_CLOSURE, CLOSURES)
    axis = Axis.of(scene, over, low, high)
    device = _common_knots(scene, axis)
    follow = running.pop("progress", None) or (lambda share, words: None)
    with open_runner(**running) as opened:
        place, value, reason = None, None, f"knows no {maximise.replace('_', ' ')}"
        if maximise in MAXIMISED:
            place, value, reason = averaged(device, axis, maximise, closure, opened)
        follow(0.3, "simulation")
        search = Search(device, axis, maximise, method, opened)
        found, fitted = search.find(None if place is None else axis.coordinate(place))
        follow(0.9, "comparison")
        there = device.replace({axis.key: found.estimate})
        wanted = [search.request(axis.coordinate(found.estimate)), Request(there, closure)]
        simulated, by_closure = answers_in_time(opened, wanted)
    if isinstance(simulated, HarvesterError):
        raise simulated
    refused = isinstance(by_closure, HarvesterError) or maximise not in MAXIMISED
    return Optimum(
        scene=scene,
        axis=axis,
        quantity=maximise,
        closure=closure,
        averaged_place=place,
        averaged_value=value,
        averaged_reason=reason,
        averaged_there=None if refused else amount(by_closure, maximise),
        method=method,
        place=found,
        value=simulated.in_units()[maximise],
        fitted=fitted,
        wall_seconds=time.perf_counter() - clock,
    )


def _common_knots(scene, axis):
    """The scene with one spacing for the whole range: else places would not share their noise."""
    ends = [scene.replace({axis.key: end}) for end in (axis.low, axis.high)]
    return on_common_knots([scene], ends)[0]
