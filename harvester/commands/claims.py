"""`harvester claims`: the paper's statements, judged."""

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
        "claims",
        help="the paper's statements on trends, judged",
        description="judge every statement of the paper on trends by Monte Carlo, by the circuit "
        "and by each closure; in the folder of `reproduce` its simulations are found",
        epilog="example: harvester claims --output results",
    )
    command.add_argument("--seed", type=int, help="of the noise (default: the scene's)")
    command.add_argument(
        "--thorough", action="store_true", help="longer runs, the circuit at every condition"
    )
    add_study_options(command)
    command.set_defaults(command=run)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    check_options(options, "claims")
    from harvester.scene.model import Scene
    from harvester.verification.paper.claims import claims

    scene = Scene.load("paper")
    if options.seed is not None:
        scene = scene.replace({"run.seed": options.seed})
    with study_runner(options, "claims") as runner:
        judgement = claims(scene, thorough=options.thorough, runner=runner)
        deliver(options, "claims", judgement, "the paper's statements")
