"""Distributes the realizations of one scene over processes, and follows their progress."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from harvester.base.arguments import listed
from harvester.base.errors import HarvesterError, LoadError, SimulationError
from harvester.base.plain_text import named, shown
from harvester.base.worker_pool import Workers, processes
from harvester.device import timescales
from harvester.engines import side_by_side
from harvester.engines.methods import Circuit, Engine, MonteCarlo
from harvester.engines.realization import Realization, WaveformWindow, run
from harvester.scene.paths import distinct_realizations
from harvester.scene.steps import knot_spacing, steps_per_sample, stop_time

if TYPE_CHECKING:
    from circuits.netlist.measurement import Probe
    from harvester.scene.prepared import Prepared

# If no window is asked for: periods of small oscillations in the waveform, and its largest number
# of points. With a fast switching load the number of points may be the limit.
SHOWN_PERIODS, MOST_POINTS = 50, 100_000
# Number of Monte Carlo steps that take as long as the start of a process, 0.5 s.
STEPS_OF_A_PROCESS = 1e7


@contextlib.contextmanager
def running(
    runner: Workers | None, executor: Executor | None, calls: int, workers: int | None
) -> Iterator[Workers]:
    """The processes of the given runner, else workers that end with the `with` block."""
    if executor is None and runner is not None:
        yield getattr(runner, "pool", runner)
    else:
        with processes(executor, workers, calls) as pool:
            yield pool


def useful_processes(prepared_scene: Prepared, engine: Engine) -> int:
    """Maximum number of processes that shorten a run; 1 for a short one by Monte Carlo."""
    count = prepared_scene.scene.run.realizations
    if not engine.in_lockstep(prepared_scene.scene):
        return count
    step = knot_spacing(prepared_scene) / steps_per_sample(prepared_scene, engine.step, engine.name)
    return math.ceil(min(count, count * stop_time(prepared_scene) / step / STEPS_OF_A_PROCESS))


def optimal_batch_size(prepared_scene: Prepared, engine: Engine, pool: Workers) -> int:
    """Realizations per call of an engine: its option `copies`, else the fastest number."""
    count = distinct_realizations(prepared_scene)
    if isinstance(engine, MonteCarlo):
        workers = getattr(pool, "size", math.inf)
        return side_by_side.together(count, workers) if prepared_scene.scene.load.is_resistor else 1
    if not isinstance(engine, Circuit):
        return 1
    if engine.copies:
        return engine.copies
    shared = engine.step, engine.source, engine.tolerance
    if count == 1 or not side_by_side.share_steps(prepared_scene, *shared):
        return 1
    (device,) = pool.map(
        _device_used, [{"prepared_scene": prepared_scene, "device": engine.device}]
    )
    return side_by_side.copies(count, device)


def _device_used(prepared_scene, device, report):
    """See `circuits.ngspice.engine.device_used`; called in a worker, as it needs PySpice."""
    from circuits.ngspice.engine import device_used

    return device_used(prepared_scene, device, report)


def stretch_of(
    prepared_scene: Prepared, window: Sequence[float] | str | None, nodes: Sequence[str]
) -> WaveformWindow:
    """The part of the first realization that is kept as the result's waveform.

    Raises HarvesterError for a window without a length or a node that the load does not have.
    """
    scene = prepared_scene.scene
    nodes = listed(nodes, "nodes", 'nodes=["vc", "v(a,b)", "i(l1)"]')
    if nodes and scene.load.is_resistor:
        raise LoadError(
            f"{scene.name}: --node {named(nodes[0])}: the load is a resistor alone; omit --node"
        )
    probes: tuple[Probe, ...] = ()
    if nodes:
        from circuits.netlist.measurement import probes_of

        probes = probes_of(scene.load.circuit, nodes)
    end = stop_time(prepared_scene)
    if window == "all":
        window = (0.0, math.inf)
    if window is not None:
        try:
            start, stop = map(float, listed(window, "window", "(5.0, 6.0)"))
        except (TypeError, ValueError):
            raise HarvesterError(f"window = {shown(window)}: must be two times in s") from None
        if not 0.0 <= start < stop:
            raise HarvesterError(f"--window {start:g}:{stop:g}: must be 0 ≤ START < END, in s")
        if start >= end:
            raise HarvesterError(
                f"--window {start:g}:{stop:g}: the run ends at {end:g} s; choose an earlier window"
            )
        return WaveformWindow(start, stop, probes=probes)
    start, stop = scene.run.settle, end
    rate = timescales.angular_frequency(prepared_scene.system)
    if rate > 0.0:
        stop = min(stop, start + SHOWN_PERIODS * 2.0 * math.pi / rate)
    return WaveformWindow(start, stop, MOST_POINTS, probes)


def outcomes(
    prepared_scene: Prepared,
    engine: Engine,
    pool: Workers,
    time_limit: float,
    follow: Callable | None,
    keep_going: bool,
    stretch: WaveformWindow,
    **recorded: bool,
) -> list[Realization | SimulationError]:
    """A Realization or its SimulationError, for every realization in order.

    Realizations that failed together are tried again one by one. `recorded` are `joint_density` and
    `stroboscope` of `simulate`. Raises SimulationError if one failed and `keep_going` is false, or
    if all failed.
    """
    count = distinct_realizations(prepared_scene)
    most = min(optimal_batch_size(prepared_scene, engine, pool), count)
    options = {"prepared_scene": prepared_scene, "engine": engine, "window": None, **recorded}

    def call(*indices):
        return {**options, "indices": [*indices], "stretch": None if indices[0] else stretch}

    calls = [call(*range(first, min(first + most, count))) for first in range(0, count, most)]
    by_number: dict[int, Realization | SimulationError] = {}
    together = pool.map(run, calls, most * time_limit, follow, keep_going)
    for batch, outcome in zip(calls, together, strict=True):
        if isinstance(outcome, SimulationError):
            outcome = [outcome] * len(batch["indices"])
        by_number.update(zip(batch["indices"], outcome, strict=True))
    if most > 1:
        again = [k for k, outcome in by_number.items() if isinstance(outcome, SimulationError)]
        alone = pool.map(run, [*map(call, again)], time_limit, None, keep_going)
        for index, outcome in zip(again, alone, strict=True):
            by_number[index] = outcome if isinstance(outcome, SimulationError) else outcome[0]
    in_order = [by_number[index] for index in sorted(by_number)]
    failed = [outcome for outcome in in_order if isinstance(outcome, SimulationError)]
    if len(failed) == len(in_order):
        raise failed[0]
    return in_order


class Follower:
    """Computes the progress of all realizations from their reports."""

    def __init__(
        self, prepared_scene: Prepared, method: str, progress: Callable[[float, str], object]
    ):
        self._method = method
        run = prepared_scene.scene.run
        self._total = (run.settle + run.duration) * distinct_realizations(prepared_scene)
        self._reached: dict[int, float] = {}
        self._progress = progress

    def __call__(self, index: int, moments: list) -> None:
        """Update the progress from one call's latest moments."""
        self._reached[index] = sum(realization.time_reached for realization in moments)
        share = sum(self._reached.values()) / self._total
        self._progress(min(max(share, 0.0), 1.0), self._method)
