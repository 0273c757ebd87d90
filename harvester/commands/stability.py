"""`harvester stability`: stiff and extreme variations of one scene, judged."""

from harvester.commands.options import (
    STEP_HELP,
    add_results,
    check_options,
    read_scene,
    scene_command,
    write_result,
)


def add(commands):
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
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    add_results(command)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    name = f"{scene.name}-stability"
    check_options(options, name)
    from harvester.files.writing import is_standard_output
    from harvester.show.console import progress, show_table
    from harvester.verification.stability.matrix import stability

    with progress() as follow:
        matrix = stability(
            scene,
            step=options.step,
            workers=options.workers,
            progress=follow("stability", None),
        )
    show_table(matrix, "stiff and extreme cases", to_stderr=is_standard_output(options.json))
    write_result(options, name, matrix, "draw_stability")
    return 1 if matrix.wrong else 0
