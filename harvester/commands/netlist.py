"""`harvester netlist`: a stand-alone netlist of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.commands.options import STEP_HELP, read_scene, scene_command
from harvester.errors import HarvesterError

if TYPE_CHECKING:
    from argparse import Namespace

DIALECTS = ("ngspice", "ltspice")


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "netlist",
        run,
        "write a stand-alone .cir that plain `ngspice -b` runs",
        "harvester netlist paper --set run.duration=100 --output paper.cir",
    )
    command.add_argument(
        "--output",
        default="-",
        metavar="FILE",
        help="file, or folder for SCENE.cir (default: standard output)",
    )
    command.add_argument(
        "--dialect",
        default="ngspice",
        metavar="NAME",
        help="ngspice (default), or ltspice, with the noise in FILE-noise.txt beside FILE",
    )
    command.add_argument("--step", default="default", help=STEP_HELP)
    command.add_argument(
        "--realization", type=int, default=0, metavar="N", help="whose noise path (default: 0)"
    )


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    from circuits.export import for_ltspice, stand_alone
    from harvester.files.plain_text import name, nearest
    from harvester.files.writing import check_writable, in_folder, is_stream, write_text
    from harvester.prepared.paths import noise_path, start_state
    from harvester.prepared.prepared import prepared
    from harvester.simulation.simulate import check_step

    if options.dialect not in DIALECTS:
        raise HarvesterError(
            f"--dialect {options.dialect}: no such dialect{nearest(options.dialect, DIALECTS)}; "
            f"there are {', '.join(DIALECTS)}"
        )
    target = options.output
    if is_stream(target) and options.dialect != "ngspice":
        raise HarvesterError(
            "--dialect ltspice writes a second file, the noise: say where, --output FILE.cir"
        )
    if target != "-" and Path(target).is_dir():
        target = in_folder(target, f"{scene.name}.cir")
    check_writable(target)
    if not 0 <= options.realization < scene.run.realizations:
        raise HarvesterError(
            f"--realization {options.realization}: must be a whole number in "
            f"[0, {scene.run.realizations - 1}]"
        )
    ready = prepared(scene)
    call = (scene, noise_path(ready, options.realization))
    start, step = start_state(ready, options.realization), check_step(options.step)
    if options.dialect == "ngspice":
        write_text(target, stand_alone(*call, start, step).text + ".end\n")
        return
    # The netlist holds this name.
    noise_file = name(Path(target).with_suffix("").name) + "-noise.txt"
    text, noise = for_ltspice(*call, noise_file, start, step)
    if noise is not None:
        write_text(in_folder(Path(target).parent, noise_file), noise)
    write_text(target, text)
