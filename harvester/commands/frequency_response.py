"""`harvester frequency-response`: amplitude and power over the frequency of a sine."""

from harvester.commands.options import (
    NUMBERS_HELP,
    add_engine_options,
    add_results,
    check_options,
    number_list,
    read_scene,
    scene_command,
    write_result,
)


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
        "--engine", default="monte-carlo", help="monte-carlo (default) or circuit", metavar="NAME"
    )
    add_engine_options(command)
    add_results(command)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    name = f"{scene.name}-frequency-response"
    check_options(options, name)
    frequencies = number_list(options.frequencies, "--frequencies")
    from harvester.files.writing import is_standard_output
    from harvester.show.console import show_table
    from harvester.studies.frequency_response import frequency_response

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
    show_table(response, "frequency response", to_stderr=is_standard_output(options.json))
    write_result(options, name, response, "draw_frequency_response")
