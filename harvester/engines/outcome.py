"""The result of a run: estimates, densities and notes from the records of its realizations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from harvester.base.errors import EnergyNotBalanced, SimulationError
from harvester.device import timescales
from harvester.device.system import System
from harvester.engines.methods import Engine
from harvester.engines.orbits import note_on_one_start, note_on_repeats
from harvester.engines.realization import Realization
from harvester.engines.residual_cause import suspected_cause
from harvester.excitation.spectrum import Spectrum
from harvester.results.orbit import UNDETERMINED, Attractor
from harvester.results.result import Result
from harvester.results.waveform import waveform_of
from harvester.scene.model import Scene
from harvester.scene.paths import distinct_realizations
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing, step_error, steps_per_sample
from harvester.statistics.batch_means import measured_time
from harvester.statistics.densities import densities
from harvester.statistics.joint_density import joint_density as joint_density_of
from harvester.statistics.run_estimates import run_estimates
from harvester.statistics.settling import slow_exchange
from harvester.statistics.units import unit_of
from harvester.statistics.well_balance import FEWEST_JUMPS

# An energy balance residual above LARGEST_RESIDUAL is an error, above NOTED_RESIDUAL a note.
LARGEST_RESIDUAL = 0.1
NOTED_RESIDUAL = 0.01
# A note is given if the noise that is too fast for the knots would raise the power by this share.
NOTED_MISSING = 0.01


# The sums of a run that diverged may overflow. The residual is then NaN, which raises an error.
@np.errstate(over="ignore", invalid="ignore")
def result_of(
    prepared_scene: Prepared,
    engine: Engine,
    realizations: list[Realization],
    failures: dict[int, SimulationError],
    outcome: str = "complete",
    motions: tuple[Attractor, ...] = (),
) -> Result:
    """The result of the completed realizations, with the failures and the motions found."""
    scene = prepared_scene.scene
    moments = [run.moments for run in realizations]
    first, last = min(run.started for run in realizations), max(run.ended for run in realizations)
    cost = step_error(prepared_scene, engine.step, engine.name)
    estimates = run_estimates(prepared_scene, moments, cost)
    drawn = scene.run.starts is not None
    symmetric = is_symmetric(scene, prepared_scene.system)
    shapes = densities(estimates.moments, symmetric, estimates.balance, drawn)
    joints = [run.joint for run in realizations if run.joint is not None]
    joint = joint_density_of(joints, symmetric) if joints else None
    strobed = [run.stroboscope for run in realizations if run.stroboscope is not None]
    samples = np.array(strobed) if strobed else None
    if estimates.shortfalls or scene.excitation.transient(scene.run):
        shapes = {name: replace(shape, standard_error=None) for name, shape in shapes.items()}
    if estimates.shortfalls or slow_exchange(scene, estimates.balance):
        # The samples of the joint density are not weighted, so the shares of the wells depend on
        # the starts.
        joint = joint and replace(joint, standard_error=None)
    failure_notes: tuple[str, ...] = ()
    if failures:
        failed, example = len(failures), next(iter(failures.values()))
        failure_notes = (f"{failed} of {failed + len(moments)} realizations failed: {example}",)
    waveform, run = None, realizations[0]
    if run.waveform is not None:
        waveform = waveform_of(
            scene, engine.title, prepared_scene.scales, run.waveform, run.electrical
        )
    return Result(
        scene=scene,
        engine=engine.title,
        scaled_quantities=estimates.scaled,
        scales=prepared_scene.scales,
        error_kind="statistical",
        energy_balance_residual=estimates.residual,
        wall_seconds=last - first,
        engine_seconds=sum(run.seconds for run in realizations),
        simulated_time=sum(m.time_reached for m in moments),
        steps=sum(m.points for m in moments),
        step=moments[0].step
        or knot_spacing(prepared_scene)
        / steps_per_sample(prepared_scene, engine.step, engine.name),
        step_error=None if engine.chooses_steps else estimates.step_error,
        realizations=len(moments),
        engine_version=run.engine_version,
        netlist_sha256=run.netlist_sha256,
        notes=(
            *notes_on_excitation(prepared_scene),
            *_notes_on_starts(prepared_scene, motions),
            *estimates.notes,
            *_density_notes(estimates, shapes),
            *failure_notes,
        ),
        failures={index: f"{type(e).__name__}: {e}" for index, e in failures.items()},
        densities=shapes,
        joint_density=joint,
        waveform=waveform,
        moments=moments,
        stroboscope=samples,
        attractors=motions,
        outcome="incomplete" if failures else outcome,
    )


def _density_notes(estimates, shapes):
    """A note on densities without error bars, unless another note already gives the reason."""
    bare = [name for name, shape in shapes.items() if shape.standard_error is None]
    if estimates.balance is None or estimates.shortfalls or not bare:
        return ()
    return (
        f"the density of {', '.join(bare)} has no error bar: parts of it depend on fewer than "
        f"{FEWEST_JUMPS:.0f} jumps between wells; simulate longer",
    )


def is_symmetric(scene: Scene, parameters: System) -> bool:
    """Whether a motion and its mirror image are equally likely."""
    return scene.excitation.symmetric and parameters.symmetric and scene.start is None


def partial_result(
    prepared_scene: Prepared, engine: Engine, error: SimulationError
) -> Result | None:
    """A result from the failed realizations' moments, or None if there are none."""
    reached = [Realization(m) for m in error.partial or () if measured_time([m]) > 0.0]
    return result_of(prepared_scene, engine, reached, {}, type(error).__name__) if reached else None


def notes_on_excitation(prepared_scene: Prepared) -> tuple[str, ...]:
    """Notes on the excitation of a result."""
    scene = prepared_scene.scene
    frequency = timescales.angular_frequency(prepared_scene.system)
    spacing, decay = knot_spacing(prepared_scene), prepared_scene.system.transducer.decay_rate()
    notes = scene.excitation.notes(spacing, frequency, scene.run)
    # Share by which noise without an upper frequency limit moves the base more than its linear
    # interpolation does.
    banded = isinstance(scene.excitation, Spectrum)
    missing = timescales.base_share(prepared_scene.system, spacing) * 0.5 * decay * spacing
    if scene.excitation.endless and not banded and missing > NOTED_MISSING:
        notes += (
            f"the noise is linear between samples {spacing:.2g} s apart, and the load's voltage "
            f"decays in {1.0 / decay:.2g} s: the missing faster noise would raise the power by "
            f"about {missing:.0%}; shorten excitation.knot_spacing, or use method spectral",
        )
    return notes


def _notes_on_starts(prepared_scene, motions):
    """Notes on the number of motions that a deterministic run's starts reach."""
    scene = prepared_scene.scene
    if scene.excitation.random:
        return ()
    repeats, requested = note_on_repeats(prepared_scene), scene.run.realizations
    if distinct_realizations(prepared_scene) == 1:
        return (*repeats, *note_on_one_start(prepared_scene))
    unit = unit_of(scene, "power")
    lines = (*repeats, *(motion.sentence(unit) for motion in motions))
    if any(motion.kind == UNDETERMINED for motion in motions):
        lines += (
            "a motion without a period may be chaotic: run.starts = 100 or harvester basins give "
            "its Lyapunov exponent",
        )
    if scene.run.starts:
        lines += (
            "the quantities above are means over all starts; their error bars include the chance "
            f"of {requested} drawn starts; a motion that fewer than {3.0 / requested:.1%} of all "
            "starts reach may be missing",
        )
    elif len(motions) > 1:
        lines += (
            "the quantities above are means over all starts; their error bars are valid for these "
            "starts only: other starts reach the motions in other proportions",
        )
    return lines


def checked(result: Result) -> Result:
    """The result, with a note if its energy balance residual is noticeable.

    Raises EnergyNotBalanced if the residual exceeds `LARGEST_RESIDUAL`.
    """
    balance = result.energy_balance_residual
    residual = abs(math.nan if balance is None else balance)
    if not residual <= LARGEST_RESIDUAL:
        raise EnergyNotBalanced(
            f"{result.engine}: the energy balance leaves {100.0 * residual:.4g} % of the energy "
            f"unaccounted for (limit {LARGEST_RESIDUAL:.0%}); suspected: "
            f"{suspected_cause(result)}; if that is not the cause, choose step = fine or finest",
            partial=result,
        )
    if residual <= NOTED_RESIDUAL:
        return result
    note = f"energy balance residual {residual:.2%}; suspected: {suspected_cause(result)}"
    return replace(result, notes=(*result.notes, note))
