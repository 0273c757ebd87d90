"""`optimum`: where one parameter, or several, make a mean largest; Eq. 37 is that of PCE over D."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Unpack

from harvester.arguments import listed, table
from harvester.averaging import CLOSURES, DEFAULT_CLOSURE
from harvester.calling import takes_scene
from harvester.errors import HarvesterError
from harvester.estimates.output_side import RATIOS
from harvester.running import RunnerOptions, open_runner
from harvester.scene.model import Scene
from harvester.simulation.methods import ENGINES
from harvester.simulation.simulate import check_name
from harvester.studies.answers import checked_method
from harvester.studies.optimum.axis import Axis
from harvester.studies.optimum.line import MAXIMISED, along
from harvester.studies.optimum.result import Optimum
from harvester.studies.optimum.several import over_several

# How a caller writes what is varied.
OVER = 'over={"load.resistance": (1e4, 1e6)}'


@takes_scene
def optimum(
    scene: Scene,
    over: str | Mapping[str, tuple | None],
    *,
    low: float | None = None,
    high: float | None = None,
    maximise: str = MAXIMISED[0],
    method: str | None = None,
    closure: str | None = None,
    evaluations: int | None = None,
    precision: float | None = None,
    **running: Unpack[RunnerOptions],
) -> Optimum:
    """Find where a mean is largest over one parameter or several.

    Over one, averaging and simulation are compared, and the place has an interval. Over several,
    places are proposed one after another, and the value has an interval.

    Parameters
    ----------
    scene : Scene
        Its run is that of each evaluation; over one parameter the first one tried at each place.
    over : str or dict of str to (float, float) or None
        "table.key" of a number in the scene, or several with their ranges; None: a tenth and ten
        times the scene's value, within what the key allows.
    low, high : float or None
        Range of a single key.
    maximise : str
        Over one parameter a name in `harvester.studies.optimum.line.MAXIMISED`, of a load with an
        output also one in `harvester.estimates.output_side.RATIOS`, such as "mean_output_power";
        over several whatever the method gives.
    method : str or None
        An engine, over several parameters also a closure; None: "monte-carlo", or "circuit" where
        only that takes the load.
    closure : str or None
        That stands beside simulation, over one parameter; None:
        `harvester.averaging.DEFAULT_CLOSURE`, the most accurate.
    evaluations : int or None
        Places proposed, over several parameters; None: 60 for each. Those of the climb, some tens,
        come on top.
    precision : float or None
        Relative standard error that the value is run for, over several parameters; None: the
        scene's own run.
    **running
        See `harvester.running.open_runner`.

    Raises
    ------
    HarvesterError
        No such key, or no range.
    OptimumError
        The largest value lies at an end of the range, no maximum can be told from noise, or no run
        came to its end.
    MissingLibrary
        Optuna is not installed, and there are several parameters.
    SimulationError
        A run failed; `OutOfTime` where the time is spent.

    Notes
    -----
    The places proposed follow from the seed and the answers alone: with `output` the same call
    after a kill takes the answers that are there and goes on to the same end.
    """
    clock = time.perf_counter()
    ranges = {over: (low, high)} if isinstance(over, str) else table(over, "over", OVER)
    if not ranges:
        raise HarvesterError(f"over: names no key; write {OVER}")
    is_one = len(ranges) == 1
    for name, value in {"evaluations": evaluations, "precision": precision}.items():
        if value is not None and is_one:
            raise HarvesterError(f"--{name}: is for several parameters, a second --over")
    if closure is not None and not is_one:
        raise HarvesterError("--closure: is for one parameter; over several use --method")
    if not isinstance(over, str) and (low is not None or high is not None):
        raise HarvesterError(f"low and high: are for a single key; write {OVER}")
    follow = running.pop("progress", None) or (lambda share, words: None)
    beside = check_name("closure", closure or DEFAULT_CLOSURE, CLOSURES)
    if is_one:
        # Averaging stands beside it, and what is compared with it is a simulation.
        method = check_name("method", method or checked_method(scene, None), ENGINES)
        ENGINES[method].check(scene)
        load = scene.load.circuit
        outputs = RATIOS if load and load.has_output else ()
        check_name("quantity", maximise, (*MAXIMISED, *outputs))
    method = checked_method(scene, method)
    axes = [Axis.of(scene, key, *_ends(key, ends)) for key, ends in ranges.items()]
    with open_runner(**running) as runner:
        if is_one:
            found = along(scene, axes[0], maximise, method, beside, runner, follow)
        else:
            found = over_several(
                scene, axes, maximise, method, runner, follow, evaluations, precision
            )
    return replace(found, seconds=time.perf_counter() - clock)


def _ends(key, ends):
    """Both ends of a range, None where the scene's value decides."""
    if ends is None:
        return None, None
    found = listed(ends, f"over[{key!r}]", "(0.1, 2.0)")
    if len(found) != 2:
        raise HarvesterError(f"over[{key!r}]: has {len(found)} numbers; write (0.1, 2.0)")
    return found
