"""`harvester validate`: circuit, Monte Carlo and averaging on one scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.commands.options import (
    add_engine_options,
    add_results,
    check_options,
    read_scene,
    say,
    scene_command,
    write_result,
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
    scene = read_scene(options)
    name = f"{scene.name}-validate"
    check_options(options, name)
    from harvester.files.writing import check_writable, is_standard_output, write_text
    from harvester.show.console import progress, show_table
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
    show_table(comparison, "one scene, the same noise", to_stderr=is_standard_output(options.json))
    try:
        write_result(options, name, comparison)
    finally:
        if options.report:
            from harvester.show.page import report

            write_text(options.report, report(comparison))
            say(f"written: {options.report}")
