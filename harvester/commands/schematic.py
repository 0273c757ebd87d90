"""`harvester schematic`: a drawing of the circuit that a scene builds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.commands.options import read_scene, say, scene_command

if TYPE_CHECKING:
    from argparse import Namespace


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "schematic",
        run,
        "draw the circuit that the scene really builds, as SVG or PNG",
        "harvester schematic device --set load.netlist=bridge --output bridge.svg",
    )
    command.add_argument(
        "--output",
        default="-",
        metavar="FILE",
        help="an .svg or .png file, or folder for SCENE-schematic.svg (default: SVG to standard "
        "output)",
    )


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    from circuits.schematic.drawing import schematic
    from harvester.files.writing import in_folder, is_stream, write_text

    drawing = schematic(scene)
    if is_stream(options.output):
        write_text(options.output, drawing.image().decode() + "\n")
        return
    target = Path(options.output)
    if target.is_dir() or not target.suffix:
        target = in_folder(target, f"{scene.name}-schematic.svg")
    drawing.save(target)
    say(f"written to {target}")
