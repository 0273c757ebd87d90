"""`harvester optimum`: where one parameter makes power or efficiency largest."""

from harvester.commands.options import (
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
        "optimum",
        run,
        "where one parameter makes the efficiency or the power largest (Eq. 37)",
        "harvester optimum paper --over excitation.intensity",
    )
    command.add_argument("--over", required=True, metavar="TABLE.KEY", help="a number of the scene")
    command.add_argument(
        "--from",
        dest="low",
        type=float,
        metavar="A",
        help="range (default: a tenth of the scene's value)",
    )
    command.add_argument(
        "--to", dest="high", type=float, metavar="B", help="range (default: ten times)"
    )
    command.add_argument(
        "--maximise",
        default="power_conversion_efficiency",
        metavar="QUANTITY",
        help="power_conversion_efficiency (default), mean_power or mean_square_voltage",
    )
    command.add_argument(
        "--engine", default="monte-carlo", help="monte-carlo (default) or circuit", metavar="NAME"
    )
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    add_results(command)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    name = f"{scene.name}-optimum"
    check_options(options, name)
    from harvester.files.writing import is_standard_output
    from harvester.show.console import progress, show_table
    from harvester.studies.optimum import optimum

    with progress() as follow:
        found = optimum(
            scene,
            options.over,
            low=options.low,
            high=options.high,
            maximise=options.maximise,
            engine=options.engine,
            workers=options.workers,
            progress=follow("optimum", None),
        )
    show_table(found, f"optimum over {options.over}", to_stderr=is_standard_output(options.json))
    write_result(options, name, found)
