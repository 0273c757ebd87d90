"""`harvester average`: stochastic averaging of one scene."""

from harvester.commands.options import (
    add_results,
    check_options,
    read_scene,
    scene_command,
    write_result,
)
from harvester.errors import HarvesterError

CLOSURES = ("paper", "consistent", "slow_load", "fokker_planck")


def add(commands):
    """The command's arguments."""
    command = scene_command(
        commands,
        "average",
        run,
        "stochastic averaging of one scene",
        "harvester average paper --closure slow_load",
    )
    command.add_argument(
        "--closure",
        default="slow_load",
        metavar="NAME",
        help=f"{', '.join(CLOSURES)} (default: slow_load)",
    )
    command.add_argument(
        "--tolerance",
        type=float,
        metavar="SHARE",
        help="largest numerical error that is an answer (default: 1e-3, fokker_planck 2e-2)",
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
    name = f"{scene.name}-{options.closure}"
    check_options(options, name)
    if options.tolerance is not None and not 0.0 < options.tolerance < 1.0:
        raise HarvesterError(f"--tolerance {options.tolerance:g}: must be a number in (0, 1)")
    from harvester.averaging.of_scene import average
    from harvester.files.writing import is_standard_output
    from harvester.show.console import show_result

    result = average(scene, options.closure, options.tolerance, options.fit)
    show_result(result, to_stderr=is_standard_output(options.json))
    write_result(options, name, result, "draw_result")
