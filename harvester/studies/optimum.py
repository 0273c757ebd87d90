"""`optimum`: where one parameter makes a mean largest; Eq. 37 is that of PCE over D.

Averaging scans the range and refines its highest point. Simulation then looks there, on common
noise, moves on while the slope asks for it, and fits a cubic to several places: the interval of
the maximum's place is what the paired errors of the values make of it.
"""

import time
from dataclasses import dataclass

from harvester.engines.protocol import ENGINES
from harvester.engines.steps import knot_spacing
from harvester.engines.workers import WorkerPool
from harvester.errors import HarvesterError
from harvester.estimates.estimate import Estimate
from harvester.files.plain_text import nearest
from harvester.files.writing import finite
from harvester.results import with_error
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers
from harvester.scene.units import require_resistor
from harvester.simulation import check_name
from harvester.studies.optimum_search import Axis, Search, amount, averaged, in_units
from harvester.studies.sweep import Request, failed, resolving, sweep

MAXIMISED = ("power_conversion_efficiency", "mean_power", "mean_square_voltage")
# A range that was not given: the scene's value over and times this.
SPAN = 10.0
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
    engine : str
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
    engine: str
    place: Estimate
    value: Estimate
    fitted: list
    wall_seconds: float

    @property
    def interval(self):
        """Of the place: two standard errors to either side."""
        reach = INTERVAL * self.place.standard_error
        return self.place.estimate - reach, self.place.estimate + reach

    def table(self):
        """Header and rows of the table, as text."""
        header = ["method", "parameter", "optimum at", "interval", self.quantity.replace("_", " ")]
        low, high = self.interval
        rows = [[self.engine, self.axis.key, f"{self.place.estimate:.4g}"]]
        rows[0] += [f"{low:.4g} … {high:.4g}", with_error(self.value)]
        if self.averaged_place is not None:
            place, value = f"{self.averaged_place:.4g}", f"{self.averaged_value:.4g}"
            rows.insert(0, [f"averaging, {self.closure}", self.axis.key, place, "", value])
        return header, rows

    def sentences(self):
        """How far averaging is off, and what was run."""
        lines = []
        if self.averaged_place is None:
            lines.append(f"averaging, {self.closure}: no optimum: {self.averaged_reason}")
        else:
            place, value = self._off()
            lines.append(
                f"averaging, {self.closure}: place {place:+.1%}, value {value:+.1%} off "
                f"{self.engine}"
            )
        if self.averaged_there is not None:
            off = self.averaged_there / self.value.estimate - 1.0
            lines.append(f"averaging, {self.closure}, at {self.engine}'s optimum: {off:+.1%}")
        low, high = self.fitted[0][0], self.fitted[-1][0]
        lines.append(
            f"{self.engine}: cubic through {len(self.fitted)} places in {low:.4g} … {high:.4g} on "
            f"common noise, seed {self.scene.run.seed}; interval: two standard errors"
        )
        return [*lines, f"{self.wall_seconds:.1f} s"]

    def to_dict(self):
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
                "engine": self.engine,
                "place": _entry(self.place),
                "interval": list(self.interval),
                "value": _entry(self.value),
                "fitted": [{"place": x, **_entry(y)} for x, y in self.fitted],
            },
            "seed": self.scene.run.seed,
            "wall_seconds": self.wall_seconds,
        }

    def _off(self):
        """Averaging's deviation of place and value, as shares."""
        place = self.averaged_place / self.place.estimate - 1.0
        return place, self.averaged_value / self.value.estimate - 1.0


def optimum(
    scene,
    over,
    *,
    low=None,
    high=None,
    maximise=MAXIMISED[0],
    engine="monte-carlo",
    closure="slow_load",
    workers=None,
    progress=None,
):
    """Find where a mean is largest over one parameter, by averaging and by simulation.

    Parameters
    ----------
    scene : Scene
        Its run is the first one tried at each place.
    over : str
        "table.key" of a number in the scene.
    low, high : float or None
        Range; None: a tenth and ten times the scene's value, within what the key allows.
    maximise : str
        A name in `MAXIMISED`.
    engine : str
        "monte-carlo", or "circuit" for runs of the scene's own length.
    closure : str
    workers : int or None
        Processes; None: one per core.
    progress : callable or None
        Given the share done, 0 … 1.

    Returns
    -------
    Optimum
        In the scene's units.

    Raises
    ------
    HarvesterError
        No such key, or no range.
    OptimumError
        The largest value lies at an end of the range, or no maximum can be told from noise.
    SimulationError
    """
    clock = time.perf_counter()
    check_name("quantity", maximise, MAXIMISED)
    check_name("engine", engine, ENGINES)
    if engine == "monte-carlo":
        require_resistor(scene, "Monte Carlo")
    axis = _axis(scene, over, low, high)
    device = _common_knots(scene, axis)
    follow = progress or (lambda share: None)
    with WorkerPool(workers=workers) as pool:
        place, value, reason = averaged(device, axis, maximise, closure, pool)
        follow(0.3)
        search = Search(device, axis, maximise, engine, pool)
        found, fitted = search.find(None if place is None else axis.coordinate(place))
        follow(0.9)
        there = device.replace({axis.key: found.estimate})
        run = search.scene_at(axis.coordinate(found.estimate))
        wanted = [Request(run, engine), Request(there, closure)]
        outcomes = sweep(wanted, pool)
        simulated, closure_there = (outcomes[request] for request in wanted)
    if failed(simulated):
        raise simulated
    return Optimum(
        scene=scene,
        axis=axis,
        quantity=maximise,
        closure=closure,
        averaged_place=place,
        averaged_value=value,
        averaged_reason=reason,
        averaged_there=None if failed(closure_there) else amount(closure_there, maximise),
        engine=engine,
        place=found,
        value=in_units(simulated, maximise),
        fitted=fitted,
        wall_seconds=time.perf_counter() - clock,
    )


def _axis(scene, over, low, high):
    """The key and its range, checked."""
    known = numbers(scene)
    if over not in known:
        raise HarvesterError(
            f"{over}: no number of this scene{nearest(over, known)}; there are {', '.join(known)}"
        )
    value, spec = known[over]
    ends = sorted((value / SPAN, value * SPAN))
    low = max(ends[0], spec.low) if low is None else low
    high = min(ends[1], spec.high) if high is None else high
    if not low < high:
        raise HarvesterError(f"{over}: no range from {low:g} to {high:g}; give --from below --to")
    for end in (low, high):
        scene.replace({over: end})
    return Axis(over, low, high)


def _common_knots(scene, axis):
    """The scene with one spacing for the whole range: else places would not share their noise."""
    ends = [scene.replace({axis.key: end}) for end in (axis.low, axis.high)]
    spacing = min(knot_spacing(resolving(end)) for end in ends)
    return scene.replace({"excitation.knot_spacing": spacing})


def _entry(estimate):
    return {"estimate": estimate.estimate, "standard_error": finite(estimate.standard_error)}
