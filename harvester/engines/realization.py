"""Realizations by a named engine, inside a worker process."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from harvester.base.errors import LoadError, SimulationError
from harvester.device import timescales
from harvester.device.record import Record
from harvester.engines.methods import Engine, MonteCarlo
from harvester.engines.retries import run_converged
from harvester.excitation.sum import common_period
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing, step_error, steps_per_sample, stop_time
from harvester.statistics.batch_means import (
    KNOTS_PER_HISTOGRAM_SAMPLE,
    batch_counts,
    student_factor,
)
from harvester.statistics.joint import JointHistogram
from harvester.statistics.joint import prepare as prepare_joint
from harvester.statistics.jumps import Jumps
from harvester.statistics.moments import QUANTITIES, Moments
from harvester.statistics.moments import prepare as prepare_moments
from harvester.statistics.output_moments import QUANTITIES as OUTPUT_QUANTITIES
from harvester.statistics.output_moments import OutputMoments
from harvester.statistics.range_watch import with_range_watch
from harvester.statistics.run_estimates import run_estimates
from harvester.statistics.strain_moments import StrainMoments, StrainWatch
from harvester.statistics.strain_moments import prepare as prepare_strain
from harvester.statistics.stroboscope import Stroboscope, strobe_times

if TYPE_CHECKING:
    from circuits.netlist.measurement import Probe

REPORT_SECONDS = 0.25
# A transient is resolved if halving its steps changes the energies, in each of PARTS parts of the
# run, by less than the share RESOLVED.
PARTS, RESOLVED = 16, 0.01
# The path of a nonlinear device under one record may be chaotic. An ensemble of runs shows this;
# their excitations differ by these shares of the step error. With a resistor the runs use vector
# lanes that one realization leaves idle. With a netlist every perturbation costs a run: they are
# fewer, and absent for records longer than MOST_PERIODS, whose batches already show the scatter.
PERTURBATIONS = (1.0, -1.0, 0.5, -0.7, 0.7, -0.4, 0.2)
NETLIST_PERTURBATIONS, MOST_PERIODS = 3, 1000.0
UNKNOWN_SPREAD = (
    "whether the path is chaotic is not known, as a run with a slightly different excitation "
    "failed: compare with step = fine"
)


@dataclass
class Realization:
    """One realization's results, as a worker process returns them.

    Attributes
    ----------
    waveform
        Waveform within the requested window.
    electrical
        Series in addition to the waveform: `output_voltage` (scaled) of a load with an output, and
        the requested nodes and currents (V and A).
    joint
        Joint histogram, if it was requested.
    seconds
        Processor time of one core (s) for the simulation alone, divided equally among realizations
        that run together.
    started, ended
        System time at start and end (s).
    stroboscope
        Samples at the beginnings of the excitation's periods, in the form of
        `harvester.statistics.stroboscope.Stroboscope`; if requested.
    """

    moments: Moments
    waveform: Record | None = None
    joint: JointHistogram | None = None
    seconds: float = math.nan
    started: float = math.nan
    ended: float = math.nan
    engine_version: str = ""
    netlist_sha256: str | None = None
    electrical: dict[str, np.ndarray] = field(default_factory=dict)
    stroboscope: np.ndarray | None = None


class WaveformWindow(NamedTuple):
    """The part of the first realization that is kept as a waveform.

    From `start` to `stop` (s from the run's beginning), at most `most` points; `probes` are
    voltages and currents of the load's netlist.
    """

    start: float
    stop: float
    most: float = math.inf
    probes: tuple[Probe, ...] = ()


class WaveformObserver:
    """Keeps the points of a record between two times, with a load's output."""

    def __init__(self, start: float, stop: float, most: float = math.inf) -> None:
        self.start, self.stop = start, stop
        self._left = most
        self._inside = np.empty(0, dtype=int)
        self._parts: list[np.ndarray] = []
        self._outputs: list[np.ndarray] = []

    def add(self, record: Record) -> None:
        """Keep the points within the window."""
        if record.time.size == 0 or record.time[0] > self.stop or record.time[-1] < self.start:
            self._inside = np.empty(0, dtype=int)
            return
        places = np.flatnonzero((record.time >= self.start) & (record.time <= self.stop))
        self._inside = places[: int(min(self._left, places.size))]
        self._left -= self._inside.size
        if self._inside.size:
            self._parts.append(np.array([column[self._inside] for column in record]))

    def add_output(self, *values: np.ndarray) -> None:
        """The output's voltage and other values, each of shape (n,), at the points added last."""
        if self._inside.size:
            self._outputs.append(np.array([series[self._inside] for series in values]))

    def record(self) -> Record:
        """The kept points as one record."""
        if not self._parts:
            return Record(*np.empty((len(Record._fields), 0)))
        return Record(*np.concatenate(self._parts, axis=1))

    def outputs(self) -> np.ndarray:
        """The output's voltage and other values at the kept points; no rows without an output."""
        return np.concatenate(self._outputs, axis=1) if self._outputs else np.empty((0, 0))


class _WatchedOutput:
    """Passes a load's output to its moments and to a waveform."""

    def __init__(self, moments: OutputMoments, waveform: WaveformObserver) -> None:
        self._moments, self._waveform = moments, waveform
        self.conductance = math.nan

    def add(
        self,
        time: np.ndarray,
        voltage: np.ndarray,
        values: np.ndarray,
        levels: Sequence[np.ndarray | None],
        energy: np.ndarray,
    ) -> None:
        """Add points: the load's measured values, its levels, then its probes."""
        recorded = len(self._moments.rows) - len(values)
        self._moments.add(time, voltage, values, levels[:recorded], energy)
        probes = [np.zeros_like(time) if level is None else level for level in levels[recorded:]]
        self._waveform.add_output(voltage, *probes)


class Reporter:
    """Reports the present moments of all realizations several times a second."""

    # This observer does not read the points of a record.
    reads_points = False

    def __init__(self, moments: list[Moments], report: Callable) -> None:
        self._moments, self._report = moments, report
        self._next = time.monotonic() + REPORT_SECONDS

    def add(self, record: Record) -> None:
        """Report the moments if the last report is old enough."""
        now = time.monotonic()
        if now >= self._next:
            self._report(self._moments)
            self._next = now + REPORT_SECONDS


def run(
    prepared_scene: Prepared,
    engine: Engine,
    indices: Sequence[int],
    window: tuple[float, float] | None,
    report: Callable,
    joint_density: bool = False,
    stretch: WaveformWindow | None = None,
    stroboscope: bool = False,
) -> list[Realization]:
    """Simulate realizations of a scene; the circuit engine runs them in one netlist.

    Parameters
    ----------
    indices : sequence of int
        Numbers of the realizations: a number determines the seed and the starting well.
    window : (float, float) or None
        Part of each realization's waveform to keep (s).
    report : callable
        Called with the list of moments so far.
    joint_density, stroboscope : bool
        See `harvester.simulate`.
    """
    scene = prepared_scene.scene
    perturbations = _perturbations(prepared_scene, engine)
    together = engine.in_lockstep(scene)
    idle = perturbations if together else ()
    others = (indices, window, report, joint_density, stretch, stroboscope, idle)
    if engine.chooses_steps or not scene.excitation.transient(scene.run):
        realizations = _converged(prepared_scene, engine, others)
    else:
        realizations = _refined(prepared_scene, engine, others)
    if perturbations and not together:
        _run_ensemble(prepared_scene, engine, indices, realizations, perturbations)
    return realizations


def _converged(prepared_scene, engine, others):
    """Realizations with the first engine options that converge."""
    return run_converged(prepared_scene, engine, lambda aided: _run(prepared_scene, aided, *others))


def _perturbations(prepared_scene, engine):
    """Relative changes of the excitation in an ensemble that shows whether a path is chaotic."""
    scene, system = prepared_scene.scene, prepared_scene.system
    excitation = scene.excitation
    one_path = excitation.drifts and not excitation.random and scene.run.starts is None
    linear = system.spring.straight and not system.contacts
    if not one_path or linear or excitation.prescribes_displacement:
        return ()
    cost, count = step_error(prepared_scene, engine.step, engine.name), len(PERTURBATIONS)
    if not scene.load.is_resistor:
        periods = stop_time(prepared_scene) * timescales.angular_frequency(system) / math.tau
        count = NETLIST_PERTURBATIONS if periods < MOST_PERIODS else 0
    return tuple(cost * share for share in PERTURBATIONS[:count])


def _ensemble(prepared_scene, indices, perturbations):
    """Paths, starts and empty moments of the perturbed runs of each realization."""
    pairs = [(index, share) for index in indices for share in perturbations]
    paths = [noise_path(prepared_scene, index, 1.0 + share) for index, share in pairs]
    starts = [start_state(prepared_scene, index) for index, _ in pairs]
    return paths, starts, [empty_moments(prepared_scene) for _ in pairs]


def _run_ensemble(prepared_scene, engine, indices, realizations, perturbations):
    """Set the spread of realizations from perturbed runs, by Monte Carlo if it takes the load."""
    load = prepared_scene.scene.load.circuit
    other: Engine = MonteCarlo()
    try:
        other.check(prepared_scene.scene)
    except LoadError:
        other = engine
    paths, starts, moments = _ensemble(prepared_scene, indices, perturbations)
    outputs = None
    if load and load.has_output:
        outputs = [OutputMoments.beside(neighbour, load.recorded) for neighbour in moments]
        for neighbour, output in zip(moments, outputs, strict=True):
            neighbour.output = output
    other.prepare(prepared_scene)
    try:
        observers = [[neighbour] for neighbour in moments]
        other.run_realizations(prepared_scene, paths, starts, observers, outputs)
    except SimulationError:
        for realization in realizations:
            notes = (realization.moments.note, UNKNOWN_SPREAD)
            realization.moments.note = "; ".join(filter(None, notes))
        return
    _set_spread([realization.moments for realization in realizations], moments)


def _set_spread(moments, ensemble):
    """Set the spread of each realization and its perturbed runs."""
    size = len(ensemble) // len(moments)
    for k, m in enumerate(moments):
        m.spread = _spread([m, *ensemble[k * size : (k + 1) * size]])


def _spread(ensemble):
    """Relative standard error of the mean energies of an ensemble's first run.

    The first run and the true path are both draws from the ensemble, hence √2.
    """
    rows = slice(1, QUANTITIES.index("loss_power") + 1)
    sums = np.array([neighbour.integrals[:, rows].sum(axis=0) for neighbour in ensemble])
    if ensemble[0].has_output:
        squares = [
            neighbour.output.integrals[:, OUTPUT_QUANTITIES.index("square_voltage")].sum()
            for neighbour in ensemble
        ]
        sums = np.column_stack([sums, squares])
    energies, deviation = np.abs(sums[0]), np.std(sums, axis=0, ddof=1)
    factor = math.sqrt(2.0) * student_factor(len(ensemble) - 1)
    return factor * float(np.max(deviation[energies > 0.0] / energies[energies > 0.0], initial=0.0))


def _refined(prepared_scene, engine, others):
    """Realizations of a transient, with the change of their energies when the steps are halved.

    The phase of the motion at an event depends on all earlier steps. Default steps are halved, up
    to twice, until the energies change by less than `RESOLVED`.
    """
    spacing = knot_spacing(prepared_scene)
    count = steps_per_sample(prepared_scene, engine.step, engine.name)
    halvings = 2 if engine.step == "default" else int(count == 1)
    started, clock = time.time(), time.process_time()
    refined: list[Realization] = []
    for steps in sorted({max(count // 2, 1), *(count * 2**k for k in range(halvings + 1))}):
        before, step = refined, spacing / steps
        try:
            refined = _converged(prepared_scene, replace(engine, step=step), others)
        except SimulationError:
            # A failure with steps longer than requested is ignored.
            if steps >= count:
                raise
            continue
        moments = [realization.moments for realization in refined]
        for now, earlier in zip_longest(moments, before):
            now.step, now.step_error = step, _change(now, earlier.moments) if earlier else 1.0
        if max(m.step_error for m in moments) < RESOLVED:
            break
    seconds = (time.process_time() - clock) / len(refined)
    return [replace(realization, started=started, seconds=seconds) for realization in refined]


def _change(moments, earlier):
    """Largest relative change of the energies and squares in the parts of a run."""
    rows = slice(1, QUANTITIES.index("loss_power") + 1)
    change = moments.integrals[:, rows] - earlier.integrals[:, rows]
    total = np.abs(moments.integrals[:, rows].sum(axis=0))
    changes = sum(np.abs(part.sum(axis=0)) for part in np.array_split(change, PARTS))
    return float(np.max(changes[total > 0.0] / total[total > 0.0], initial=0.0))


def _run(
    prepared_scene,
    engine,
    indices,
    window,
    report,
    joint_density,
    stretch,
    stroboscope,
    perturbations=(),
):
    """Simulate realizations once; see `run`. With perturbations also set their spread."""
    scene = prepared_scene.scene
    paths = [noise_path(prepared_scene, index) for index in indices]
    moments = [empty_moments(prepared_scene) for _ in indices]
    # Only a netlist has an output side and energy stores.
    outputs: list[Any] | None = None
    load = scene.load.circuit
    probes = stretch.probes if stretch else ()
    if load and (load.has_output or load.recorded or probes):
        outputs = [OutputMoments.beside(m, load.recorded, load.has_output) for m in moments]
        for m, its_output in zip(moments, outputs, strict=True):
            m.output = its_output
    observers: list[list] = [[m] for m in moments]
    observers[-1].append(Reporter(moments, report))
    waveforms = [WaveformObserver(*window) if window else None for _ in indices]
    if stretch:
        waveforms[0] = first = WaveformObserver(stretch.start, stretch.stop, stretch.most)
        if outputs:
            outputs[0] = _WatchedOutput(outputs[0], first)
    sampled = (scene.run.settle, knot_spacing(prepared_scene))
    joints = [JointHistogram.empty(*sampled) if joint_density else None for _ in indices]
    times = (*strobe_times(prepared_scene), engine.in_lockstep(scene))
    strobes = [Stroboscope(*times) if stroboscope else None for _ in indices]
    for watching, *others in zip(observers, waveforms, joints, strobes, strict=True):
        watching[:0] = [observer for observer in others if observer is not None]
    strained = [StrainWatch(m, scene.beam.fatigue_line) for m in moments] if scene.beam else []
    for watching, watch in zip(observers, strained, strict=False):
        watching[:0] = [watch]
    engine.prepare(prepared_scene)
    prepare_moments()
    if strained:
        prepare_strain()
    if joint_density:
        prepare_joint()
    started = time.time()
    clock, processor = time.perf_counter(), time.process_time()
    starts = [start_state(prepared_scene, index) for index in indices]
    observers = with_range_watch(prepared_scene, observers)
    more_paths, more_starts, ensemble = _ensemble(prepared_scene, indices, perturbations)
    observers += [[neighbour] for neighbour in ensemble]
    outcome = engine.run_realizations(
        _probed(prepared_scene, probes),
        paths + more_paths,
        starts + more_starts,
        observers,
        outputs,
    )
    if ensemble:
        _set_spread(moments, ensemble)
    for m, seen in zip(moments, outputs or (), strict=False):
        if m.output:
            m.output.conductance = seen.conductance
    for watch in strained:
        watch.close()
    elapsed, seconds = time.perf_counter() - clock, time.process_time() - processor
    # Realizations that finish before their first progress report still report once.
    report(moments)
    return [
        Realization(
            moments=realization,
            waveform=waveform.record() if waveform else None,
            joint=joint,
            electrical=_electrical(waveform, scene, probes),
            seconds=seconds / len(moments),
            started=started,
            ended=started + elapsed,
            stroboscope=strobe.samples if strobe else None,
            **outcome,
        )
        for realization, waveform, joint, strobe in zip(
            moments, waveforms, joints, strobes, strict=True
        )
    ]


def _probed(prepared_scene, probes):
    """The prepared scene with a load that also outputs the nodes of these probes."""
    if not probes:
        return prepared_scene
    load = prepared_scene.scene.load
    load = replace(load, circuit=replace(load.circuit, probes=tuple(_watched(probes))))
    return replace(prepared_scene, scene=replace(prepared_scene.scene, load=load))


def _watched(probes):
    return dict.fromkeys(name for probe in probes for name in probe[1:] if name)


def _electrical(waveform, scene, probes):
    """See `Realization.electrical`."""
    rows = waveform.outputs() if waveform else np.empty((0, 0))
    if not rows.size:
        return {}
    electrical = {"output_voltage": rows[0]} if scene.load.circuit.has_output else {}
    values = dict(zip(_watched(probes), rows[1:], strict=True))
    return electrical | {probe.column: probe.value(values) for probe in probes}


def empty_moments(prepared_scene: Prepared) -> Moments:
    """Empty moments with the batches of the scene's run."""
    scene, parameters = prepared_scene.scene, prepared_scene.system
    spacing = knot_spacing(prepared_scene)
    start, batches, groups = _measured(prepared_scene, spacing)
    saddles = timescales.saddles(parameters)
    even = len(saddles) == 1 and parameters.symmetric and scene.excitation.symmetric
    moments = Moments.empty(
        start, stop_time(prepared_scene), timescales.free_zone(parameters), saddles,
        bool(saddles) and not even, batches, groups, KNOTS_PER_HISTOGRAM_SAMPLE * spacing,
    )  # fmt: skip
    if saddles:
        moments.jumps = Jumps.empty(parameters, moments.start, moments.batch_length, batches)
    moments.strain = StrainMoments.of(prepared_scene, batches)
    return moments


def quantity_names(prepared_scene: Prepared) -> tuple[str, ...]:
    """Names of the quantities that an engine may give for a scene, without a run.

    The names come from estimates of moments that are filled with ones.
    """
    load = prepared_scene.scene.load.circuit
    moments = empty_moments(prepared_scene)
    if load:
        moments.output = OutputMoments.beside(moments, load.recorded, load.has_output)
        moments.output.stored[:] = 1.0
    moments.integrals[:], moments.products[:] = moments.batch_length, 1.0
    moments.first[:], moments.last[:] = 0.0, 1.0
    moments.last[0] = stop_time(prepared_scene)
    with np.errstate(all="ignore"):
        estimates = run_estimates(prepared_scene, [moments]).whole
    # In these moments the device may store too little energy for an estimate of its storage power.
    return tuple(estimates | {"mean_device_storage_power": None})


def _period(scene):
    """Period (s) for means over whole periods; shared by the load if a run holds two such periods.

    Example: with a source of 20 Hz and a sine of 12.5 Hz the mean over 0.96 s is 1 % lower than
    over 0.8 s.
    """
    period = scene.excitation.period
    if period is None or not scene.load.circuit:
        return period
    common = common_period([period, *scene.load.circuit.periods])
    return common if common and 2.0 * common <= scene.run.duration * (1.0 + 1e-9) else period


def _measured(prepared_scene, spacing):
    """Start of the measured time (s), number of batches, and number of groups of batches.

    Under a periodic excitation each batch lasts a whole number of periods, and the last one ends
    with the run.
    """
    run, period = prepared_scene.scene.run, _period(prepared_scene.scene)
    one_path = period is None and not prepared_scene.scene.excitation.random
    batches, groups = batch_counts(run.realizations, run.duration / spacing, one_path)
    if period is None or period > run.duration:
        return run.settle, batches, groups
    periods = math.floor(run.duration / period + 1e-9)
    batches = min(batches, periods)
    start = stop_time(prepared_scene) - periods // batches * batches * period
    # The first point of the first period counts even if its time is rounded down.
    return max(start, run.settle) - 1e-9 * spacing, batches, min(groups, batches)
