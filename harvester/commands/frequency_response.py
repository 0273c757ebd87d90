"""`harvester frequency-response`: amplitude and power over the frequency of a sine."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    NUMBERS_HELP,
    add_engine_options,
    add_study_options,
    checked_scene,
    deliver,
    number_list,
    scene_command,
    study_runner,
)


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "frequency-response",
        run,
        "amplitude, voltage and power over the frequency of a sine",
        "harvester frequency-response device --amplitude 4 --frequencies 5:30:linear:51 --down",
    )
    command.add_argument(
        "--frequencies",
        required=True,
        metavar="LIST",
        help=f"Hz: {NUMBERS_HELP}",
    )
    command.add_argument(
        "--amplitude",
        type=float,
        metavar="A",
        help="of the base acceleration, m/s² in SI (default: that of the scene's own sine)",
    )
    command.add_argument(
        "--down", action="store_true", help="sweep down as well, to show hysteresis"
    )
    command.add_argument(
        "--method", default="monte-carlo", help="monte-carlo (default) or circuit", metavar="NAME"
    )
    add_engine_options(command, workers=False)
    add_study_options(command)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene, name = checked_scene(options, "frequency-response")
    frequencies = number_list(options.frequencies, "--frequencies")
    from harvester.studies.frequency_response import frequency_response

    with study_runner(options, "frequency response") as runner:
        response = frequency_response(
            scene,
            frequencies,
            method=options.method,
            amplitude=options.amplitude,
            down=options.down,
            step=options.step,
            runner=runner,
        )
        deliver(options, name, response, "frequency response")
