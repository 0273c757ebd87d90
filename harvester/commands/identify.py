"""`harvester identify`: from measured records to a scene with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from harvester.errors import HarvesterError
from harvester.files.plain_text import named
from harvester.signatures import Kind

if TYPE_CHECKING:
    from harvester.identification.identification import Identification
    from harvester.scene.model import Scene


def identify(
    scene: Scene,
    record: Annotated[list[list[str]], Kind("FILE [SETTING=VALUE]", again=True, words=True)],
    *,
    free: Annotated[Sequence[str], Kind("TABLE.KEY", again=True, words=True)] | None = None,
    alone: bool = False,
    posterior: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Identification:
    """Fit a scene's numbers to measured records, with intervals and a proof on data kept aside.

    Parameters
    ----------
    scene : Scene
    record : list of list of str
        CSV, .npy, .wav, .mat, .lvm, HDF5, TDMS or .IDE: base acceleration beside voltage,
        displacement or velocity; or a frequency response, frequency beside amplitude and phase;
        behind it acceleration=COLUMN:UNIT, voltage=COLUMN:UNIT, …, time=COLUMN,
        sampling_rate=HZ, or what differs from the scene (load.resistance=1e5); may be given
        again.
    free : list of str
        What is fitted: numbers of the scene, or of sensors (sensor.voltage_offset, _scale, _delay,
        _filter); default: the device's own that are not zero, but the mass.
    alone : bool
        Fit no other models to compare the scene's with.
    posterior : bool
        Sample the posterior of the values too (needs emcee: pip install 'harvester[posterior]').
    """
    from harvester.identification.identify import identify

    return identify(
        scene,
        _records(record, scene),
        free=free,
        compare=not alone,
        posterior=posterior,
        progress=progress,
    )


def _records(groups: list[list[str]], scene: Scene) -> list:
    """Measurements: words with = are settings of the file before them."""
    from harvester.identification.measurement import read_measurement

    files: list[tuple[str, dict[str, Any]]] = []
    for group in groups:
        for place, word in enumerate(group):
            if place == 0 or "=" not in word:
                files.append((word, {}))
                continue
            files[-1][1].update([_setting(word)])
    for place, (file, settings) in enumerate(files):
        if (file, settings) in files[:place]:
            raise HarvesterError(
                f"--record {named(file)}: is given twice with the same settings, and each record "
                "counts once: leave one out"
            )
    return [read_measurement(file, settings, scene.units) for file, settings in files]


def _setting(word):
    """(name, value) of one setting; a number where it is one."""
    key, _, value = (part.strip() for part in word.partition("="))
    if not key or not value:
        raise HarvesterError(f"--record {named(word)}: write a setting as NAME=VALUE")
    try:
        return key, float(value) if "." in key else value
    except ValueError:
        return key, value
