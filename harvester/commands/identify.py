"""`harvester identify`: from measured records to a scene with intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.commands.options import add_results, deliver, read_scene, say, scene_command
from harvester.errors import HarvesterError
from harvester.files.plain_text import named

if TYPE_CHECKING:
    from argparse import Namespace

    from harvester.identification.identification import Identification

ENDINGS = (".toml", "-proposed.toml", ".html")


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "identify",
        run,
        "fit a scene's numbers to measured records, with intervals and a proof on data kept aside",
        "harvester identify device --record shaker.csv load.resistance=1e5 --output identified",
    )
    command.add_argument(
        "--record",
        nargs="+",
        action="append",
        required=True,
        metavar="FILE [SETTING=VALUE]",
        help="CSV, .npy, .wav, .mat, .lvm, HDF5, TDMS or .IDE: base acceleration beside voltage, "
        "displacement or velocity; or a frequency response, frequency beside amplitude and phase; "
        "behind it acceleration=COLUMN:UNIT, voltage=COLUMN:UNIT, …, time=COLUMN, "
        "sampling_rate=HZ, or what differs from the scene (load.resistance=1e5); may be given "
        "again",
    )
    command.add_argument(
        "--free",
        nargs="+",
        action="extend",
        metavar="TABLE.KEY",
        help="what is fitted: numbers of the scene, or of sensors (sensor.voltage_offset, _scale, "
        "_delay, _filter); default: the device's own that are not zero, but the mass",
    )
    command.add_argument(
        "--alone", action="store_true", help="fit no other models to compare the scene's with"
    )
    command.add_argument(
        "--posterior",
        action="store_true",
        help="sample the posterior of the values too (needs emcee: pip install "
        "'harvester[posterior]')",
    )
    add_results(command)
    command.add_argument(
        "--report", metavar="FILE", help="write one self-contained HTML page with everything"
    )


def run(options: Namespace) -> None:
    """Carry it out."""
    scene = read_scene(options)
    from harvester.commands.console import progress
    from harvester.commands.options import check_options
    from harvester.files.writing import check_writable, in_folder
    from harvester.identification.identify import identify

    name = f"{scene.name}-identified"
    check_options(options, name)
    check_writable(options.report)
    for ending in ENDINGS if options.output else ():
        in_folder(options.output, f"{name}{ending}")
    records = _records(options.record, scene)
    with progress() as follow:
        found = identify(
            scene,
            records,
            free=options.free,
            compare=not options.alone,
            posterior=options.posterior,
            progress=follow("identify", None),
        )
    try:
        deliver(options, name, found, f"identified from {', '.join(r.name for r in records)}")
        if options.output:
            _write_scenes(options.output, name, found)
    finally:
        if options.report:
            from harvester.files.writing import write_text
            from harvester.identification.report import report

            write_text(options.report, report(found))
            say(f"written: {options.report}")


def _records(groups: list[list[str]], scene: Any) -> list:
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


def _write_scenes(folder: str, name: str, found: Identification) -> None:
    """The identified scene, the proposed one where it is another, and the page."""
    from harvester.files.writing import in_folder, write_text
    from harvester.identification.report import report

    own, proposed, page = (in_folder(folder, f"{name}{ending}") for ending in ENDINGS)
    write_text(own, found.scene_text())
    if found.proposed is not found.candidates[0]:
        write_text(proposed, found.scene_text(found.proposed))
    write_text(page, report(found))
