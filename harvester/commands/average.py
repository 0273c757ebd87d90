"""`harvester average`: stochastic averaging of one scene."""

from harvester.commands.options import (
    add_results,
    check_options,
    read_scene,
    scene_command,
    write_result,
)

CLOSURES = ("paper", "consistent")


def add(commands):
    """The command's arguments."""
    command = scene_command(
        commands,
        "average",
        run,
        "stochastic averaging of one scene",
        "harvester average paper --closure consistent",
    )
    command.add_argument(
        "--closure",
        default="consistent",
        metavar="NAME",
        help=f"{' or '.join(CLOSURES)} (default: consistent)",
    )
    command.add_argument(
        "--fit",
        action="store_true",
        help="of a recorded excitation: fit D and τ1 to its spectrum, and say how far it is",
    )
    add_results(command)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    check_options(options)
    from harvester.averaged import average
    from harvester.console import show_result

    result = average(scene, options.closure, options.fit)
    show_result(result, to_stderr=options.json == "-")
    write_result(options, f"{scene.name}-{options.closure}", result, "draw_result")
