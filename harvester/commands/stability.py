"""`harvester stability`: stiff and extreme variations of one scene, judged."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    STEP_HELP,
    add_study_options,
    checked_scene,
    deliver,
    scene_command,
    study_runner,
)
from harvester.verification.stability import TIME_LIMIT


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "stability",
        run,
        "judge stiff and extreme variations of one scene; exit code 1 where one is wrong",
        "harvester stability paper --output results",
        default_scene="paper",
    )
    command.add_argument("--step", default="default", help=STEP_HELP)
    command.add_argument(
        "--time-limit",
        type=float,
        default=TIME_LIMIT,
        metavar="SECONDS",
        help=f"wall-clock limit of one case by one method (default: {TIME_LIMIT:g})",
    )
    add_study_options(command)


def run(options: Namespace) -> int:
    """Carry it out; returns the exit code, or None for 0."""
    scene, name = checked_scene(options, "stability")
    from harvester.verification.stability.matrix import stability

    with study_runner(options, "stability") as runner:
        matrix = stability(scene, step=options.step, runner=runner)
        deliver(options, name, matrix, "stiff and extreme cases")
    return 1 if matrix.wrong else 0
