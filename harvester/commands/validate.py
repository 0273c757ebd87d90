"""`harvester validate`: circuit, Monte Carlo and averaging on one scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.commands.options import (
    add_engine_options,
    add_results,
    checked_scene,
    deliver,
    say,
    scene_command,
)

if TYPE_CHECKING:
    from argparse import Namespace


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "validate",
        run,
        "compare circuit, Monte Carlo and averaging on one scene",
        "harvester validate paper --output results --report paper.html",
    )
    add_engine_options(command)
    add_results(command)
    command.add_argument(
        "--report", metavar="FILE", help="write one self-contained HTML page with everything"
    )


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    scene, name = checked_scene(options, "validate")
    from harvester.commands.console import progress
    from harvester.files.writing import check_writable, write_text
    from harvester.studies.comparison import validate

    check_writable(options.report)

    with progress() as follow:
        comparison = validate(
            scene,
            step=options.step,
            workers=options.workers,
            time_limit=options.time_limit,
            progress=follow("validate", None),
        )
    try:
        deliver(options, name, comparison, "one scene, the same noise")
    finally:
        if options.report:
            from harvester.studies.comparison.report import report

            write_text(options.report, report(comparison))
            say(f"written: {options.report}")
