"""`harvester frequency-response`: amplitude and power over the frequency of a sine."""

from harvester.commands.options import (
    add_engine_options,
    add_results,
    check_options,
    read_scene,
    scene_command,
    write_result,
)
from harvester.errors import HarvesterError


def add(commands):
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
        help="Hz: FIRST:LAST:log:NUMBER, FIRST:LAST:linear:NUMBER, or numbers between commas",
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
        "--engine", default="monte-carlo", help="monte-carlo (default) or circuit", metavar="NAME"
    )
    add_engine_options(command)
    add_results(command)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    check_options(options)
    frequencies = parse(options.frequencies)
    from harvester.console import show_table
    from harvester.response import frequency_response

    response = frequency_response(
        scene,
        frequencies,
        options.engine,
        amplitude=options.amplitude,
        down=options.down,
        step=options.step,
        workers=options.workers,
        time_limit=options.time_limit,
    )
    show_table(response, "frequency response", to_stderr=options.json == "-")
    write_result(options, f"{scene.name}-frequency-response", response, "draw_frequency_response")


def parse(text):
    """Frequencies from their short form.

    Raises
    ------
    HarvesterError
    """
    import numpy as np

    first, *rest = text.split(":")
    try:
        if not rest:
            return [float(number) for number in text.split(",")]
        last, spacing, number = rest
        grid = {"log": np.geomspace, "linear": np.linspace}[spacing]
        low, high, count = float(first), float(last), int(number)
        if 0.0 < low < high and count > 1:
            return grid(low, high, count)
    except (ValueError, KeyError):
        pass
    raise HarvesterError(
        f"--frequencies {text}: write it as 0.1:2:log:40, 0.1:2:linear:40 or 0.1,0.2,0.5"
    )
