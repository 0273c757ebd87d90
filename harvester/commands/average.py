"""`harvester average`: stochastic averaging of one scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.commands.options import add_results, checked_scene, deliver, scene_command
from harvester.errors import HarvesterError

if TYPE_CHECKING:
    from argparse import Namespace

CLOSURES = ("fokker_planck", "paper", "consistent")


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "average",
        run,
        "stochastic averaging of one scene",
        "harvester average paper --method consistent",
    )
    command.add_argument(
        "--method",
        default="fokker_planck",
        metavar="NAME",
        help=f"{', '.join(CLOSURES)} (default: fokker_planck)",
    )
    command.add_argument(
        "--tolerance",
        type=float,
        metavar="SHARE",
        help="largest numerical error that is an answer (default: 1e-2; paper, consistent 1e-3)",
    )
    command.add_argument(
        "--fit",
        action="store_true",
        help="of a recorded excitation: fit D and τ1 to its spectrum, and say how far it is",
    )
    command.add_argument(
        "--jump-rates",
        action="store_true",
        help="of several wells: also the rates of jumps between them (two or three times as long)",
    )
    add_results(command)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene, name = checked_scene(options, options.method)
    if options.tolerance is not None and not 0.0 < options.tolerance < 1.0:
        raise HarvesterError(f"--tolerance {options.tolerance:g}: must be a number in (0, 1)")
    from harvester.averaging.of_scene import average

    result = average(
        scene,
        method=options.method,
        tolerance=options.tolerance,
        fit=options.fit,
        jump_rates=options.jump_rates,
    )
    deliver(options, name, result, result.engine)
