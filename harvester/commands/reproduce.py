"""`harvester reproduce`: the paper's figures by closures, Monte Carlo and circuit."""

from argparse import Namespace
from typing import Any

from harvester.commands.options import (
    add_study_options,
    check_options,
    study_runner,
    write_result,
)
from harvester.errors import HarvesterError


def add(commands: Any) -> None:
    """The command's arguments."""
    command = commands.add_parser(
        "reproduce",
        help="the paper's figures, computed again",
        description="the paper's figures by averaging, Monte Carlo and circuit; one PNG and one "
        "JSON each, written as soon as the figure is done",
        epilog="example: harvester reproduce fig6 fig9 --quick --output results",
    )
    command.add_argument(
        "figures", nargs="*", default=["all"], metavar="FIGURE", help="fig2 … fig10, or all"
    )
    command.add_argument(
        "--quick",
        action="store_true",
        help="all figures in minutes: fewer points, error bars up to 5 %% (circuit: more)",
    )
    command.add_argument("--seed", type=int, help="of the noise (default: the scene's)")
    add_study_options(
        command, "E[V²] and PCE that simulations are run for", output="results", json=False
    )
    command.set_defaults(command=run, json=None)


def run(options: Namespace) -> int:
    """Carry it out; returns the exit code, or None for 0."""
    from harvester.verification.paper.figures_list import FIGURES

    names = _chosen(options.figures, ["fig2", "fig3", *FIGURES])
    for name in names:
        check_options(options, name)
    from harvester.commands.console import show_table
    from harvester.scene.model import Scene

    scene = Scene.load("paper")
    if options.seed is not None:
        scene = scene.replace({"run.seed": options.seed})
    finished = {}

    def keep(content):
        write_result(options, content.name, content)
        finished[content.name] = content
        kept = f"finished figures are in {options.output}: {', '.join(finished)}"
        options.kept_when_interrupted = f"{kept}; the same command goes on"

    try:
        failed_runs = _compute(scene, names, options, keep)
    finally:
        for name in (name for name in names if name in finished):
            show_table(finished[name], f"the paper's {name}")
    return 1 if failed_runs else 0


def _compute(scene, names, options, keep):
    """Give `keep` each figure as soon as it is done; the number of runs that failed."""
    from harvester.verification.paper import orbit_maps
    from harvester.verification.paper.figures_list import FIGURES
    from harvester.verification.paper.reproduce import reproduce

    without_noise = {"fig2": orbit_maps.surfaces, "fig3": orbit_maps.orbit_voltages}
    with study_runner(options, "figures") as runner:
        for name in (name for name in names if name in without_noise):
            keep(without_noise[name](scene))
        contents = reproduce(
            scene,
            [name for name in names if name in FIGURES],
            quick=options.quick,
            precision=options.precision,
            runner=runner,
            on_figure=keep,
        )
    return sum(content.failed_runs for content in contents)


def _chosen(wanted, known):
    """Names of figures in the paper's order."""
    from harvester.files.plain_text import nearest

    for name in wanted:
        if name not in (*known, "all"):
            raise HarvesterError(
                f"{name}: no such figure{nearest(name, known)}; there are {', '.join(known)}, all"
            )
    return [name for name in known if name in wanted or "all" in wanted]
