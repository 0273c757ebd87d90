"""Reject records that cannot determine the requested values, before the fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import IdentificationError
from harvester.base.plain_text import named, nearest
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.sensors import VELOCITY_SCALE
from harvester.scene.numbers import numbers
from harvester.scene.units import require_resistor

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Minimum length of a record in periods of the motion; a third of it is validation data.
FEWEST_PERIODS = 12.0
FEWEST_SAMPLES_PER_PERIOD = 5.0
# The base acceleration must have power between these multiples of the motion's median frequency.
BAND = (0.5, 2.0)
# Minimum share of the acceleration's power in that band; a smaller share may be round-off of the
# recorded numbers.
SMALLEST_BAND_SHARE = 1e-4
# A record is a ring-down if the mean square of its last quarter is below this multiple of the first
# quarter's.
RINGING_DOWN = 0.5


def check_impedance_alone(
    determined: Sequence[str], aside: Sequence[Any], free: Sequence[str] | None
) -> None:
    """Raise if keys are freed, or validation records given, with an impedance as the only data.

    Parameters
    ----------
    determined : sequence of str
        Keys of the values that the impedance determines.
    """
    if aside:
        raise IdentificationError(
            "--keep-aside: an impedance alone cannot predict a record: also give a record "
            "(--record)"
        )
    if free is not None:
        raise IdentificationError(
            f"--free: an impedance alone determines {', '.join(determined)}, and no others: omit "
            "--free, or also give a record (--record)"
        )


def check_records(
    scene: Scene,
    measurements: Sequence[Measurement | MeasuredResponse],
    aside: Sequence[Measurement | MeasuredResponse],
) -> None:
    """Raise if the scene or a record cannot be fitted, or a validation record cannot be predicted.

    Raises
    ------
    IdentificationError
        A record is too short, too coarse, or has no excitation in the band of the motion; or a
        validation record is a response, or frees an invalid key.
    LoadError
        The load is not a resistor, or the displacement is prescribed.
    """
    if not measurements:
        raise IdentificationError(
            "--record: no record to fit is given, only validation records: give at least one "
            "record, or an impedance by --impedance"
        )
    _check_kept_aside(scene, measurements, aside)
    require_resistor(scene, "identify")
    shared = set(measurements[0].sensed)
    for record in [*measurements, *aside]:
        require_resistor(scene.replace(record.changes), "identify")
        if record.sensed and not shared & set(record.sensed):
            raise IdentificationError(
                f"{record.name}: measures {', '.join(record.sensed)}, but the first record "
                f"measures {', '.join(sorted(shared))}: records need a quantity in common"
            )
        if isinstance(record, MeasuredResponse):
            record.check()
        else:
            _check_record(record)


def scale_is_missing(record: Measurement | MeasuredResponse) -> bool:
    """Whether a velocity is in volts of unknown scale."""
    return record.velocity_in_volts and VELOCITY_SCALE not in record.sensors


def check_volts(measurements: Sequence[Measurement], keys: Sequence[str]) -> None:
    """Raise IdentificationError if the scale of a velocity in volts is neither given nor free."""
    for record in filter(scale_is_missing, measurements):
        if VELOCITY_SCALE not in keys:
            raise IdentificationError(
                f"{record.name}: the velocity is in volts: free its scale with --free "
                f"{VELOCITY_SCALE}, or give it after the file as {VELOCITY_SCALE}=VOLTS_PER_M/S"
            )
        if len(record.outputs) == 1:
            raise IdentificationError(
                f"{record.name}: a velocity in volts does not determine its scale: give it after "
                f"the file as {VELOCITY_SCALE}=VOLTS_PER_M/S, or give a voltage or a displacement"
            )


def _check_kept_aside(scene, fitted, aside):
    """Raise if a validation record is a response, or frees an invalid key."""
    names = [key for key in numbers(scene) if not key.startswith(("excitation.", "load.", "run."))]
    if aside and all(isinstance(record, MeasuredResponse) for record in fitted):
        raise IdentificationError(
            f"--keep-aside {aside[0].name}: frequency responses alone cannot predict a record: "
            "also give a record to fit (--record)"
        )
    for record in fitted:
        for key in record.own:
            raise IdentificationError(
                f"{record.name}: {named(key)} = free: only a validation record (--keep-aside) can "
                "have a free value: give the value, or free it for all records (--free)"
            )
    for record in aside:
        if isinstance(record, MeasuredResponse):
            raise IdentificationError(
                f"--keep-aside {record.name}: a frequency response cannot be a validation record: "
                "give it as --record, which uses every third frequency for validation"
            )
        for key in record.own:
            if key not in names:
                raise IdentificationError(
                    f"{record.name}: {named(key)} = free: not a number of this scene"
                    f"{nearest(key, names)}; there are {', '.join(names)}"
                )


def _check_record(record):
    median, _ = record.frequencies
    periods, per_period = median * record.duration, record.sampling_rate / median
    if periods < FEWEST_PERIODS:
        raise IdentificationError(
            f"{record.name}: too short: {periods:.3g} periods of the motion at {median:.3g} Hz, "
            f"must be at least {FEWEST_PERIODS:g}: measure longer"
        )
    if per_period < FEWEST_SAMPLES_PER_PERIOD:
        raise IdentificationError(
            f"{record.name}: sampled too coarsely: {per_period:.2g} samples per period of the "
            f"motion at {median:.3g} Hz, must be at least {FEWEST_SAMPLES_PER_PERIOD:g}: use a "
            "higher sampling rate"
        )
    first = next(iter(record.outputs.values()))
    quarters = np.array_split(first - np.mean(first), 4)
    if np.mean(quarters[-1] ** 2) < RINGING_DOWN * np.mean(quarters[0] ** 2):
        return
    share = _share_in_band(record, median)
    if share < SMALLEST_BAND_SHARE:
        raise IdentificationError(
            f"{record.name}: no excitation in the relevant band: {share:.1g} of the "
            f"acceleration's power is between {BAND[0] * median:.3g} and {BAND[1] * median:.3g} "
            "Hz, where the device moves: check the acceleration's column"
        )


def _share_in_band(record, median):
    from scipy import signal

    values = record.acceleration - record.acceleration.mean()
    if not values.any():
        return 0.0
    f, density = signal.welch(values, record.sampling_rate, nperseg=min(values.size, 4096))
    inside = (f >= BAND[0] * median) & (f <= BAND[1] * median)
    return float(density[inside].sum() / density.sum())
