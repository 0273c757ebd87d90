"""`identify`: fit a scene with intervals to measured records, and assess its predictions."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from harvester.base.arguments import listed
from harvester.base.errors import HarvesterError, IdentificationError
from harvester.base.numbers import number
from harvester.base.plain_text import named, shown
from harvester.base.signatures import Kind, pair_of
from harvester.scene.calling import takes_scene

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted
    from harvester.identification.identification import Identification
    from harvester.identification.intervals import Undetermined
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Progress (share of the work) at which rival models begin, and at which the posterior begins.
MODELS_BEGIN, POSTERIOR_BEGINS = 0.4, 0.7
# Share of the remaining work for each rival model.
RIVAL_SHARE = 0.1


def files_of(words: list[str]) -> list[tuple[str, dict[str, Any]]]:
    """Parse files with their settings: words with = belong to the preceding file."""
    files: list[tuple[str, dict[str, Any]]] = []
    for word in words:
        if not files or "=" not in word:
            files.append((word, {}))
            continue
        name, value = pair_of(str)(word)
        if not name:
            raise ValueError(word)
        # Keys of the scene take numbers, columns take names.
        settings = files[-1][1]
        settings[name] = value
        with contextlib.suppress(ValueError):
            settings[name] = number(value) if "." in name else value
    return files


def together(lists: list[list[Any]], option: str) -> list[Any]:
    return [item for items in lists for item in items]


def records_of(lists: list[list[Any]], option: str) -> list[tuple[str, dict[str, Any]]]:
    """Files with their settings; raise HarvesterError if one is given twice."""
    seen: list[tuple[str, dict[str, Any]]] = []
    for file, settings in together(lists, option):
        # A file may have several names, such as shaker.csv, ./shaker.csv and a link.
        record = (os.path.realpath(file), settings)
        if record in seen:
            raise HarvesterError(
                f"{option} {named(file)}: is given twice with the same settings, but each record "
                "counts once: remove one"
            )
        seen.append(record)
    return together(lists, option)


def one_record_of(lists: list[list[Any]], option: str) -> tuple[str, dict[str, Any]]:
    """One file with its settings; raise HarvesterError if there are several."""
    record, *further = together(lists, option)
    if further:
        raise HarvesterError(
            f"{option} {named(further[0][0])}: give only one file, with NAME=VALUE"
        )
    return record


_FILE = Kind("FILE [SETTING=VALUE]", "written as FILE NAME=VALUE", read=files_of, words=True)
Records = Annotated[Any, replace(_FILE, option="record", join=records_of)]
KeptRecords = Annotated[Any, replace(_FILE, option="keep-aside", join=records_of)]
Keys = Annotated[Sequence[str], Kind("TABLE.KEY", read=list, join=together, words=True)]
Impedance = Annotated[Any, replace(_FILE, join=one_record_of)]


@takes_scene
def identify(
    scene: Scene,
    records: Records = (),
    *,
    impedance: Impedance = None,
    free: Keys | None = None,
    keep_aside: KeptRecords | None = None,
    compare: Annotated[bool, Kind(option="alone")] = True,
    posterior: bool = False,
    progress: Callable[[float, str], object] | Literal[False] | None = None,
) -> Identification:
    """Fit a scene's numbers to measured records, with intervals and validation on unused data.

    Parameters
    ----------
    scene : Scene
        Scene with the initial values and all known values; only free values change.
    records : sequence of Measurement, MeasuredResponse, file or (file, settings), or one of them
        CSV, .npy, .wav, .mat, .lvm, HDF5, TDMS or .IDE: base acceleration with voltage,
        displacement or velocity; or a frequency response, frequency with amplitude and phase;
        with the settings acceleration=COLUMN:UNIT, voltage=COLUMN:UNIT, …, time=COLUMN,
        sampling_rate=HZ, or values that differ from the scene (load.resistance=1e5), see
        `harvester.read_measurement`; several may be given.
    impedance : MeasuredImpedance, file or (file, settings), optional
        Impedance of the piezo with clamped base, from an impedance analyser: CSV of magnitude and
        phase or of resistance and reactance, or .s1p (needs scikit-rf: the extra `analyser`), with
        the settings frequency=COLUMN:UNIT, impedance=COLUMN:UNIT, phase=COLUMN:UNIT, …. Alone it
        determines stiffness, damping, coupling and capacitance for the scene's mass, together with
        records also the mass.
    free : sequence of str
        Fitted values: numbers of the scene (oscillator.damping, oscillator.restoring_force[2], …),
        or of sensors (sensor.voltage_offset, _scale, _delay, _filter, _highpass, _resistance,
        sensor.acceleration_highpass, …). `device` (default) means all nonzero numbers of the device
        except mass, winding, leak and, without a displacement, the constant force. Values that the
        records do not determine then keep the scene's values.
    keep_aside : as `records`
        Validation records, which are not fitted: each is simulated from one start under its
        acceleration, and orbit, rms and power are compared.
    compare : bool
        Also fit other models for comparison (symmetric spring or not, cubic or linear, drag,
        stoppers; sensors and richer springs if residuals exceed the sensors' noise); --alone fits
        only the scene's model.
    posterior : bool
        Also sample the posterior of the values, with the scene's seed (needs emcee: the extra
        `posterior`).

    Other Parameters
    ----------------
    progress : callable, optional
        Function of (finished share, name of the current task).

    Returns
    -------
    Identification

    Raises
    ------
    SceneError, HarvesterError
        A record or a key is invalid.
    IdentificationError
        The records do not determine the requested values.

    Examples
    --------
    ::

        harvester identify device --record shaker.csv load.resistance=1e5 --output identified
    """
    from harvester.device.keys import computed
    from harvester.engines.progress import Stages
    from harvester.identification import checks, rivals
    from harvester.identification.identifiability import assumptions
    from harvester.identification.identification import Identification
    from harvester.identification.impedance_fit import from_impedance
    from harvester.identification.intervals import moved_by_records
    from harvester.identification.kept_aside import kept_aside, visited
    from harvester.identification.measured_response import MeasuredImpedance, read_impedance
    from harvester.identification.posterior import posterior as posterior_of
    from harvester.identification.unknowns import MASS, checked_keys, default_keys

    clock = time.perf_counter()
    # Records determine the lumped values, not the drawing's dimensions, so the drawing is removed.
    scene = scene.without_drawing()
    # Likewise a frequency, a damping ratio or k² is replaced by the values computed from it.
    tables = ("oscillator", scene.oscillator), (scene.transducer_name, scene.transducer)
    scene = scene.replace(
        {f"{name}.{key}": getattr(part, key) for name, part in tables for key in computed(part)}
    )
    stages = Stages(progress or (lambda share, text: None))
    measurements = _measurements(scene, records)
    aside = [] if keep_aside is None else _measurements(scene, keep_aside)
    named = None if free is None else listed(free, "free", 'free=["oscillator.damping"]')
    analysed, begun = None, scene
    if impedance is not None:
        if not isinstance(impedance, MeasuredImpedance):
            impedance = _read(impedance, "impedance", read_impedance)
        analysed = from_impedance(scene, impedance)
        begun = analysed.scene
    if analysed and not measurements:
        checks.check_impedance_alone(analysed.keys, aside, named)
        keys = analysed.keys
    else:
        checks.check_records(begun, measurements, aside)
        outputs = list(measurements[0].sensed)
        keys = default_keys(begun, outputs, any(map(checks.scale_is_missing, measurements)))
        if analysed and "voltage" in outputs:
            keys = [MASS, *keys]
        if named is not None:
            keys = checked_keys(begun, named, outputs)
        if not keys:
            raise IdentificationError(f"{scene.name}: no value is free; name keys with --free")
        checks.check_volts(measurements, keys)
    if analysed:
        measurements.append(analysed.measured)
    stages.begin(0.0, MODELS_BEGIN, "fit")
    try:
        base, fixed = _determined(begun, measurements, keys, free is None, stages)
    except IdentificationError as error:
        remarks = [remark for record in measurements for remark in record.remarks]
        raise IdentificationError("; ".join([str(error), *remarks])) from None
    stages.begin(MODELS_BEGIN, MODELS_BEGIN, "other models")
    narrow = base
    if base.settled and not base.explains:
        moved = moved_by_records(base.shooting, base.fit, len(base.settled.edges))
        base = replace(base, covariance=base.covariance + moved)
    models = [rivals.Rival("as given", base)]

    def report(name: str) -> None:
        # The number of rivals is unknown in advance: each gets a share of the remaining work.
        begin = stages.share + RIVAL_SHARE * (POSTERIOR_BEGINS - stages.share)
        stages.begin(begin, begin, f"rival model: {name}")

    if compare and any(record.acceleration is not None for record in measurements):
        models = rivals.rival_models(models[0], measurements, scene, keys, report)
    stages.begin(POSTERIOR_BEGINS, 1.0, "validation records")
    where = visited(base)
    predicted = where and kept_aside(narrow, aside, where, base.records, scene.run.seed, stages)
    stages.begin(POSTERIOR_BEGINS, 1.0, "posterior" if posterior else "verdict")
    return Identification(
        scene=base.scene,
        start=scene,
        measurements=measurements,
        fitted=base,
        kept=fixed,
        records=base.records,
        rivals=models,
        spring=rivals.next_power(base) if base.explains else None,
        errors=base.relative_errors,
        assumptions=assumptions(base) if base.explains else [],
        kept_aside=predicted or [],
        visited=where,
        posterior=posterior_of(base, scene.run.seed, stages) if posterior else None,
        impedance=analysed,
        seconds=time.perf_counter() - clock,
    )


def _read(item, name, reader, *options):
    """Read a measurement from a file or a pair (file, settings)."""
    file, settings = item if isinstance(item, tuple) and len(item) == 2 else (item, None)
    if not isinstance(file, (str, Path)):
        raise IdentificationError(
            f"{name}: {shown(item)}: must be a file or the return value of {reader.__name__}"
        )
    return reader(file, settings, *options)


def _measurements(scene, records):
    """The records as a list, from one record or an iterable of several."""
    from harvester.identification.measured_response import MeasuredResponse
    from harvester.identification.measurement import Measurement, read_measurement

    if isinstance(records, (Measurement, MeasuredResponse, str, Path)):
        records = [records]
    measurements = [
        item
        if isinstance(item, (Measurement, MeasuredResponse))
        else _read(item, "records", read_measurement, scene.units)
        for item in listed(records, "records", '["shaker.csv"]')
    ]
    # Time records come first, because they show the motion.
    return sorted(measurements, key=lambda record: isinstance(record, MeasuredResponse))


def _determined(
    scene: Scene,
    measurements: list[Measurement],
    keys: list[str],
    drop: bool,
    follow: Callable[[float], object],
) -> tuple[Fitted, list[tuple[str, Undetermined]]]:
    """Fit the values that the records determine; also return the keys with the scene's values.

    If a model follows the records only in short windows, its values are not fitted again.
    """
    from harvester.identification.fitting import fitted
    from harvester.identification.identifiability import to_keep

    undetermined: list[tuple[str, Undetermined]] = []
    model = fitted(scene, measurements, keys, follow=follow)
    while drop and (unclear := to_keep(model)) and model.follows:
        undetermined += unclear
        fixed = {key for key, _ in undetermined}
        keys = [key for key in model.keys if key not in fixed]
        model = fitted(scene, measurements, keys, follow=follow)
    return model, undetermined
