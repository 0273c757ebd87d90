"""`harvester reproduce`: the paper's figures by closures, Monte Carlo and circuit."""

from harvester.commands.options import check_options, say
from harvester.errors import HarvesterError


def add(commands):
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
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    command.add_argument(
        "--output", default="results", metavar="DIR", help="folder (default: results)"
    )
    command.set_defaults(command=run, json=None)


def run(options):
    """Carry it out; returns the exit code, or None for 0."""
    from harvester.verification.paper.figures_list import FIGURES

    names = _chosen(options.figures, ["fig2", "fig3", *FIGURES])
    for name in names:
        check_options(options, name)
    from harvester.scene.model import Scene
    from harvester.show.console import show_table

    scene = Scene.load("paper")
    if options.seed is not None:
        scene = scene.replace({"run.seed": options.seed})
    finished = {}

    def keep(content):
        _write(content, options.output)
        finished[content.name] = content
        kept = f"finished figures are in {options.output}: {', '.join(finished)}"
        options.kept_when_interrupted = kept

    try:
        failed_runs = _compute(scene, names, options, keep)
    finally:
        for name in (name for name in names if name in finished):
            show_table(finished[name], f"the paper's {name}")
    return 1 if failed_runs else 0


def _compute(scene, names, options, keep):
    """Give `keep` each figure as soon as it is done; the number of runs that failed."""
    from harvester.engines.workers import WorkerPool
    from harvester.show.console import progress
    from harvester.verification.paper import orbit_maps
    from harvester.verification.paper.figures_list import FIGURES
    from harvester.verification.paper.reproduce import reproduce

    without_noise = {"fig2": orbit_maps.surfaces, "fig3": orbit_maps.frequency_response}
    for name in (name for name in names if name in without_noise):
        keep(without_noise[name](scene))
    swept = [name for name in names if name in FIGURES]
    if not swept:
        return 0
    with progress() as follow, WorkerPool(workers=options.workers) as pool:
        share = follow("figures", None)
        contents = reproduce(
            scene, swept, quick=options.quick, pool=pool, progress=share, on_figure=keep
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


def _write(content, folder):
    from harvester.files.writing import in_folder, write_json
    from harvester.show import figures
    from harvester.verification.paper.drawing import draw

    write_json(in_folder(folder, f"{content.name}.json"), content.to_dict())
    figures.save(draw, content, in_folder(folder, f"{content.name}.png"))
    say(f"written to {folder}: {content.name}.*")
