"""Method `fokker_planck`: stationary density of motion (X, X'), charge Z and noise η.

The Fokker–Planck equation of Eq. 4 with Z = X − V, Z' = λ(X − Z), is advanced in time by
`propagator`. The stationary density is invariant under P, the propagator over about one period:
(1 − P) p = 0 (`solution`). The iteration starts from a Gibbs density on a coarse grid, which shows
the range and resolution that the grid needs (`region`). The error of the next grid is estimated on
grids that are finer in time, in X and X' or in Z, each solution a start for the next, until it is
less than the tolerance.

The method makes no assumptions on the device's symmetry, the noise's correlation time, the
contacts' damping or the load's rate. If motion hardly ever leaves its well, the grid covers only
one well (`wells`).
"""

import numpy as np
from threadpoolctl import threadpool_limits

from harvester.averaging.averages import Averages
from harvester.averaging.grid_density import GridDensity
from harvester.averaging.jumps import rates_of_jumps, slowest_decay_rate
from harvester.averaging.region import HOPELESS_DISPLACEMENT, NODE_REFINEMENT, Level, Region
from harvester.averaging.solution import Solution, StationaryProblem, period
from harvester.averaging.wells import HELD_BACK, barrier, driven, lone_well
from harvester.base.errors import AveragingError
from harvester.device import timescales
from harvester.device.hertz import HertzDamp
from harvester.device.system import System

# The coarse grid that determines the region, and the first grid of the answer; see `Level`.
REGION_LEVEL = Level(5.0, 2.2, 1.7, 3, 3, 50.0)
FIRST_LEVEL = Level(6.0, 3.0, 2.3, 4, 3)
# Nodes of Z for each decade of the tolerance; the error falls exponentially with their number.
NODES_PER_DECADE = 3.0
# No pair of grids shows the errors of the range, of the nodes of Z and of the convergence
# criterion: their sum is stated as this share of the tolerance.
UNSEEN_ERROR = 0.2
# If the charge's decay rate times the period is below this, and motion leaves its well more rarely,
# the error of the nodes of Z is not small: jumps are much more frequent at some nodes than at
# others. A grid with more nodes of Z then shows it.
SLOW_CHARGE = 0.1
# If refining the nodes changes every mean by less than SPARSE_GRID_CHANGE of the tolerance, the
# time-step error is estimated on the coarser grid, which is cheaper. This does not hold if the
# charge decays slower than a period and the relative change of the rate of saddle crossings exceeds
# SPARSE_GRID_CROSSINGS: on few nodes each further step smears more density over the saddle.
SPARSE_GRID_CHANGE, SPARSE_GRID_CROSSINGS = 0.2, 0.2
# Largest number of coarse grids that are tried until one covers its own density.
REGION_ATTEMPTS = 8
# Shortest contact, in periods of small oscillations; devices with shorter ones are rejected.
SHORTEST_CONTACT = 2e-2
# Decay rate times period: above the first value steps would be too short. Below the second the
# solver would need too many vectors, and means are extrapolated from faster rates instead.
FASTEST_DECAY = 60.0
SLOWEST_DECAY = 2e-3
# Means at slower rates are extrapolated linearly from the slowest rate and FARTHER times that rate.
# Such a line enlarges errors: both means are exact to LINE_TOLERANCE_SHARE of the tolerance, with
# CONTINUED_WORK times the work that is usually allowed.
FARTHER = 2.0
LINE_TOLERANCE_SHARE = 0.3
CONTINUED_WORK = 2.0
# The first coarse grid's E[X'²] may be wrong by up to this factor.
UNTOLD_FACTOR = 2.0
# Two grids with different steps give Richardson's correction, which assumes an error of second
# order. With long steps the error is of higher order, so that only the share CORRECTION_TAKEN of
# the correction is added. STATED_ERROR gives the shares of this correction, and of the last changes
# by refining nodes and charges, that are stated as error.
CORRECTION_TAKEN, STATED_ERROR = 0.6, {"steps": 0.7, "nodes": 0.75, "charges": 0.75}
# If the nodes do not resolve a contact, the error is of first order: 4/3 times the nodes remove a
# quarter of it, so that three times the change remains.
UNRESOLVED = 1.0 / (NODE_REFINEMENT - 1.0)
# The means that must meet the tolerance.
JUDGED = (
    "mean_square_voltage",
    "power_conversion_efficiency",
    "mean_square_velocity",
    "mean_square_displacement",
)
# Negative values of these means are rounding errors in the difference of large numbers and are
# rejected.
NEVER_NEGATIVE = ("mean_square_voltage", "power_in")
# The tolerance of an efficiency is relative up to 0.3. Above, it is absolute: 0.3 percentage points
# at a tolerance of 1 %.
HIGH_EFFICIENCY, FEW_POINTS = 0.3, 3e-3

# Arrays are small: more BLAS threads double the processor time without a gain in speed.
ONE_THREAD = {"limits": 1, "user_api": "blas"}


def fokker_planck(device: System, tolerance: float, memory: bool = False) -> Averages:
    """Means and densities of the stationary density, on a grid fine enough for the tolerance.

    Parameters
    ----------
    tolerance : float
        Largest relative numerical error of each mean; of an efficiency above 0.3 at most 0.3
        percentage points, or 0.3 times the tolerance if that is more. The mechanical loss is
        exempt: it is the possibly small difference of two powers.
    memory : bool
        Also compute `slowest_decay_rate` and the rates of jumps between wells: this takes three to
        seven times as long in total.

    Raises
    ------
    AveragingError
        The contact law holds the impact velocity constant; the load is too fast or too slow; the
        motion is undamped or unconfined; the finest grid does not meet the tolerance.
    """
    _check(device)
    slowest = SLOWEST_DECAY / period(device)
    rate = device.transducer.decay_rate()
    with threadpool_limits(**ONE_THREAD):
        if 0.0 < rate < slowest:
            return _slow_decay(device, slowest, tolerance)
        return _answer(_refined(StationaryProblem(device, tolerance)), memory)


def outline(device: System) -> GridDensity:
    """Densities on the first coarse grid, within tenths of a second.

    No error is estimated: means on that grid differ by up to 10 % from the means of
    `fokker_planck`, which rejects the same devices.
    """
    _check(device)
    with threadpool_limits(**ONE_THREAD):
        return _region_and_density(StationaryProblem(device, REGION_LEVEL.tolerance))[1].density


def _check(device):
    """Raise if the device has more states than the grid, or needs too many steps."""
    if any(not isinstance(contact.law, HertzDamp) for contact in device.contacts):
        raise AveragingError(
            "fokker_planck needs Hertz's contact law, since its grids cannot resolve a force that "
            "begins with a jump; use harvester simulate"
        )
    if any(contact.law.holds for contact in device.contacts):
        raise AveragingError(
            'impact_velocity = "event": the speed at the beginning of a contact is not part of the '
            'state that fokker_planck follows; use "energy", or harvester simulate'
        )
    if timescales.contact_time(device) < SHORTEST_CONTACT * period(device):
        raise AveragingError(
            f"stoppers.stiffness: contacts last less than {SHORTEST_CONTACT:g} of a "
            "period, too short for the steps of fokker_planck; use harvester simulate"
        )
    rate, fastest = device.transducer.decay_rate(), FASTEST_DECAY / period(device)
    if rate > fastest:
        raise AveragingError(
            f"the transducer's charge decays at {rate:.3g} /s, which exceeds {fastest:.3g} /s, the "
            "limit for the steps of fokker_planck; use harvester simulate"
        )


def _slow_decay(device, slowest, tolerance):
    """Means on the straight line through those at two slow rates of decay, towards λ = 0.

    At slow rates λ the charge Z is the slowest variable, and the means are linear in λ. If jumps
    between the wells are slower still, they are not: the extrapolated difference counts as error.
    """
    part, rate = device.transducer, device.transducer.decay_rate()
    answers = []
    for factor in (slowest / rate, FARTHER * slowest / rate):
        rates = {name: factor * getattr(part, name) for name in ("load_rate", "own_rate")}
        slowed = device._replace(transducer=part._replace(**rates))
        task = StationaryProblem(slowed, tolerance, CONTINUED_WORK, read=part)
        answers.append(_refined(task, LINE_TOLERANCE_SHARE))
    (grids, near, error), (_, far, _) = answers
    share = 1.0 - rate / slowest
    added = {name: share * (near[name] - far[name]) for name in near if name in far}
    means = {name: near[name] + change for name, change in added.items()}
    error = {name: error[name] + abs(change) for name, change in added.items()}
    name, excess = _worst(means, error)
    if excess > tolerance:
        raise AveragingError(
            f"the transducer's charge decays at {rate:.3g} /s, more slowly than fokker_planck's "
            f"limit of {slowest:.3g} /s: extrapolation changes {name.replace('_', ' ')} by "
            f"{excess:.2g} of its value, more than the tolerance of {tolerance:g}, since jumps "
            "between the wells are as slow: simulate"
        )
    return _answer((grids, means, error))


def _refined(task, share=1.0):
    """Refine the grid in time and in space separately until the errors are small; means and errors.

    The search stops at this share of the tolerance.
    """
    tolerance = share * task.tolerance
    nodes = [_first(task, tolerance)]
    grids = {"nodes": nodes}
    _refine(grids, "nodes")
    while (worst := _changed(nodes))[1] > tolerance:
        _refine(grids, "nodes", worst)
    # On the coarser grid the errors of nodes and step could not be separated.
    before, after = (solution.means.get("well_crossing_rate", 0.0) for solution in nodes[-2:])
    rate, time = task.device.transducer.decay_rate(), period(task.device)
    leaking = rate * time < 1.0 and abs(after - before) > SPARSE_GRID_CROSSINGS * before
    enough = -1 if leaking or worst[1] >= SPARSE_GRID_CHANGE * tolerance else -2
    grids |= {"steps": [nodes[enough]], "charges": [nodes[0]]}
    _refine(grids, "steps")
    crossings = nodes[0].means.get("well_crossing_rate", np.inf)
    if crossings < rate < SLOW_CHARGE / time:
        _refine(grids, "charges")
    while True:
        means, errors = _corrected(grids)
        error = {
            name: sum(part[name] for part in errors.values()) + UNSEEN_ERROR * tolerance * abs(mean)
            for name, mean in means.items()
        }
        worst = name, excess = _worst(means, error)
        if excess <= tolerance:
            return grids, means, error
        _refine(grids, max(errors, key=lambda respect: errors[respect][name]), worst)


def _first(task, tolerance):
    """The solution on the first grid for the answer, after the region has been found."""
    region, rough = _region_and_density(task)
    region.check(task.device)
    requested, solved = (part.decay_rate() for part in (task.transducer, task.device.transducer))
    if (
        requested < rough.means.get("well_crossing_rate", 0.0) < FARTHER * solved
        and requested < solved
    ):
        raise AveragingError(
            f"the transducer's charge decays at {requested:.3g} /s: fokker_planck extrapolates its "
            f"means from {solved:.3g} /s, and jumps between the wells are as slow: simulate"
        )
    nodes = int(np.ceil(-NODES_PER_DECADE * np.log10(tolerance)))
    level = FIRST_LEVEL._replace(nodes=max(nodes, FIRST_LEVEL.nodes), tolerance=tolerance)
    return Solution(task, region, level, rough)


def _refine(grids, respect, largest=None):
    """Add a solution on a grid with more "steps", "nodes" or "charges" than the last of `grids`.

    `largest` is (name of a mean, its relative error so far), for the message.
    """
    last = grids[respect][-1]
    try:
        level = last.level.more(respect)
        finer = Solution(last.task, last.region, level, last)
    except AveragingError as refusal:
        if largest is None:
            raise
        name, share = largest
        raise AveragingError(
            f"the relative error of {name.replace('_', ' ')} on the finest grid is {share:.2g}, "
            f"above the tolerance of {last.level.tolerance:g}: raise the tolerance, or simulate"
        ) from refusal
    for name in NEVER_NEGATIVE:
        if finer.means[name] < 0.0:
            raise AveragingError(
                f"{name.replace('_', ' ')} is negative on two successive grids: it is a small "
                "difference of large terms, lost by rounding; simulate"
            )
    grids[respect].append(finer)


def _region_and_density(task):
    """Region of the density, and the density on a coarse grid.

    If hardly any motion leaves the wells, the grid covers one of them, which represents all.
    """
    device = task.device
    lone = lone_well(device)
    height = 0.0 if lone is None else barrier(device, lone)
    alone = lone is not None and HELD_BACK * driven(device, lone) < height
    region, solution, joined = Region.guessed(device, lone if alone else None), None, False
    for attempt in range(REGION_ATTEMPTS):
        region.check(device, HOPELESS_DISPLACEMENT)
        solution = Solution(task, region, REGION_LEVEL, solution)
        fitted = Region.fitted(device, solution)
        spread = solution.means["mean_square_velocity"]
        joined = joined or fitted.leaves_well(device)
        held_back = not joined and 0.0 < HELD_BACK * spread < height
        if held_back == (region.well is not None):
            if fitted.alike(region):
                return fitted, solution
        elif spread > 0.0 and (attempt > 0 or UNTOLD_FACTOR * HELD_BACK * spread < height):
            fitted = Region.guessed(device, lone if held_back else None, np.sqrt(spread))
            solution = None
        region = fitted
    raise AveragingError("no grid covers the range of the motion: simulate")


def _changed(solutions):
    """The mean in `JUDGED` with the largest relative change on the last grid, and that change."""
    before, last = (solution.means for solution in solutions[-2:])
    return _worst(last, {name: abs(last[name] - before[name]) for name in JUDGED})


def _corrected(grids):
    """Means corrected by the differences between grids, and stated errors by kind of refinement.

    The errors of steps and nodes are additive, so grids that differ in one alone give that error.
    The step error is of second order or higher and mostly subtracted; the error of the nodes
    vanishes faster.
    """
    sooner, soonest = grids["steps"][-2:]
    left = 1.0 / ((soonest.steps / sooner.steps) ** 2 - 1.0)
    doubted = STATED_ERROR | {"steps": left * STATED_ERROR["steps"]}
    if grids["nodes"][-1].unresolved:
        doubted["nodes"] = UNRESOLVED
    values = {respect: [grid.means for grid in solutions] for respect, solutions in grids.items()}
    means, errors = _summed(values, {"steps": CORRECTION_TAKEN * left}, doubted)
    means["power_conversion_efficiency"] = means["mean_power"] / means.pop("power_in")
    return means, errors


def _compared(grids, find):
    """Rates by `find`; error: the whole change between the two grids of each kind of refinement.

    Empty if `find` takes too many steps.
    """
    # The order matters: each grid starts from the state of the previous one.
    rates_of = find(dict.fromkeys(solution for pair in grids.values() for solution in pair))
    if not rates_of:
        return {}, {}
    values = {respect: [rates_of[solution] for solution in pair] for respect, pair in grids.items()}
    rates, errors = _summed(values, {}, dict.fromkeys(grids, 1.0))
    return rates, {name: sum(changes[name] for changes in errors.values()) for name in rates}


def _summed(values, corrected, doubted):
    """The means, summed from the first grid and the changes on finer ones, with their errors.

    `corrected` is the share of each refinement's last change that is added; `doubted` is the share
    stated as error.
    """
    means, errors = dict(values["nodes"][0]), {}
    for respect, grids in values.items():
        first, before, last = grids[0], grids[max(len(grids) - 2, 0)], grids[-1]
        change = {name: last[name] - before[name] for name in means}
        for name in means:
            means[name] += last[name] - first[name] + corrected.get(respect, 0.0) * change[name]
        errors[respect] = {name: doubted[respect] * abs(shift) for name, shift in change.items()}
    return means, errors


def _worst(means, error):
    """The mean in `JUDGED` with the largest relative error, and that error."""
    scale = {name: abs(means[name]) or np.inf for name in JUDGED}
    if error[efficiency := "power_conversion_efficiency"] > FEW_POINTS:
        scale[efficiency] = min(scale[efficiency], HIGH_EFFICIENCY)
    name = max(JUDGED, key=lambda name: error[name] / scale[name])
    return name, error[name] / scale[name]


def _answer(refined, memory=False):
    """Means and their errors, and for several wells the rates of jumps between them."""
    grids, means, error = refined
    fields = Averages.__dataclass_fields__
    between_wells = {name: means.pop(name) for name in list(means) if name not in fields}
    if between_wells.get("well_crossing_rate", 0.0) < 0.0:
        error["well_crossing_rate"] -= between_wells["well_crossing_rate"]
        between_wells["well_crossing_rate"] = 0.0
    if "well_crossing_rate" in between_wells and memory:
        ends = {respect: (solutions[0], solutions[-1]) for respect, solutions in grids.items()}
        ends["nodes"] = grids["nodes"][-2:]
        for find in (slowest_decay_rate, rates_of_jumps):
            rates, doubts = _compared(ends, find)
            between_wells, error = between_wells | rates, error | doubts
    return Averages(
        **means,
        numerical_error=error,
        density=grids["steps"][-1].density,
        between_wells=between_wells,
    )
