"""`harvester sensitivity`: which tolerance matters, how a quantity scatters, and the yield."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.commands.options import (
    add_study_options,
    read_scene,
    say,
    scene_command,
    study_runner,
)
from harvester.errors import HarvesterError
from harvester.files.plain_text import named

if TYPE_CHECKING:
    from argparse import Namespace

FILES = ("sensitivity.json", "sensitivity.csv", "tornado.png", "distribution.png")


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "sensitivity",
        run,
        "tolerances: which parameter matters (Sobol indices), how a quantity scatters, and yield",
        "harvester sensitivity paper --vary oscillator.cubic_stiffness=±10% "
        "--vary stoppers.gap=normal:2% --above 0.001 --output tolerances",
    )
    command.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="TABLE.KEY=DISTRIBUTION",
        help="±10%%, +-10%%, ±0.5, uniform:LOW:HIGH, normal:5%% or normal:MEAN:SD",
    )
    command.add_argument(
        "--covariance",
        metavar="FILE",
        help="JSON of `harvester identify`: its values scatter as far as records leave them open",
    )
    command.add_argument(
        "--quantity",
        default="mean_power",
        metavar="NAME",
        help="mean_power (default), power_conversion_efficiency, mean_output_power, …",
    )
    command.add_argument(
        "--method",
        metavar="NAME",
        help="an engine or a closure (default: monte-carlo, or circuit where the load needs it)",
    )
    command.add_argument(
        "--above", type=float, metavar="LIMIT", help="also the yield: the share of devices above it"
    )
    command.add_argument(
        "--rows",
        type=int,
        default=64,
        metavar="N",
        help="a power of two (default: 64); N × (parameters + 2) devices are run",
    )
    add_study_options(
        command, "each device's quantity that it is run for, in each of two runs", json=False
    )


def run(options: Namespace) -> None:
    """Carry it out."""
    scene = read_scene(options)
    vary = _distributions(options.vary)
    from harvester.commands.console import show_table
    from harvester.files.writing import in_folder
    from harvester.studies.sensitivity import sensitivity

    for file in FILES if options.output else ():
        in_folder(options.output, file)
    with study_runner(options, "sensitivity") as runner:
        study = sensitivity(
            scene,
            vary,
            covariance=options.covariance,
            quantity=options.quantity,
            method=options.method,
            above=options.above,
            rows=options.rows,
            precision=options.precision,
            runner=runner,
        )
        show_table(study, "sensitivity")
        if options.output:
            _save(study, options.output)
            say(f"written to {options.output}: {', '.join(FILES)}")


def _distributions(texts):
    found = {}
    for text in texts:
        key, separator, distribution = (part.strip() for part in text.partition("="))
        if not separator or not distribution or key in found:
            raise HarvesterError(f"--vary {named(text)}: write it as TABLE.KEY=±10%, each key once")
        found[key] = distribution
    return found


def _save(study, folder):
    from harvester.files.writing import in_folder, write_json, write_text
    from harvester.show import figures
    from harvester.studies.sensitivity import drawing as sensitivity_drawing

    content, table, tornado, distribution = (in_folder(folder, file) for file in FILES)
    write_json(content, study.to_dict())
    write_text(table, study.device_table())
    figures.save(sensitivity_drawing.draw_tornado, study, tornado)
    figures.save(sensitivity_drawing.draw_distribution, study, distribution)
