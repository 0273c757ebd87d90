"""Where one parameter, or several, make a mean largest; Eq. 37 is that of PCE over D."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from harvester.arguments import check_name
from harvester.averaging import CLOSURES, DEFAULT_CLOSURE
from harvester.errors import HarvesterError
from harvester.estimates.output_side import RATIOS
from harvester.method import Method
from harvester.running import Request, RunnerOptions, open_runner
from harvester.scene.model import Scene
from harvester.simulation.methods import Engine
from harvester.simulation.orbits import note_on_one_start, with_orbit
from harvester.studies.answers import checked_method, first_answer
from harvester.studies.optimum.axis import Axis
from harvester.studies.optimum.line import MAXIMISED, along
from harvester.studies.optimum.result import Optimum
from harvester.studies.optimum.several import over_several

# Starts that are drawn at the place found, without noise: an orbit that a quarter of them reach is
# missed once in a hundred times.
STARTS = 16


def largest(
    scene: Scene,
    over: Mapping[str, Sequence[float | None]],
    maximise: str,
    method: str | Method | None,
    closure: str | None,
    evaluations: int | None,
    precision: float | None,
    running: RunnerOptions,
) -> Optimum:
    """Where a mean is largest over one parameter or several: see `harvester.optimum`."""
    clock = time.perf_counter()
    limited = scene.beam is not None and scene.beam.strain_limit is not None
    chosen = checked_method(scene, method)
    # A maximum on a limit is no peak that a curve is fitted to: it is searched for as over several.
    # So is one of a closure, which has no noise.
    is_one = len(over) == 1 and not limited and isinstance(chosen, Engine)
    for name, value in {"evaluations": evaluations, "precision": precision}.items():
        if value is not None and is_one:
            raise HarvesterError(f"--{name}: is for several parameters, a second --over")
    if closure is not None and not is_one:
        raise HarvesterError("--closure: is for one parameter by an engine; else use --method")
    follow = running.pop("progress", None) or (lambda share, words: None)
    beside = check_name("closure", closure or DEFAULT_CLOSURE, CLOSURES)
    if is_one:
        load = scene.load.circuit
        outputs = RATIOS if load and load.has_output else ()
        check_name("quantity", maximise, (*MAXIMISED, *outputs))
    if limited and not isinstance(chosen, Engine):
        raise HarvesterError(
            f"{scene.name}: beam.strain_limit: {chosen.name} gives no peak strain; take --method "
            "monte-carlo or circuit, or the limit out"
        )
    axes = [Axis.of(scene, key, *ends) for key, ends in over.items()]
    with open_runner(**running) as runner:
        if is_one:
            optimum = along(scene, axes[0], maximise, chosen, beside, runner, follow)
        else:
            optimum = over_several(
                scene, axes, maximise, chosen, runner, follow, evaluations, precision
            )
        orbits = _orbits_at(optimum, chosen, runner)
    return replace(optimum, orbits=orbits, seconds=time.perf_counter() - clock)


def _orbits_at(found, method, runner):
    """The orbits that drawn starts reach at the place; empty under noise or of a linear device."""
    at_maximum = found.scene.replace(
        {parameter.axis.key: parameter.place for parameter in found.parameters}
    )
    if not isinstance(method, Engine) or not note_on_one_start(at_maximum):
        return ()
    if at_maximum.run.starts is None:
        at_maximum = replace(at_maximum, run=replace(at_maximum.run, starts=STARTS))
    return first_answer(runner, Request(with_orbit(at_maximum), method)).orbits
