"""`harvester simulate`: one scene through one engine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.commands.options import (
    add_engine_options,
    add_keep_going,
    add_results,
    checked_scene,
    deliver,
    scene_command,
)

if TYPE_CHECKING:
    from argparse import Namespace


def add(commands: Any) -> None:
    """The command's arguments."""
    command = scene_command(
        commands,
        "simulate",
        run,
        "run one scene through one engine",
        "harvester simulate paper --method circuit --set excitation.intensity=0.1 --json -",
    )
    command.add_argument(
        "--method", default="circuit", help="circuit (default) or monte-carlo", metavar="NAME"
    )
    command.add_argument(
        "--source",
        default="external",
        metavar="NAME",
        help="circuit only: external (default), or pwl for a source in the netlist with "
        "ngspice's own steps",
    )
    command.add_argument(
        "--device",
        default="automatic",
        metavar="NAME",
        help="circuit only: behavioural elements, one compiled device (the extra `fast`), or "
        "automatic (default): compiled where it is found",
    )
    command.add_argument(
        "--copies",
        type=int,
        metavar="N",
        help="circuit only: realizations side by side in one netlist (default: as many as pay)",
    )
    add_engine_options(command)
    add_keep_going(command)
    add_results(command)


def run(options: Namespace) -> int:
    """Carry it out; returns the exit code, or None for 0."""
    scene, name = checked_scene(options, options.method)
    from harvester.commands.console import progress
    from harvester.simulation.simulate import simulate

    with progress() as follow:
        result = simulate(
            scene,
            method=options.method,
            step=options.step,
            source=options.source,
            device=options.device,
            copies=options.copies,
            keep_going=options.keep_going,
            workers=options.workers,
            time_limit=options.time_limit,
            progress=follow(options.method, scene),
        )
    deliver(options, name, result, result.engine)
    return 0 if result.outcome == "complete" else 1
