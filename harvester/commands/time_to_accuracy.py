"""`harvester time-to-accuracy`: how long every method takes to an error of 10, 3 and 1 %."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    add_overrides,
    add_study_options,
    check_options,
    overrides,
    say,
    study_runner,
)
from harvester.errors import HarvesterError

NAME = "time-to-accuracy"
# Where no scene is named: the source paper's device as it jumps, and one with a rectifier.
SCENES = (
    ("paper", ("excitation.intensity=0.1",)),
    ("device", ("load.netlist=bridge",)),
)


def add(commands: Any) -> None:
    """The command's arguments."""
    text = "how long every method takes to an error of 10, 3 and 1 %%"
    command = commands.add_parser(
        NAME, help=text, description=text, epilog=f"example: harvester {NAME} --output results"
    )
    told = " and ".join(f"{scene} with {', '.join(values)}" for scene, values in SCENES)
    command.add_argument(
        "scenes",
        nargs="*",
        metavar="scene",
        help=f"TOML files or names of built-in scenes (default: {told})",
    )
    add_overrides(command, "every scene")
    command.add_argument(
        "--seconds",
        type=float,
        metavar="SECONDS",
        help="of one core for the run of each method (default: 10): biases are known the better",
    )
    add_study_options(command)
    command.set_defaults(command=run)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    if options.seconds is not None and not options.seconds > 0.0:
        raise HarvesterError(f"--seconds {options.seconds:g}: must be a number > 0")
    scenes = _scenes(options)
    check_options(options, NAME)
    from harvester.commands.console import show_table
    from harvester.files.writing import is_standard_output
    from harvester.verification.accuracy.time_to_accuracy import SECONDS, time_to_accuracy

    with study_runner(options, NAME) as runner:
        results = [
            time_to_accuracy(scene, seconds=options.seconds or SECONDS, runner=runner)
            for scene in scenes
        ]
        for result in results:
            show_table(result, "time to accuracy", to_stderr=is_standard_output(options.json))
        _write(options, results)


def _scenes(options):
    """The scenes named, or those of `SCENES`, with what --set and --seed say."""
    from harvester.scene.model import Scene

    named = [(scene, ()) for scene in options.scenes] or SCENES
    return [Scene.load(scene, [*values, *overrides(options)]) for scene, values in named]


def _write(options, results):
    from harvester.files.writing import in_folder, write_json
    from harvester.show import figures
    from harvester.verification.accuracy import drawing as accuracy_figure

    content = {"results": [result.to_dict() for result in results]}
    if options.json:
        write_json(options.json, content)
    if options.output:
        write_json(in_folder(options.output, f"{NAME}.json"), content)
        picture = in_folder(options.output, f"{NAME}.png")
        figures.save(accuracy_figure.draw, results, picture)
        say(f"written to {options.output}: {NAME}.*")
