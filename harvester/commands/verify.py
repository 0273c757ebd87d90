"""`harvester verify`: exact and published results beside this project's."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    add_study_options,
    check_options,
    deliver,
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
    from harvester.verification.known_results.truth import verify

    with study_runner(options, "verify") as runner:
        found = verify(runner=runner)
        deliver(options, "verify", found, "known results")
    return 1 if found.failed else 0
