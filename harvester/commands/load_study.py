"""`harvester load-study`: which load, which values, how much power, how sure."""

import contextlib

from harvester.commands.options import (
    NUMBERS_HELP,
    add_engine_options,
    number_list,
    read_scene,
    say,
    scene_command,
)
from harvester.errors import HarvesterError


def add(commands):
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
        "--engine",
        default="circuit",
        metavar="NAME",
        help="circuit (default); where the load is a resistor also monte-carlo or a closure",
    )
    command.add_argument(
        "--precision",
        type=float,
        metavar="SHARE",
        help="relative standard error of the output power that every point is run for",
    )
    command.add_argument(
        "--time-budget",
        type=float,
        metavar="SECONDS",
        help="begin nothing new after it (default with --precision: 540); run again to go on",
    )
    command.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster")
    command.add_argument(
        "--output",
        metavar="DIR",
        help="folder for NetCDF, CSV and figures, and for every finished piece: run the same "
        "command again to go on after a kill",
    )
    add_engine_options(command)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    scene = read_scene(options)
    _check(options)
    sweeps = _sweeps(options.sweep)
    from harvester.files.writing import in_folder
    from harvester.show.console import progress, show_table
    from harvester.studies import Report, load_study, save
    from harvester.studies.dataset import xarray_or_say
    from harvester.studies.files import FILES

    if options.output:
        xarray_or_say()
        for file in FILES:
            in_folder(options.output, file)
        options.kept_when_interrupted = "finished pieces are kept: the same command goes on"
    # Until the files are written: another run's study of the same folder would mix with them.
    with _folder(options.output) as folder:
        with _executor(options.scheduler) as executor, progress() as follow:
            study = load_study(
                scene,
                options.load,
                sweeps,
                engine=options.engine,
                precision=options.precision,
                time_budget=options.time_budget,
                step=options.step,
                output=folder,
                workers=options.workers,
                executor=executor,
                time_limit=options.time_limit,
                progress=follow("load study", None),
            )
        report = Report(study)
        show_table(report, "load study")
        if options.output:
            written = save(report, folder)
            say(f"written to {options.output}: {', '.join(written)}")
    return 0 if any(e.estimates for e in study.evaluations) else 1


def _check(options):
    """Refuse numbers out of range before anything runs."""
    if options.workers is not None and options.workers < 1:
        raise HarvesterError(f"--workers {options.workers}: must be a whole number ≥ 1")
    if not options.time_limit > 0.0:
        raise HarvesterError(f"--time-limit {options.time_limit:g}: must be a number > 0")


def _sweeps(texts):
    sweeps = {}
    for text in texts:
        key, separator, values = text.partition("=")
        if not separator or key in sweeps:
            raise HarvesterError(f"--sweep {text}: write it as table.key=LIST, each key once")
        sweeps[key.strip()] = number_list(values, f"--sweep {key}")
    return sweeps


def _folder(path):
    """The study's folder, held from its first use on, or nothing."""
    from harvester.studies.folder import StudyFolder

    return contextlib.closing(StudyFolder(path)) if path else contextlib.nullcontext()


def _executor(scheduler):
    """Dask's executor, or nothing."""
    if scheduler is None:
        return contextlib.nullcontext()
    try:
        from distributed import Client
    except ImportError:
        raise HarvesterError("--scheduler needs Dask: pip install 'harvester[cluster]'") from None
    try:
        return Client(scheduler, timeout="10s").get_executor()
    except (OSError, ValueError) as error:
        raise HarvesterError(f"--scheduler {scheduler}: {error}") from None
