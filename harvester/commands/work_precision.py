"""`harvester work-precision`: error against run time of every method."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    add_study_options,
    checked_scene,
    deliver,
    scene_command,
    study_runner,
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
    command.add_argument(
        "--thorough", action="store_true", help="more paths, steps and realizations"
    )
    add_study_options(command)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene, name = checked_scene(options, "work-precision")
    from harvester.verification.accuracy.work_precision import work_precision

    with study_runner(options, "work-precision") as runner:
        diagram = work_precision(scene, thorough=options.thorough, runner=runner)
        deliver(options, name, diagram, "error against run time")
