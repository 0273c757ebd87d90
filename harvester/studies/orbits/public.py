"""Public studies of coexisting motions; see `harvester.studies.public`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from harvester.base.errors import HarvesterError
from harvester.base.signatures import (
    Count,
    Grid,
    Kind,
    MethodOrName,
    OneKey,
    RunnerOptions,
    Share,
    Step,
    key_and_values,
)
from harvester.engines.methods import engine_of
from harvester.scene.calling import takes_scene

if TYPE_CHECKING:
    from harvester.scene.model import Scene
    from harvester.studies.orbits.basins import Basins
    from harvester.studies.orbits.bifurcation import Bifurcation
    from harvester.studies.orbits.residence import Residence

# Default number of starts along one side of the grid.
POINTS = 41


@takes_scene
def basins(
    scene: Scene,
    *,
    displacement: Grid | None = None,
    velocity: Grid | None = None,
    points: Count = POINTS,
    periods: Count | None = None,
    method: MethodOrName = "monte-carlo",
    step: Step = "default",
    **running: Unpack[RunnerOptions],
) -> Basins:
    """The steady motion that a driven device reaches from each start on a grid.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one; its excitation is a sine or a sum of sines.
    displacement, velocity : sequence of float
        Coordinates of the starts, in the scene's units, such as numpy.linspace(-0.01, 0.01, 41)
        (default: a range that includes the energy of the largest motion).
    points : int
        Starts per side for omitted coordinates.
    periods : int or None
        Number of periods of the excitation for which each start is followed (default: as many as
        the transient needs, and three times as many for starts that are then aperiodic).
    method : str or Method
        monte-carlo (the equations integrated directly) or circuit (ngspice).
    step : str or float
        default, fine, finest, or the longest step in seconds.
    **running
        See `harvester.open_runner`.

    Raises
    ------
    HarvesterError, SimulationError

    Notes
    -----
    Starts have the given displacement and velocity at the beginning of a period, an uncharged
    transducer, and the initial values of a load's stores in its netlist.

    Examples
    --------
    ::

        harvester basins device --set 'excitation={kind="sine", amplitude=6.0, frequency=8.0}'
            --points 60 --output basins
    """
    import numpy as np

    from harvester.engines.following import forced
    from harvester.engines.opening import open_runner
    from harvester.studies.orbits import basins as work
    from harvester.studies.orbits.following import SAMPLES, check_periods, orbits_of, periods_of

    clock = time.perf_counter()
    engine = engine_of(method, step=step)
    engine.check(scene)
    check_periods(periods, 2)
    driven = forced(scene, "basins")
    x, v = work.axes_of_starts(driven, displacement, velocity, points)
    scales = driven.scales
    starts = np.zeros((v.size, x.size, 3))
    starts[:, :, 0], starts[:, :, 1] = x / scales.displacement, v[:, None] / scales.of("velocity")
    with open_runner(**running) as runner:
        version = runner.version(engine.name)
        plan = orbits_of(driven, engine, version, starts.reshape(-1, 3), periods)
        ((orbits, which),) = runner.follow([plan])
    return work.Basins(
        scene=scene,
        method=engine.name,
        engine_version=version or "compiled equations",
        displacements=x,
        velocities=v,
        orbit=which.reshape(v.size, x.size),
        orbits=orbits,
        periods=periods or max(periods_of(driven), SAMPLES + 1),
        seconds=time.perf_counter() - clock,
    )


@takes_scene
def bifurcation(
    scene: Scene,
    *,
    over: OneKey,
    values: Grid | None = None,
    down: Annotated[bool, Kind(option="up-only")] = True,
    periods: Count | None = None,
    method: MethodOrName = "monte-carlo",
    step: Step = "default",
    **running: Unpack[RunnerOptions],
) -> Bifurcation:
    """Stroboscopic sections and power of a driven device over any key, up and down.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one; its excitation is a sine or a sum of sines.
    over : dict of str to sequence of float, or str
        The key, such as excitation.amplitude, with its values; or the key alone, with `values`.
    values : sequence of float or None
        Values of the key, such as numpy.linspace(1, 12, 100).
    down : bool
        The downward sweep is also simulated, and shows coexisting motions; `--up-only` omits it.
    periods : int or None
        Number of periods of the excitation at each value before the samples (default: as many as
        the transient needs, and nine times as many if the motion is then aperiodic).
    method : str or Method
        monte-carlo (the equations integrated directly) or circuit (ngspice).
    step : str or float
        default, fine, finest, or the longest step in seconds.
    **running
        See `harvester.open_runner`.

    Raises
    ------
    HarvesterError
        A mistake in the call. A failed simulation is listed in `failures`.

    Notes
    -----
    Each value starts from the final state of the previous one, the first from the scene's start.

    Examples
    --------
    ::

        harvester bifurcation device --set 'excitation={kind="sine", amplitude=6.0,
            frequency=8.0}' --over excitation.amplitude=1:12:linear:100
    """
    import numpy as np

    from harvester.engines.opening import open_runner
    from harvester.studies.answers import successful
    from harvester.studies.orbits import bifurcation as work
    from harvester.studies.orbits.following import check_periods, periods_of

    clock = time.perf_counter()
    engine = engine_of(method, step=step)
    engine.check(scene)
    check_periods(periods, 1)
    key, values = key_and_values(over, values)
    rising = np.unique(values)
    if rising.size < 2:
        raise HarvesterError("--values: must be at least two different numbers")
    scenes = work.scenes_over(scene, key, rising)
    settling = periods or max(periods_of(scene_at_value) for scene_at_value in scenes)
    directions = ("up", "down") if down else ("up",)
    with open_runner(**running) as runner:
        version = runner.version(engine.name)
        plan = work.climbing(scene, key, rising, engine, version, periods, directions)
        ((branches, failures),) = successful(runner.follow([plan]))
    return work.Bifurcation(
        scene=scene,
        key=key,
        values=rising,
        branches=branches,
        jumps=[jump for branch in branches for jump in work.jumps_of(rising, branch)],
        method=engine.name,
        engine_version=version or "compiled equations",
        periods=settling,
        failures=failures,
        seconds=time.perf_counter() - clock,
    )


@takes_scene
def residence(
    scene: Scene,
    *,
    over: OneKey | None = None,
    values: Grid | None = None,
    precision: Share | None = None,
    method: MethodOrName = "monte-carlo",
    step: Step = "default",
    **running: Unpack[RunnerOptions],
) -> Residence:
    """Mean residence time of a device in its wells under noise, compared with Kramers' formula.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, its file or the name of a built-in one; with several wells and noise.
    over : dict of str to sequence of float, str or None
        A key, such as excitation.intensity, with its values; or the key alone, with `values`.
    values : sequence of float or None
        Values of that key, such as numpy.geomspace(0.02, 0.06, 5).
    precision : float or None
        Target relative standard error, for which realizations are doubled up to 64 times the
        scene's number (default: use the scene's number).
    method : str or Method
        monte-carlo (the equations integrated directly) or circuit (ngspice).
    step : str or float
        default, fine, finest, or the longest step in seconds.
    **running
        See `harvester.open_runner`.

    Raises
    ------
    HarvesterError
        A mistake in the call. A failed simulation is the outcome of its point.

    Examples
    --------
    ::

        harvester residence duffing --over excitation.intensity=0.02:0.06:log:5
            --precision 0.05
    """
    from harvester.engines.opening import open_runner
    from harvester.scene.prepared import prepared
    from harvester.studies.orbits import residence as work

    clock = time.perf_counter()
    engine = engine_of(method, step=step)
    engine.check(scene)
    key: str | None = None
    points: list[Any] = [None]
    if over is not None or values is not None:
        key, values = key_and_values(over or "", values)
        points = [*values]
    scenes = [prepared(scene if key is None else scene.replace({key: number})) for number in points]
    for prepared_scene in scenes:
        work.require_wells(prepared_scene)
    with open_runner(**running) as runner:
        version = runner.version(engine.name)
        outcomes: list[Any] = runner.follow(
            [
                work.staying(prepared_scene, value, engine, version, precision)
                for prepared_scene, value in zip(scenes, points, strict=True)
            ]
        )
    return work.Residence(
        scene=scene,
        key=key,
        stays=[stay for stays, _ in outcomes for stay in stays],
        method=engine.name,
        engine_version=next((text for _, text in outcomes if text), ""),
        seconds=time.perf_counter() - clock,
        precision=precision,
    )
