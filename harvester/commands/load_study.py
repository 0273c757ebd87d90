"""`harvester load-study`: which load, which values, how much power, how sure."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    NUMBERS_HELP,
    add_engine_options,
    add_study_options,
    check_options,
    number_list,
    read_scene,
    say,
    scene_command,
    study_runner,
)
from harvester.errors import HarvesterError


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "load-study",
        run,
        "loads over a grid of values on the same noise: power, optimum, ranking",
        "harvester load-study device --load bridge --load sece "
        "--sweep load.parameters.resistance=1e4:1e7:log:7 --precision 0.03 --output study",
    )
    command.add_argument(
        "--load",
        action="append",
        default=[],
        metavar="NAME|PATH",
        help="a load of netlists/ or a file; may be given again (default: the scene's own)",
    )
    command.add_argument(
        "--sweep",
        action="append",
        default=[],
        metavar="TABLE.KEY=LIST",
        help=f"{NUMBERS_HELP}; several make a grid",
    )
    command.add_argument(
        "--method",
        default="judged",
        metavar="NAME",
        help="judged (default): monte-carlo, with the circuit on the same noise at the optima and "
        "at places drawn at random; monte-carlo or circuit alone; for a resistor also a closure",
    )
    add_study_options(command, "the output power that every point is run for", json=False)
    add_engine_options(command, workers=False)


def run(options: Namespace) -> int:
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    check_options(options)
    sweeps = _sweeps(options.sweep)
    from harvester.commands.console import show_table
    from harvester.files.tables import xarray_or_say
    from harvester.files.writing import in_folder
    from harvester.studies.loads.study import FILES, TIME_BUDGET, load_study, save

    if options.output:
        xarray_or_say()
        for file in FILES:
            in_folder(options.output, file)
    budget = TIME_BUDGET if options.precision else None
    # Until the files are written: another run's study of the same folder would mix with them.
    with study_runner(options, "load study", budget) as runner:
        study = load_study(
            scene,
            loads=options.load,
            sweeps=sweeps,
            method=options.method,
            precision=options.precision,
            step=options.step,
            runner=runner,
        )
        show_table(study, "load study", alarms=study.alarms())
        if runner.folder is not None:
            written = save(study, runner.folder)
            say(f"written to {options.output}: {', '.join(written)}")
    return 0 if any(e.estimates for e in study.evaluations) else 1


def _sweeps(texts):
    sweeps = {}
    for text in texts:
        key, separator, values = text.partition("=")
        if not separator or key in sweeps:
            raise HarvesterError(f"--sweep {text}: write it as table.key=LIST, each key once")
        sweeps[key.strip()] = number_list(values, f"--sweep {key}")
    return sweeps
