"""`harvester stability`: stiff and extreme variations of one scene, judged."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    STEP_HELP,
    add_study_options,
    check_options,
    read_scene,
    scene_command,
    study_runner,
    tell_of,
    write_result,
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
    command.add_argument("--json", metavar="FILE", help="write JSON; - for standard output")
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
    scene = read_scene(options)
    name = f"{scene.name}-stability"
    check_options(options, name)
    from harvester.files.writing import is_standard_output
    from harvester.show.console import progress, show_table
    from harvester.verification.stability.matrix import stability

    with progress() as follow, study_runner(options, follow("stability", None)) as runner:
        matrix = stability(scene, step=options.step, runner=runner)
        tell_of(runner)
        show_table(matrix, "stiff and extreme cases", to_stderr=is_standard_output(options.json))
        write_result(options, name, matrix)
    return 1 if matrix.wrong else 0
