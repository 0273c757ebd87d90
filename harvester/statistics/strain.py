"""Strain, stress and fatigue life of a beam's layers, with error bars."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device.beam.lumped import FATIGUE
from harvester.statistics.batch_means import complete_batches, ratio_estimate, standard_error
from harvester.statistics.estimate import Estimate, root
from harvester.statistics.strain_moments import STRAIN, STRESS

if TYPE_CHECKING:
    from harvester.excitation.base import Excitation
    from harvester.scene.model import Scene
    from harvester.statistics.moments import Moments

# Quantile of the normal distribution for a two-sided 95 % interval.
TWO_SIDED = 1.959964
ONE_PEAK = "one realization has only one peak: raise run.realizations for an error bar"
# Quantities that exist only if the scene gives a Basquin curve of its layers.
LIFE = ("damage_rate", "fatigue_life")
ONE_PASS = "the peak of one deterministic pass"
NO_CYCLE = "no strain cycle occurred"


def estimate_strain(
    moments: Sequence[Moments], excitation: Excitation, error_of: Callable = standard_error
) -> dict[str, Estimate]:
    """Strain and stress (Pa) of a set of realizations, and fatigue life if a Basquin curve is
    given.

    The result is empty for a scene without a drawing. A peak is the mean over realizations of the
    largest magnitude in the measured time. `excitation` determines whether realizations are random
    or periodic.
    """
    batches = complete_batches(moments)
    if batches is None or moments[0].strain is None:
        return {}
    strains: list[Any] = [realization.strain for realization in moments]
    count = batches.shape[1]
    squares = np.stack([strain.squares[:count] for strain in strains])
    peaks = np.stack([strain.peaks[:count] for strain in strains])
    time, estimates = squares[:, :, 0], {}
    for row, (name, dimension) in enumerate((("strain", "1"), ("stress", "stress"))):
        estimates[f"peak_{name}"] = _peak(peaks[:, :, row], dimension, excitation, error_of)
        square = f"{dimension}^2" if dimension != "1" else "1"
        mean = ratio_estimate(squares[:, :, row + 1], time, square, error_of=error_of)
        estimates[f"rms_{name}"] = root(mean)
    if all(strain.damage is not None for strain in strains):
        damage = np.stack([strain.damage[:count] for strain in strains])
        rate = ratio_estimate(damage, time, "rate", error_of=error_of)
        estimates |= dict(zip(LIFE, (rate, _life(rate)), strict=True))
    return estimates


def _peak(peaks, dimension, excitation, error_of):
    """Mean of the realizations' maxima; for periodic motion, with the scatter of batches."""
    highest = peaks.max(axis=1)
    count = highest.size
    if not excitation.random:
        error = None if excitation.period is None else error_of(peaks)
        note = ONE_PASS if error is None else ""
        return Estimate(float(highest.mean()), error, None, dimension, note)
    if count == 1:
        return Estimate(float(highest[0]), None, None, dimension, ONE_PEAK)
    from scipy.stats import t as student

    # For few realizations the error is widened, so that ± two errors have the normal coverage.
    wider = float(student.ppf(0.975, count - 1)) / TWO_SIDED
    error = float(highest.std(ddof=1)) / math.sqrt(count) * wider
    return Estimate(float(highest.mean()), error, float(count), dimension)


def _life(rate):
    """Time until the damage is 1 (s)."""
    if not rate.estimate > 0.0:
        return Estimate(math.nan, None, None, "time", NO_CYCLE)
    error = rate.standard_error
    error = None if error is None else error / rate.estimate**2
    return Estimate(1.0 / rate.estimate, error, None, "time", rate.note)


def strain_notes(scene: Scene, moments: Sequence[Moments]) -> tuple[str, ...]:
    """A note if the layers' strain exceeds the limit of the scene or of their material."""
    if scene.beam is None:
        return ()
    limit, named = scene.beam.limit
    strains: list[Any] = [realization.strain for realization in moments]
    highest = [float(strain.peaks[:, STRAIN].max()) for strain in strains]
    beyond = sum(peak > limit for peak in highest)
    if not beyond:
        return ()
    return (
        f"the strain of the layers exceeds {limit:.3g}, {named}, in {beyond} of "
        f"{len(highest)} realizations, by up to {100.0 * (max(highest) / limit - 1.0):.3g} % "
        f"(stress up to {max(strain.peaks[:, STRESS].max() for strain in strains) * 1e-6:.4g} MPa)",
    )


def without_line(scene: Scene, name: str) -> str:
    """Reason why a fatigue quantity is missing if there is no Basquin curve; else ""."""
    if name not in LIFE or scene.beam is None or scene.beam.fatigue_line is not None:
        return ""
    keys = ", ".join(f"beam.{key}" for key in FATIGUE)
    return f"{scene.name}: {name} needs the Basquin curve of your layers: give {keys}"
