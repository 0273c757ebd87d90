"""`harvester simulate`: one scene through one engine."""

from harvester.commands.options import (
    add_engine_options,
    add_keep_going,
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
        "simulate",
        run,
        "run one scene through one engine",
        "harvester simulate paper --engine circuit --set excitation.intensity=0.1 --json -",
    )
    command.add_argument(
        "--engine", default="circuit", help="circuit (default) or monte-carlo", metavar="NAME"
    )
    command.add_argument(
        "--source",
        default="external",
        metavar="NAME",
        help="circuit only: external (default), or pwl for a source in the netlist with "
        "ngspice's own steps",
    )
    command.add_argument(
        "--device",
        default="automatic",
        metavar="NAME",
        help="circuit only: behavioural elements, one compiled device (the extra `fast`), or "
        "automatic (default): compiled where it is found",
    )
    command.add_argument(
        "--copies",
        type=int,
        metavar="N",
        help="circuit only: realizations side by side in one netlist (default: as many as pay)",
    )
    add_engine_options(command)
    add_keep_going(command)
    add_results(command)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    name = f"{scene.name}-{options.engine}"
    check_options(options, name)
    from harvester.files.writing import is_standard_output
    from harvester.show.console import progress, show_result
    from harvester.simulation import simulate

    with progress() as follow:
        result = simulate(
            scene,
            options.engine,
            step=options.step,
            source=options.source,
            device=options.device,
            copies=options.copies,
            keep_going=options.keep_going,
            workers=options.workers,
            time_limit=options.time_limit,
            progress=follow(options.engine, scene),
        )
    show_result(result, to_stderr=is_standard_output(options.json))
    write_result(options, name, result, "draw_result")
    return 0 if result.outcome == "complete" else 1
