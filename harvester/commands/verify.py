"""`harvester verify`: exact and published results beside this project's."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    add_study_options,
    check_options,
    deliver,
    say,
    study_runner,
)


def add(commands: Any) -> None:
    """The command's arguments."""
    command = commands.add_parser(
        "verify",
        help="exact and published results beside this project's",
        description="closed forms, limits, published powers and other integrators beside the "
        "circuit, Monte Carlo and the stationary solver; exit code 1 where one disagrees",
        epilog="example: harvester verify --output results",
    )
    add_study_options(command)
    command.set_defaults(command=run)


def run(options: Namespace) -> int:
    """Carry it out; returns the exit code."""
    check_options(options, "verify")
    from harvester.files.writing import in_folder, write_text

    if options.output:
        in_folder(options.output, "verify.md")
    from harvester.verification.known_results.truth import verify

    with study_runner(options, "verify") as runner:
        found = verify(runner=runner)
        deliver(options, "verify", found, "known results")
        if options.output:
            write_text(in_folder(options.output, "verify.md"), found.markdown())
            say(f"written to {options.output}: verify.md")
    return 1 if found.failed else 0
