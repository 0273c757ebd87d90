"""What several commands share: arguments, the scene they name, the files they write."""

from __future__ import annotations

import contextlib
import importlib.util
import math
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from harvester.commands.quiet import is_quiet
from harvester.errors import HarvesterError
from harvester.files.plain_text import named, one_line

if TYPE_CHECKING:
    from harvester.commands.shown import Shown
    from harvester.running.runner import Runner
    from harvester.scene.model import Scene

STEP_HELP = "default, fine, finest, or the longest step in seconds"
# Of a list given by its ends.
MOST_NUMBERS = 100_000
RESULT_FILES = (".json", "-densities.csv", ".png", "-joint.png", ".csv", ".nc", ".md")
NUMBERS_HELP = "FIRST:LAST:log:NUMBER, FIRST:LAST:linear:NUMBER, or numbers between commas"


def scene_command(
    commands: Any,
    name: str,
    function: Callable,
    text: str,
    example: str,
    default_scene: str | None = None,
) -> ArgumentParser:
    """A command about one scene, with its overrides; returns its parser."""
    command = commands.add_parser(name, help=text, description=text, epilog=f"example: {example}")
    optional = {"nargs": "?", "default": default_scene} if default_scene else {}
    command.add_argument(
        "scene",
        help="a TOML file or the name of a built-in scene"
        + (f" (default: {default_scene})" if default_scene else ""),
        **optional,
    )
    add_overrides(command)
    command.set_defaults(command=function)
    return command


def add_overrides(command: ArgumentParser, of: str = "the scene") -> None:
    """What is changed of a scene: what `overrides` reads."""
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help=f"override a value of {of}; TABLE=none removes a table",
    )
    command.add_argument("--seed", type=int, help="same as --set run.seed=SEED")


def overrides(options: Namespace) -> list[str]:
    """What --set and --seed say."""
    return [*options.set, *([] if options.seed is None else [f"run.seed={options.seed}"])]


def add_engine_options(command: ArgumentParser, workers: bool = True) -> None:
    """Step, workers and time limit of a simulation; `add_study_options` has workers of its own."""
    command.add_argument("--step", default="default", help=STEP_HELP)
    if workers:
        _add_workers(command)
    command.add_argument(
        "--time-limit",
        type=float,
        default=3600.0,
        metavar="SECONDS",
        help="wall-clock limit of one realization (default: 3600)",
    )


def add_study_options(
    command: ArgumentParser,
    of_precision: str | None = None,
    output: str | None = None,
    json: bool = True,
) -> None:
    """What runs a study and keeps its answers: what `study_runner` reads.

    Parameters
    ----------
    command : argparse.ArgumentParser
    of_precision : str or None
        What --precision is the relative standard error of; None: there is no such option.
    output : str or None
        Default of --output.
    json : bool
        Whether there is --json too.
    """
    if json:
        _add_json(command)
    if of_precision:
        command.add_argument(
            "--precision",
            type=float,
            metavar="SHARE",
            help=f"relative standard error of {of_precision}",
        )
    command.add_argument(
        "--time-budget",
        type=float,
        metavar="SECONDS",
        help="begin nothing new after it; the same command goes on",
    )
    _add_workers(command)
    command.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster, instead of processes here"
    )
    command.add_argument(
        "--output",
        default=output,
        metavar="DIR",
        help="folder for results, and for every finished piece: run the same command again to go "
        "on after a kill" + (f" (default: {output})" if output else ""),
    )


def _add_workers(command):
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")


def _add_json(command):
    command.add_argument("--json", metavar="FILE", help="write JSON; - for standard output")


@contextlib.contextmanager
def study_runner(
    options: Namespace, label: str | None, time_budget: float | None = None
) -> Iterator[Runner]:
    """The runner that a command's options say, open within a block.

    At its end standard error is told what the study should be asked again for.

    Parameters
    ----------
    options : argparse.Namespace
        Of a command with `add_study_options`.
    label : str or None
        Of the progress shown; None: the study shows its own.
    time_budget : float or None
        Where the options have none.
    """
    from harvester.commands.console import progress
    from harvester.running import open_runner
    from harvester.simulation.simulate import TIME_LIMIT

    if options.output:
        options.kept_when_interrupted = "what is finished is kept: the same command goes on"
    budget = options.time_budget if options.time_budget is not None else time_budget
    with (
        progress() as follow,
        open_runner(
            options.output,
            workers=options.workers,
            scheduler=options.scheduler,
            time_budget=budget,
            time_limit=getattr(options, "time_limit", TIME_LIMIT),
            progress=follow(label, None) if label else None,
        ) as runner,
    ):
        yield runner
        for line in runner.warnings:
            complain(line)
        if runner.out_of_time:
            complain("the time budget was spent: the same command goes on where it ended")


def add_keep_going(command: ArgumentParser) -> None:
    """Whether a failed realization ends the run."""
    command.add_argument(
        "--keep-going",
        action="store_true",
        help="try a realization that crashes or runs out of time once more, and go on without it",
    )


def add_results(command: ArgumentParser) -> None:
    """Where the result is written."""
    _add_json(command)
    command.add_argument("--output", metavar="DIR", help="folder for JSON and figure")


def read_scene(options: Namespace) -> Scene:
    """The scene that the command line names, overrides and seed put in."""
    from harvester.scene.model import Scene

    return Scene.load(options.scene, overrides(options))


def number_list(text: str, where: str) -> list[float]:
    """Numbers from their short form: 0.1:2:log:40, 0.1:2:linear:40 or 0.1,0.2,0.5.

    Raises
    ------
    HarvesterError
        Says `where`, the option.
    """
    import numpy as np

    first, *rest = text.split(":")
    try:
        if not rest:
            return [float(number) for number in text.split(",")]
        last, spacing, number = rest
        grid: Any = {"log": np.geomspace, "linear": np.linspace}[spacing]
        low, high, count = float(first), float(last), int(number)
        if 0.0 < low < high < math.inf and 1 < count <= MOST_NUMBERS:
            return [float(number) for number in grid(low, high, count)]
    except (ValueError, KeyError):
        pass
    raise HarvesterError(
        f"{where} {named(text)}: write it as 0.1:2:log:40, 0.1:2:linear:40 or 0.1,0.2,0.5"
    )


def check_options(options: Namespace, name: str | None = None) -> None:
    """Refuse numbers out of range, and places that cannot be written, before anything runs.

    `name` is that of the files which `write_result` will write.
    """
    from harvester.arguments import check_limits
    from harvester.files.writing import check_folder, check_writable, in_folder

    check_limits(getattr(options, "workers", None), getattr(options, "time_limit", 1.0))
    if getattr(options, "json", None):
        check_writable(options.json)
    if options.output:
        check_folder(options.output)
        for ending in RESULT_FILES if name else ():
            in_folder(options.output, f"{name}{ending}")


def checked_scene(options: Namespace, kind: str) -> tuple[Scene, str]:
    """The scene that the command line names, and the name of its files; see `check_options`."""
    scene = read_scene(options)
    name = f"{scene.name}-{kind}"
    check_options(options, name)
    return scene, name


def deliver(options: Namespace, name: str, content: Shown, title: str) -> None:
    """Show a result, and write the files that were asked for."""
    from harvester.commands.console import show_table
    from harvester.files.writing import is_standard_output

    show_table(content, title, to_stderr=is_standard_output(options.json))
    write_result(options, name, content)


def write_result(options: Namespace, name: str, content: Shown) -> None:
    """The files that were asked for.

    JSON, with `data()` of the content CSV, with its `to_xarray()` beside that NetCDF, its figure,
    with `joint_figure()` that of displacement and velocity together, with `markdown()` a page.
    """
    from harvester.files.writing import write_json

    # Where one place turns out to be full, the other still gets the result.
    try:
        if options.json:
            write_json(options.json, content.to_dict())
    finally:
        if options.output:
            _write_folder(options.output, name, content)


def _write_folder(folder: str, name: str, content: Shown) -> None:
    from harvester.files.tables import write_csv, write_netcdf
    from harvester.files.writing import in_folder, write_json, write_text
    from harvester.show import figures

    places = [in_folder(folder, f"{name}{ending}") for ending in RESULT_FILES]
    json_file, densities, picture, joint_picture, table, grid, page = places
    write_json(json_file, content.to_dict())
    if hasattr(content, "density_table"):
        write_text(densities, content.density_table())
    if hasattr(content, "data"):
        write_csv(table, *content.data())
        # An extra: what is in it is in the others too.
        if hasattr(content, "to_xarray") and importlib.util.find_spec("xarray"):
            write_netcdf(grid, content.to_xarray())
    if hasattr(content, "markdown"):
        write_text(page, content.markdown())
    figure = content.figure()
    if figure is not None:
        figures.write(figure, picture)
    joint = content.joint_figure() if hasattr(content, "joint_figure") else None
    if joint is not None:
        figures.write(joint, joint_picture)
    several = figure is not None or hasattr(content, "markdown")
    say(f"written to {folder}: {name}.{'*' if several else 'json'}")


def say(text: object) -> None:
    """One line on standard error, unless the command line is quiet."""
    if not is_quiet():
        print(one_line(text), file=sys.stderr)


def complain(text: HarvesterError | str) -> None:
    """One line on standard error on what went wrong."""
    print(f"harvester: {one_line(text)}", file=sys.stderr)
