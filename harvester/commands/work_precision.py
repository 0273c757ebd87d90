"""`harvester work-precision`: error against run time of every method."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    add_results,
    check_options,
    read_scene,
    scene_command,
    write_result,
)


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "work-precision",
        run,
        "error against run time of every method on one scene",
        "harvester work-precision paper --output results",
    )
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    command.add_argument(
        "--thorough", action="store_true", help="more paths, steps and realizations"
    )
    add_results(command)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    name = f"{scene.name}-work-precision"
    check_options(options, name)
    from harvester.files.writing import is_standard_output
    from harvester.show.console import progress, show_table
    from harvester.verification.work_precision.measurement import work_precision

    with progress() as follow:
        diagram = work_precision(
            scene, thorough=options.thorough, workers=options.workers, progress=follow
        )
    show_table(diagram, "error against run time", to_stderr=is_standard_output(options.json))
    write_result(options, name, diagram)
