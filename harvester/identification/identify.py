"""`identify`: from measured records to a scene with intervals, and how far it predicts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from harvester.arguments import listed
from harvester.calling import takes_scene
from harvester.errors import IdentificationError
from harvester.files.plain_text import shown
from harvester.identification.candidates import Candidate, candidates
from harvester.identification.checks import check_records
from harvester.identification.fitting import Fitted, fitted
from harvester.identification.identification import Identification
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.measurement import Measurement, read_measurement
from harvester.identification.posterior import posterior as posterior_of
from harvester.identification.proof import typical_period, whiteness
from harvester.identification.sizes import first_sizes, fitted_sizes
from harvester.identification.unknowns import checked_keys, default_keys
from harvester.identification.verdict import verdict
from harvester.scene.model import Scene

if TYPE_CHECKING:
    from harvester.identification.intervals import Undetermined

Record = Measurement | MeasuredResponse
# Shares of the work: other models begin at the first, the posterior at the second.
MODELS_BEGIN, POSTERIOR_BEGINS = 0.4, 0.7
# Of a direction that is not determined, those that are rather kept as in the scene.
KEPT_FIRST = ("capacitance", "restitution", "stiffness", "quadratic_damping")


@takes_scene
def identify(
    scene: Scene,
    records: Sequence[Record | str | Path] | Record | str | Path,
    *,
    free: Sequence[str] | None = None,
    compare: bool = True,
    posterior: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Identification:
    """Fit a scene's numbers to measured records, a third of each kept aside as proof.

    Parameters
    ----------
    scene : Scene
        Where the fit begins, and all that is known: what is not free stays as it is.
    records : sequence of Measurement, MeasuredResponse or file, or one of them
        A file's columns have their quantity and unit in the header; see `read_measurement`.
    free : sequence of str, optional
        Keys of the scene (`oscillator.damping`, `oscillator.restoring_force[2]`, …) and of sensors
        (`sensor.voltage_offset`, `_scale`, `_delay`, `_filter`). Left out: the device's own numbers
        that are not zero, but mass, winding, leak and, without a displacement, the constant force;
        what the records do not determine then stays as in the scene.
    compare : bool
        Fit neighbouring models too: symmetric spring or not, cubic or linear, drag, stoppers.
    posterior : bool
        Sample the posterior of the values too, by the scene's seed; needs emcee.
    progress : callable, optional
        Of the share done and what is being done.

    Returns
    -------
    Identification

    Raises
    ------
    SceneError, HarvesterError
        A record or a key is not usable.
    IdentificationError
        The records do not tell what is asked of them.
    """
    clock = time.perf_counter()
    follow = progress or (lambda share, text: None)
    measurements = _measurements(scene, records)
    check_records(scene, measurements)
    outputs = list(measurements[0].sensed)
    named = None if free is None else listed(free, "free", 'free=["oscillator.damping"]')
    keys = default_keys(scene, outputs) if named is None else checked_keys(scene, named, outputs)
    if not keys:
        raise IdentificationError(f"{scene.name}: nothing is free; name keys with --free")
    follow(0.0, "fit")
    try:
        base, kept = _determined(scene, measurements, keys, free is None)
    except IdentificationError as error:
        remarks = [each for record in measurements for each in getattr(record, "remarks", ())]
        raise IdentificationError("; ".join([str(error), *remarks])) from None
    follow(MODELS_BEGIN, "other models")
    sizes = fitted_sizes(base, measurements)
    found = [Candidate("as given", base, 0.0, 0.0)]
    if compare and any(each.acceleration is not None for each in measurements):
        found = candidates(base, measurements, base.keys, sizes)
    sampled = None
    if posterior:
        follow(POSTERIOR_BEGINS, "posterior")
        sampled = posterior_of(
            base, scene.run.seed, lambda share: follow(_later(share), "posterior")
        )
    white = whiteness(base.stretches[0], 0, typical_period(base.shooting.responses))
    return Identification(
        scene=base.scene,
        start=scene,
        measurements=measurements,
        fitted=base,
        kept=kept,
        candidates=found,
        whiteness=white,
        verdict=verdict(base, found, white),
        seconds=time.perf_counter() - clock,
        posterior=sampled,
    )


def _later(share):
    return POSTERIOR_BEGINS + (1.0 - POSTERIOR_BEGINS) * share


def _measurements(scene, records):
    if isinstance(records, (Measurement, MeasuredResponse, str, Path)):
        records = [records]
    return [_measurement(each, scene) for each in listed(records, "records", '["shaker.csv"]')]


def _measurement(record, scene):
    """A record as it is, or read from its file."""
    if isinstance(record, (str, Path)):
        return read_measurement(record, units=scene.units)
    if not isinstance(record, (Measurement, MeasuredResponse)):
        raise IdentificationError(
            f"records: {shown(record)}: must be a file or what read_measurement returns"
        )
    return record


def _determined(
    scene: Scene, measurements: list[Measurement], keys: list[str], drop: bool
) -> tuple[Fitted, list[tuple[str, Undetermined]]]:
    """The fit of what the records determine, and what of the keys was kept as in the scene."""
    kept: list[tuple[str, Undetermined]] = []
    sizes = first_sizes(scene, measurements)
    found = fitted(scene, measurements, keys, sizes)
    while drop and found.undetermined and len(found.keys) > 1:
        unclear = found.undetermined[0]
        out = _to_keep(unclear)
        kept.append((out, unclear))
        found = fitted(scene, measurements, [key for key in found.keys if key != out], sizes)
    return found, kept


def _to_keep(unclear):
    """The key of an undetermined direction that stays as in the scene."""
    for name in KEPT_FIRST:
        for key in unclear.keys:
            if key.endswith(name):
                return key
    return unclear.keys[0]
