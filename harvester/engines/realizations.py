"""Divides the simulation of a scene into tasks of a few realizations each."""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from harvester.averaging.method import Stationary
from harvester.base.errors import HarvesterError
from harvester.device import timescales
from harvester.device.record import Record
from harvester.engines import side_by_side
from harvester.engines.methods import Circuit, Engine, engine_of
from harvester.engines.orbits import SAMPLES, with_orbit
from harvester.engines.realization import empty_moments, run
from harvester.engines.task import Task
from harvester.scene.model import Scene
from harvester.scene.paths import several_starts
from harvester.scene.prepared import Prepared
from harvester.scene.units import Scales
from harvester.statistics.batch_means import FEWEST_TO_DRIFT, TOTAL_BATCHES
from harvester.statistics.estimate import Estimate
from harvester.statistics.moments import QUANTITIES
from harvester.statistics.output_moments import OutputMoments

# Realizations in one task if they run in parallel or fast.
REALIZATIONS_TOGETHER = 8
# Length of a waveform in periods of small oscillations, and its number of evenly spaced points.
PERIODS, WAVEFORM_POINTS = 6.0, 1000
# Attributes of stored moments, and of their jumps between wells, that follow from the scene.
TIMES = ("start", "batch_length", "free", "saddles", "sample_interval")
WELLS = ("start", "batch_length", "saddles", "limits", "ends", "energies")
# From this number on every realization has the minimum number of batches. The tasks' keys then do
# not depend on the number of realizations, so that a longer run continues a shorter one.
MANY_REALIZATIONS = TOTAL_BATCHES // FEWEST_TO_DRIFT


def realizations(
    prepared_scene: Prepared,
    method: str,
    indices: list[int],
    step: str | float,
    density: bool,
    waveform: bool,
    report: Callable,
    settings: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Simulate a few realizations, in a worker process.

    Parameters
    ----------
    method, step, settings
        The engine's name, its step, and the options that differ from their defaults.

    Returns
    -------
    dict
        `moments`, a list with one entry per realization, without histograms unless `density`;
        `waveform` of the first, shape (len(Record._fields), WAVEFORM_POINTS), scaled, or None;
        `stroboscope`, the first and last samples of each realization if starts may reach several
        motions, else None; `seconds` of one core.
    """
    clock = time.process_time()
    timing = prepared_scene.scene.run
    shown = min(periods_of(prepared_scene), timing.duration)
    window = (timing.settle, timing.settle + shown) if waveform else None
    solutions = run(
        prepared_scene,
        engine_of(method, step=step, **settings or {}),
        indices,
        window,
        report,
        stroboscope=several_starts(prepared_scene),
    )
    moments = [solution.moments for solution in solutions]
    samples = [solution.stroboscope for solution in solutions if solution.stroboscope is not None]
    if not density:
        # Histograms are by far the largest part of an answer.
        moments = [dataclasses.replace(m, histograms=np.zeros((1, 0, 0))) for m in moments]
    points, columns = None, solutions[0].waveform
    if columns is not None:
        times = np.linspace(columns.time[0], columns.time[-1], WAVEFORM_POINTS)
        points = np.array([np.interp(times, columns.time, column) for column in columns])
    return {
        "moments": moments,
        "waveform": points,
        "stroboscope": _ends_of(np.array(samples)) if samples else None,
        "seconds": time.process_time() - clock,
    }


def _ends_of(samples):
    """The first and the last `SAMPLES` samples, or all if these are no more."""
    return np.concatenate([samples[:, :SAMPLES], samples[:, SAMPLES:][:, -SAMPLES:]], axis=1)


def averages(
    prepared_scene: Prepared,
    closure: str,
    tolerance: float | None,
    density: bool,
    report: Callable,
    jump_rates: bool = False,
) -> dict[str, Any]:
    """Stationary means of a scene by a stationary method, in a worker process.

    Returns `quantities`, scaled; `density` of the displacement, or None; `seconds` of one core.
    """
    # Imported here, not at the head: a process that only simulates starts in half the time.
    from harvester.averaging.of_scene import average, averages_of, estimates_of

    clock = time.process_time()
    if density:
        method = Stationary(closure, tolerance, jump_rates=jump_rates)
        result = average(prepared_scene.scene, method=method)
        quantities, shape = result.scaled_quantities, result.densities.get("displacement")
    else:
        # Tabulating the density takes as long as all means.
        means = averages_of(prepared_scene, closure, tolerance, jump_rates)
        quantities, shape = estimates_of(means), None
    seconds = time.process_time() - clock
    return {"quantities": quantities, "density": shape, "seconds": seconds}


@dataclass(frozen=True)
class Realizations:
    """All realizations of a scene by one engine, to be divided into tasks.

    Attributes
    ----------
    prepared_scene
        Its number of realizations only sets the number of batches per realization.
    size
        Realizations per task.
    version
        Version of the computing program, see `Runner.version`.
    density, waveform
        Whether histograms, and the beginning of the first realization, are kept.
    """

    prepared_scene: Prepared
    method: Engine
    size: int
    version: str = ""
    density: bool = False
    waveform: bool = False

    @classmethod
    def of(
        cls,
        prepared_scene: Prepared,
        method: Engine,
        version: str = "",
        density: bool = False,
        waveform: bool = False,
    ) -> "Realizations":
        """The realizations of a scene, several per task if that is faster."""
        scene = with_orbit(prepared_scene.scene)
        size = min(_together(prepared_scene, method), scene.run.realizations)
        batches = min(scene.run.realizations, MANY_REALIZATIONS)
        many = prepared_scene.with_run(realizations=batches, orbit=scene.run.orbit)
        return cls(many, method, size, version, density, waveform)

    def tasks(self, start: int, stop: int, most: float = math.inf) -> list[Task]:
        """The tasks of the realizations from `start` to before `stop`, all numbered below `most`.

        `start` is a multiple of `size`; the last task may extend beyond `stop`, not beyond `most`.
        """
        return [self._task(first, most) for first in range(start, stop, self.size)]

    def whole(self, count: int) -> int:
        """Smallest number of realizations, in whole tasks, that is at least `count`."""
        return -(-count // self.size) * self.size

    def misfit(self, found: dict, indices: Sequence[int], waveform: bool) -> str:
        """Reason why a stored answer does not fit these realizations; "" if it does."""
        moments = found["moments"]
        if len(moments) != len(indices):
            return "has another number of realizations"
        shape = (len(Record._fields), WAVEFORM_POINTS)
        if waveform and found["waveform"].shape != shape:
            return "its waveform has another shape"
        if waveform and not np.isfinite(found["waveform"]).all():
            return "its waveform is missing"
        if several_starts(self.prepared_scene) and len(found["stroboscope"]) != len(indices):
            return "its stroboscopic samples are of another number of realizations"
        scene = self.prepared_scene.scene
        load = scene.load.circuit
        rows = load.recorded if load and (load.has_output or load.recorded) else None
        fit = all(_fits(m, self._template, rows, scene.beam, self.density) for m in moments)
        return "" if fit else "its values do not fit this scene"

    def _task(self, start, most):
        indices = range(start, int(min(start + self.size, most)))
        waveform = self.waveform and start == 0
        misfit = partial(self.misfit, indices=indices, waveform=waveform)
        arguments = {
            "scene": self.prepared_scene.scene,
            "indices": list(indices),
            "density": self.density,
            "waveform": waveform,
            **self.method.as_arguments("method"),
        }
        return Task(realizations, arguments, self.version, self.method.name, len(indices), misfit)

    @cached_property
    def _template(self):
        return empty_moments(self.prepared_scene)


def averaging(scene: Scene, method: Stationary, density: bool = True) -> Task:
    """The task of a scene by a stationary method.

    Raises HarvesterError for options of `average` alone.
    """
    if method.fit:
        raise HarvesterError(f"{method}: fit is for harvester.average alone; leave it out")
    # A stationary method does not depend on [run]: scenes that differ only there share one task.
    run = dataclasses.replace(scene.run, seed=1, realizations=1)
    arguments = {
        "scene": dataclasses.replace(scene, run=run),
        "closure": method.closure,
        "tolerance": method.tolerance,
        "density": density,
        **({"jump_rates": True} if method.jump_rates else {}),
    }
    return Task(averages, arguments, label=method.closure, misfit=_misfit_of_averages)


def _misfit_of_averages(found):
    quantities = found["quantities"].values()
    if not all(isinstance(estimate, Estimate) for estimate in quantities):
        return "its quantities are missing"
    for estimate in quantities:
        Scales().of(estimate.dimension)
    return ""


def _together(prepared_scene, method):
    """Realizations per task: several only if that is faster."""
    if not isinstance(method, Circuit):
        return REALIZATIONS_TOGETHER
    shared = method.step, method.source, method.tolerance
    return method.copies or (
        REALIZATIONS_TOGETHER if side_by_side.share_steps(prepared_scene, *shared) else 1
    )


def periods_of(prepared_scene: Prepared) -> float:
    """Time of `PERIODS` periods of the small oscillations, in the scene's units."""
    return PERIODS * 2.0 * math.pi / timescales.angular_frequency(prepared_scene.system)


def _fits(moments, template, rows, beam, density):
    """Whether moments have the shapes and times of the scene, and finite sums.

    `rows` are the measured values of a load with an output; None without an output.
    """
    sums = ["integrals", "products", "bin_widths", "first", "last"] + ["histograms"] * density
    if not _is_like(moments, template, TIMES, sums):
        return False
    output, strain = moments.output, moments.strain
    expected = None if rows is None else OutputMoments.beside(moments, rows)
    squares = QUANTITIES.index("square_velocity") + 1
    return bool(
        (moments.integrals[:, :squares] >= 0.0).all()
        and moments.integrals[:, 0].sum() > 0.0
        and _is_like(moments.jumps, template.jumps, WELLS, ("times", "counts"), least=0.0)
        and _is_like(output, expected, ("rows",), ("integrals", "measured", "stored"))
        and _is_like(output, expected, shaped=("first", "latest", "passages"))
        and _is_like(strain, template.strain, ("rows",), ("squares", "peaks"), least=0.0)
        and (strain is None or _damage_fits(strain.damage, len(strain.squares), beam))
    )


def _is_like(stored, template, same=(), sums=(), shaped=(), least=-math.inf):
    """Whether stored values equal the template's; sums need only its shapes and finite values."""
    if stored is None or template is None:
        return stored is template
    values = {n: np.asarray(getattr(stored, n)) for n in (*same, *sums, *shaped)}
    shapes = all(values[n].shape == np.shape(getattr(template, n)) for n in (*sums, *shaped))
    finite = all((np.isfinite(values[n]) & (values[n] >= least)).all() for n in sums)
    return shapes and finite and all(np.array_equal(values[n], getattr(template, n)) for n in same)


def _damage_fits(damage, batches, beam):
    """Whether each batch has a finite damage, or there is none because the beam has no S-N line."""
    if damage is None or beam.fatigue_line is None:
        return damage is beam.fatigue_line
    return np.shape(damage) == (batches,) and (np.isfinite(damage) & (damage >= 0.0)).all()
