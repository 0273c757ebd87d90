"""`harvester accuracy`: both pictures of every method's error, from one measurement."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    add_study_options,
    checked_scene,
    say,
    scene_command,
    study_runner,
)

PICTURES = ("work-precision", "time-to-accuracy")


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "accuracy",
        run,
        "error of every method: against its run time, and how long it takes to 10, 3 and 1 %%",
        "harvester accuracy paper --output results",
    )
    command.add_argument(
        "--thorough", action="store_true", help="more paths, steps and realizations"
    )
    add_study_options(command)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene, name = checked_scene(options, "accuracy")
    from harvester.commands.console import show_table
    from harvester.files.writing import in_folder, is_standard_output, write_json
    from harvester.show import figures
    from harvester.verification.accuracy.both import accuracy

    with study_runner(options, "accuracy") as runner:
        found = accuracy(scene, thorough=options.thorough, runner=runner)
        pictures = found.work_precision, found.time_to_accuracy
        views: dict[str, Any] = dict(zip(PICTURES, pictures, strict=True))
        for title, view in views.items():
            show_table(view, title.replace("-", " "), to_stderr=is_standard_output(options.json))
        if options.json:
            write_json(options.json, found.to_dict())
        if options.output:
            write_json(in_folder(options.output, f"{name}.json"), found.to_dict())
            for title, view in views.items():
                place = in_folder(options.output, f"{scene.name}-{title}.png")
                figures.write(view.figure(), place)
            say(f"written to {options.output}: {name}.json, {scene.name}-*.png")
