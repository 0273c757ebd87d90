"""`harvester optimum`: where one parameter, or several, make power or efficiency largest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.commands.options import (
    add_study_options,
    checked_scene,
    deliver,
    scene_command,
    study_runner,
)
from harvester.errors import HarvesterError
from harvester.files.plain_text import named

if TYPE_CHECKING:
    from argparse import Namespace


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "optimum",
        run,
        "where one parameter, or several, make the efficiency or the power largest (Eq. 37)",
        "harvester optimum device --maximise mean_power --over load.resistance=1e4:1e7 "
        "--over oscillator.linear_stiffness=-100:-20",
    )
    command.add_argument(
        "--over",
        action="append",
        default=[],
        required=True,
        metavar="TABLE.KEY[=LOW:HIGH]",
        help="a number of the scene and its range (default: a tenth to ten times its value); "
        "may be given again",
    )
    command.add_argument(
        "--from", dest="low", type=float, metavar="A", help="range of a single --over"
    )
    command.add_argument("--to", dest="high", type=float, metavar="B", help="its upper end")
    command.add_argument(
        "--maximise",
        default="power_conversion_efficiency",
        metavar="QUANTITY",
        help="power_conversion_efficiency (default), mean_power or mean_square_voltage; of a load "
        "with an output also mean_output_power and the like; over several parameters any",
    )
    command.add_argument(
        "--method",
        metavar="NAME",
        help="monte-carlo or circuit, over several parameters also a closure (default: "
        "monte-carlo, or circuit where the load needs it)",
    )
    command.add_argument(
        "--closure",
        metavar="NAME",
        help="that stands beside simulation, over one parameter (default: the most accurate)",
    )
    command.add_argument(
        "--evaluations",
        type=int,
        metavar="N",
        help="places proposed, over several parameters (default: 60 for each)",
    )
    add_study_options(command, "the value at the optimum of several parameters")


def run(options: Namespace) -> None:
    """Carry it out."""
    scene, name = checked_scene(options, "optimum")
    over = _ranges(options)
    from harvester.commands.console import progress
    from harvester.studies.optimum import optimum

    with progress() as follow, study_runner(options, None) as runner:
        found = optimum(
            scene,
            over,
            maximise=options.maximise,
            method=options.method,
            closure=options.closure,
            evaluations=options.evaluations,
            precision=options.precision,
            runner=runner,
            progress=follow("optimum", None),
        )
        deliver(options, name, found, f"optimum over {', '.join(over)}")


def _ranges(options):
    """Keys to ranges, ends that were not given None."""
    over = {}
    for text in options.over:
        key, separator, ends = (part.strip() for part in text.partition("="))
        if key in over:
            raise HarvesterError(f"--over {named(key)}: is there twice")
        over[key] = _ends(text, ends) if separator else (None, None)
    if options.low is not None or options.high is not None:
        ((key, ends),) = list(over.items())[:1]
        if len(over) > 1 or ends != (None, None):
            raise HarvesterError(
                "--from and --to: are the range of a single --over TABLE.KEY; else write "
                "--over TABLE.KEY=LOW:HIGH"
            )
        over[key] = options.low, options.high
    return over


def _ends(text, ends):
    try:
        low, high = (float(number) for number in ends.split(":"))
    except ValueError:
        raise HarvesterError(
            f"--over {named(text)}: write it as TABLE.KEY=LOW:HIGH, such as load.resistance=1e4:1e7"
        ) from None
    return low, high
