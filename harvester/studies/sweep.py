"""Many scenes by closures, Monte Carlo and circuit, spread over one pool of workers."""

import math
import time
from dataclasses import dataclass, field

import numpy as np

from harvester.averaging import TOLERANCES
from harvester.averaging import average as average_parameters
from harvester.averaging.of_scene import average, averaged_device, estimates_of
from harvester.engines import side_by_side
from harvester.engines.protocol import ENGINES
from harvester.engines.side_by_side import MOST_COPIES
from harvester.engines.steps import knot_spacing
from harvester.errors import AveragingError, HarvesterError, LoadError, SimulationError
from harvester.estimates import settling
from harvester.estimates.estimate import Density
from harvester.excitation.ornstein_uhlenbeck import (
    KNOTS_PER_CORRELATION_TIME,
    OrnsteinUhlenbeck,
)
from harvester.files.writing import finite
from harvester.results import Result
from harvester.scene.model import Scene
from harvester.scene.units import scale
from harvester.simulation import simulate

# Quantities whose relative standard error decides whether a run is long enough.
JUDGED = ("mean_square_voltage", "power_conversion_efficiency")
# A run is repeated with what its error bar asks for, and a little more, at most this much longer.
MARGIN, GROWTH = 1.1, 8.0
# Realizations that a request of many is split into: side by side in one netlist they cost half.
REALIZATIONS = 16
# Largest numerical error of a closure: finer grids would show in no figure.
CLOSURE_ERROR = 5e-3
# Wall-clock limit of one request (s).
TIME_LIMIT = 3600.0
# Rough cost of a request in closure points.
COSTS = {"circuit": 20.0, "monte-carlo": 2.0, "fokker_planck": 5.0}


@dataclass(frozen=True)
class Request:
    """One scene by one method.

    Attributes
    ----------
    scene : Scene
        Its run is the first one tried.
    method : str
        An engine or a closure.
    error : float
        Relative standard error of E[V²] and PCE that a simulation is made longer for.
    longest : float
        Most measured time of one realization (s); the scene's own where that is longer.
    density : bool
        Whether p(X) is wanted.
    moments : bool
        Whether the moments of a simulation are wanted, for paired differences.
    """

    scene: Scene
    method: str
    error: float = math.inf
    longest: float = 0.0
    density: bool = False
    moments: bool = False

    @property
    def simulated(self):
        """Whether an engine answers it, and no closure."""
        return self.method in ENGINES


@dataclass(frozen=True)
class Answer:
    """What a method says of a scene, scaled units.

    Attributes
    ----------
    scene : Scene
        With the run as it was.
    quantities : dict of str to Estimate
        `standard_error` is the numerical error for a closure.
    density : Density or None
        Of the displacement.
    seconds : float
        Of one core, repeated shorter runs included.
    simulated_time : float
        Of the run that counts (s); 0 for a closure.
    energy_balance_residual : float or None
    misses_jumps : bool
        One jump between the wells more would change E[V²] by more than the error asked for: the
        error bar knows nothing of jumps that the run did not see.
    notes : tuple of str
    result : Result or None
        With its moments, where they were asked for.
    """

    scene: Scene
    quantities: dict
    density: Density | None
    seconds: float
    simulated_time: float = 0.0
    energy_balance_residual: float | None = None
    misses_jumps: bool = False
    notes: tuple = ()
    result: Result | None = field(default=None, repr=False)

    def to_dict(self):
        """Plain values for JSON."""
        content = {
            "quantities": {
                name: {
                    "estimate": finite(estimate.estimate),
                    "standard_error": finite(estimate.standard_error),
                }
                for name, estimate in self.quantities.items()
            },
            "seconds": self.seconds,
        }
        if self.simulated_time > 0.0:
            content |= {
                "simulated_time": self.simulated_time,
                "seed": self.scene.run.seed,
                "realizations": self.scene.run.realizations,
                "knot_spacing": knot_spacing(self.scene),
                "energy_balance_residual": finite(self.energy_balance_residual),
                "misses_jumps": self.misses_jumps,
                "notes": list(self.notes),
            }
        if self.density is not None:
            error = self.density.standard_error
            content["density"] = {
                "displacement": self.density.centre.tolist(),
                "density": self.density.density.tolist(),
                "standard_error": None if error is None else error.tolist(),
            }
        return content


def sweep(requests, pool, progress=None, on_answer=None):
    """Answer many requests, equal ones once, begun in the order given.

    Parameters
    ----------
    requests : iterable of Request
    pool : harvester.engines.workers.WorkerPool
    progress : callable or None
        Given the share done, 0 … 1.
    on_answer : callable or None
        Given (request, outcome) as soon as there is one.

    Returns
    -------
    dict of Request to Answer, AveragingError, LoadError or SimulationError
        What a closure refuses or a run fails of stands in the answer's place.
    """
    ordered = list(dict.fromkeys(requests))
    follow = _Follower([_cost(request) for request in ordered], progress) if progress else None
    calls = [{"request": request} for request in ordered]
    outcomes = pool.map(
        answer,
        calls,
        TIME_LIMIT,
        follow,
        keep_going=True,
        on_result=on_answer and (lambda index, outcome: on_answer(ordered[index], outcome)),
    )
    return dict(zip(ordered, outcomes, strict=True))


def costly_first(requests):
    """The requests with the long ones in front: no process is left alone with one at the end."""
    return sorted(requests, key=_cost, reverse=True)


def answer(request, report):
    """One request, in a worker process."""
    try:
        return _simulated(request) if request.simulated else _averaged(request)
    except (AveragingError, LoadError, SimulationError) as error:
        return error
    except HarvesterError:
        # Of the call or the machine, so the same at every point.
        raise
    except Exception as error:
        kind = SimulationError if request.simulated else AveragingError
        return kind(f"{type(error).__name__}: {error}")
    finally:
        report(1.0)


def resolving(scene):
    """The scene with knots close enough for its noise.

    A sweep over τ1 would else leave the scene's own spacing behind.
    """
    spacing = scene.excitation.knot_spacing or knot_spacing(scene)
    if isinstance(scene.excitation, OrnsteinUhlenbeck):
        spacing = min(spacing, scene.excitation.correlation_time / KNOTS_PER_CORRELATION_TIME)
    return scene.replace({"excitation.knot_spacing": spacing})


def with_knots(scene):
    """The scene with its spacing of knots written out: what changes keep, and so their noise."""
    return scene.replace({"excitation.knot_spacing": knot_spacing(scene)})


def relative_error(estimate):
    """Standard error as a share of the estimate; infinite without one."""
    if estimate.standard_error is None or not estimate.estimate:
        return math.inf
    return abs(estimate.standard_error / estimate.estimate)


class InThisProcess:
    """Realizations one after another, where the process is itself a worker."""

    def map(self, function, calls, time_limit=None, on_progress=None, keep_going=False):
        """See `harvester.engines.workers.WorkerPool.map`."""
        return [function(report=_ignore, **arguments) for arguments in calls]


def _ignore(moments):
    """A report that nobody reads."""


def _copies(request):
    """All realizations in as few netlists as pay: this process alone works on them."""
    if request.method != "circuit":
        return None
    return side_by_side.copies(request.scene, lambda: MOST_COPIES["behavioural"], netlists=1)


def _simulated(request):
    scene, seconds = request.scene, 0.0
    longest = max(request.longest, scene.run.duration)
    while True:
        result = simulate(scene, request.method, copies=_copies(request), pool=InThisProcess())
        seconds += result.engine_seconds
        duration = scene.run.duration * _lengthening(result, request.error)
        if duration <= scene.run.duration or scene.run.duration >= longest:
            break
        scene = scene.replace({"run.duration": min(duration, longest)})
    return Answer(
        scene=scene,
        quantities=result.scaled_quantities,
        density=result.densities["displacement"] if request.density else None,
        seconds=seconds,
        simulated_time=result.simulated_time,
        energy_balance_residual=result.energy_balance_residual,
        misses_jumps=unseen_jump(result) > request.error,
        notes=(*result.notes, *_shortfall(result, request.error)),
        result=result if request.moments else None,
    )


def _lengthening(result, error):
    """How many times longer a run must be for the error asked for; at most 1: long enough."""
    reached = max(relative_error(result.scaled_quantities[name]) for name in JUDGED)
    needed = max(MARGIN * (reached / error) ** 2 if reached > error else 0.0, 0.0)
    return min(max(needed, unseen_jump(result) / error), GROWTH)


def unseen_jump(result):
    """What one more jump between the wells would add to E[V²] of a result, as a share."""
    parameters, _ = scale(result.scene)
    measured = result.scene.run.duration * result.scene.run.realizations
    square = result.scaled_quantities["mean_square_voltage"].estimate
    return settling.unseen_jump(parameters, square, measured)


def _shortfall(result, error):
    """What a run as long as allowed did not reach."""
    reached = max(relative_error(result.scaled_quantities[name]) for name in JUDGED)
    notes = []
    if reached > error:
        notes.append(f"relative standard error {reached:.1%}, above the {error:.1%} asked for")
    if unseen_jump(result) > error:
        notes.append(f"one jump more would add {unseen_jump(result):.1%} to E[V²]")
    return notes


def _averaged(request):
    tolerance = max(CLOSURE_ERROR, TOLERANCES[request.method])
    if request.density:
        result = average(request.scene, request.method, tolerance)
        density = result.densities["displacement"]
        return Answer(request.scene, result.scaled_quantities, density, result.wall_seconds)
    clock = time.perf_counter()
    averages = average_parameters(averaged_device(request.scene), request.method, tolerance)
    return Answer(request.scene, estimates_of(averages), None, time.perf_counter() - clock)


def _cost(request):
    return COSTS.get(request.method, 1.0) + 2.0 * (request.density and not request.simulated)


class _Follower:
    """Adds up how far the requests are."""

    def __init__(self, costs, progress):
        self._costs, self._progress = np.array(costs), progress
        self._done = np.zeros(len(costs))

    def __call__(self, index, share):
        self._done[index] = share
        self._progress(float(self._done @ self._costs / self._costs.sum()))


def failed(outcome):
    """Whether an outcome of `sweep` is no answer."""
    return isinstance(outcome, HarvesterError)
