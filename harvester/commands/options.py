"""What several commands share: arguments, the scene they name, the files they write."""

import math
import sys

from harvester.errors import HarvesterError
from harvester.files.plain_text import named, one_line
from harvester.show.quiet import is_quiet

STEP_HELP = "default, fine, finest, or the longest step in seconds"
# Of a list given by its ends.
MOST_NUMBERS = 100_000
RESULT_FILES = (".json", "-densities.csv", ".png")
NUMBERS_HELP = "FIRST:LAST:log:NUMBER, FIRST:LAST:linear:NUMBER, or numbers between commas"


def scene_command(commands, name, function, text, example, default_scene=None):
    """A command about one scene, with its overrides; returns its parser."""
    command = commands.add_parser(name, help=text, description=text, epilog=f"example: {example}")
    optional = {"nargs": "?", "default": default_scene} if default_scene else {}
    command.add_argument(
        "scene",
        help="a TOML file or the name of a built-in scene"
        + (f" (default: {default_scene})" if default_scene else ""),
        **optional,
    )
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help="override a value of the scene; TABLE=none removes a table",
    )
    command.add_argument("--seed", type=int, help="same as --set run.seed=SEED")
    command.set_defaults(command=function)
    return command


def add_engine_options(command):
    """Step, workers and time limit of a simulation."""
    command.add_argument("--step", default="default", help=STEP_HELP)
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    command.add_argument(
        "--time-limit",
        type=float,
        default=3600.0,
        metavar="SECONDS",
        help="wall-clock limit of one realization (default: 3600)",
    )


def add_keep_going(command):
    """Whether a failed realization ends the run."""
    command.add_argument(
        "--keep-going",
        action="store_true",
        help="try a realization that crashes or runs out of time once more, and go on without it",
    )


def add_results(command):
    """Where the result is written."""
    command.add_argument("--json", metavar="FILE", help="write JSON; - for standard output")
    command.add_argument("--output", metavar="DIR", help="folder for JSON and figure")


def read_scene(options):
    """The scene that the command line names, overrides and seed put in."""
    from harvester.scene.model import Scene

    overrides = list(options.set)
    if options.seed is not None:
        overrides.append(f"run.seed={options.seed}")
    return Scene.load(options.scene, overrides)


def number_list(text, where):
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
        grid = {"log": np.geomspace, "linear": np.linspace}[spacing]
        low, high, count = float(first), float(last), int(number)
        if 0.0 < low < high < math.inf and 1 < count <= MOST_NUMBERS:
            return [float(number) for number in grid(low, high, count)]
    except (ValueError, KeyError):
        pass
    raise HarvesterError(
        f"{where} {named(text)}: write it as 0.1:2:log:40, 0.1:2:linear:40 or 0.1,0.2,0.5"
    )


def check_options(options, name=None):
    """Refuse numbers out of range, and places that cannot be written, before anything runs.

    `name` is that of the files which `write_result` will write.
    """
    from harvester.files.writing import check_folder, check_writable, in_folder

    if getattr(options, "workers", None) is not None and options.workers < 1:
        raise HarvesterError(f"--workers {options.workers}: must be a whole number ≥ 1")
    limit = getattr(options, "time_limit", 1.0)
    if not limit > 0.0:
        raise HarvesterError(f"--time-limit {limit:g}: must be a number > 0")
    if options.json:
        check_writable(options.json)
    if options.output:
        check_folder(options.output)
        for ending in RESULT_FILES if name else ():
            in_folder(options.output, f"{name}{ending}")


def write_result(options, name, result, draw=None):
    """The files that were asked for; `draw` names the function of `figures`, if there is one."""
    from harvester.files.writing import write_json

    # Where one place turns out to be full, the other still gets the result.
    try:
        if options.json:
            write_json(options.json, result.to_dict())
    finally:
        if options.output:
            _write_folder(options.output, name, result, draw)


def _write_folder(folder, name, result, draw):
    from harvester.files.writing import in_folder, write_json, write_text
    from harvester.show import figures

    json_file, table, picture = (in_folder(folder, f"{name}{e}") for e in RESULT_FILES)
    write_json(json_file, result.to_dict())
    if hasattr(result, "density_table"):
        write_text(table, result.density_table())
    if draw:
        figures.save(getattr(figures, draw), result, picture)
    say(f"written to {folder}: {name}.{'*' if draw else 'json'}")


def say(text):
    """One line on standard error, unless the command line is quiet."""
    if not is_quiet():
        print(one_line(text), file=sys.stderr)


def complain(text):
    """One line on standard error on what went wrong."""
    print(f"harvester: {one_line(text)}", file=sys.stderr)
