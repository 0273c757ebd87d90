"""Commands that judge the program: known results, accuracy, stiff cases, the source paper.

Each imports its study when it is called, since the help of a command must not import numba.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Unpack

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import nearest
from harvester.base.signatures import (
    Kind,
    RunnerOptions,
    Seed,
    Share,
    Step,
)
from harvester.cli.output import check_places, result_files, show, study_runner, write_result
from harvester.cli.parsing import overrides_of

if TYPE_CHECKING:
    from harvester.scene.calling import SceneOrName
    from harvester.validation.accuracy import Accuracy
    from harvester.validation.claims import Judgement
    from harvester.validation.stability import StabilityMatrix
    from harvester.validation.verify import Verification


def verify(**running: Unpack[RunnerOptions]) -> Verification:
    """Exact and published results beside this project's.

    Closed forms, limits, published powers and other integrators stand beside the circuit, Monte
    Carlo and the stationary solver; exit code 1 where one disagrees.
    """
    from harvester.validation.verify import verify

    return verify(**running)


def stability(
    scene: SceneOrName = "paper", *, step: Step = "default", **running: Unpack[RunnerOptions]
) -> StabilityMatrix:
    """Judge stiff and extreme variations of one scene; exit code 1 where one is wrong.

    Parameters
    ----------
    scene : Scene, str or Path
    step : str or float
        default, fine, finest, or the longest step in seconds.
    time_limit : float
        Wall-clock limit of one case by one method (default: 120).
    """
    from harvester.validation.stability import stability

    return stability(scene, step=step, **running)


def accuracy(
    scene: SceneOrName, *, thorough: bool = False, **running: Unpack[RunnerOptions]
) -> Accuracy:
    """Error of every method: against its run time, and how long it takes to 10, 3 and 1 %.

    Parameters
    ----------
    scene : Scene, str or Path
    thorough : bool
        More paths, steps and realizations.
    """
    from harvester.validation.accuracy import accuracy

    return accuracy(scene, thorough=thorough, **running)


def claims(
    *, seed: Seed | None = None, thorough: bool = False, **running: Unpack[RunnerOptions]
) -> Judgement:
    """The paper's statements on trends, judged.

    Every statement is judged by Monte Carlo, by the circuit and by each closure; in the folder of
    `reproduce` its simulations are found.

    Parameters
    ----------
    seed : int or None
        Seed of the noise (default: the scene's).
    thorough : bool
        Longer runs, the circuit at every condition.
    """
    from harvester.validation.claims import claims

    return claims(_paper(seed), thorough=thorough, **running)


def reproduce(
    figures: Annotated[Sequence[str], Kind("FIGURE")] = ("all",),
    /,
    *,
    quick: bool = False,
    seed: Seed | None = None,
    precision: Share | None = None,
    **running: Unpack[RunnerOptions],
) -> int:
    """The paper's figures, computed again.

    By averaging, Monte Carlo and circuit; one PNG and one JSON each, written as soon as the
    figure is done.

    Parameters
    ----------
    figures : list of str
        fig2 … fig10, or all.
    quick : bool
        All figures in minutes: fewer points, error bars up to 5 % (circuit: more).
    seed : int or None
        Seed of the noise (default: the scene's).
    precision : float or None
        Relative standard error of E[V²] and PCE that simulations are run for.
    output : str or Path
        Folder for results, and for every finished piece: run the same command again to go on
        after a kill (default: results).
    """
    from harvester.validation import orbit_maps
    from harvester.validation.paper_figures import FIGURES
    from harvester.validation.reproduce import reproduce

    output = running.setdefault("output", "results")
    without_noise = {"fig2": orbit_maps.surfaces, "fig3": orbit_maps.orbit_voltages}
    names = _chosen(figures, [*without_noise, *FIGURES])
    check_places(None, output, files=[file for name in names for file in result_files(name)])
    scene, finished = _paper(seed), {}

    def keep(content):
        write_result(None, output, content.name, content)
        finished[content.name] = content

    try:
        with study_runner("figures", **running) as runner:
            for name in (name for name in names if name in without_noise):
                keep(without_noise[name](scene))
            drawn = reproduce(
                scene,
                [name for name in names if name in FIGURES],
                quick=quick,
                precision=precision,
                runner=runner,
                on_figure=keep,
            )
    except KeyboardInterrupt as interrupt:
        hint = f"finished figures are in {output}: {', '.join(finished)}" if finished else ""
        raise KeyboardInterrupt(
            f"{hint}; the same command goes on" if hint else interrupt
        ) from None
    finally:
        for name in (name for name in names if name in finished):
            show(finished[name], f"the paper's {name}")
    return 1 if any(content.failed_runs for content in drawn) else 0


def _paper(seed):
    """The source paper's scene with another seed."""
    from harvester.scene.model import Scene

    return Scene.read("paper", overrides_of(seed=seed))


def _chosen(figures, names):
    """Names of figures in the paper's order."""
    for name in figures:
        if name not in (*names, "all"):
            raise HarvesterError(
                f"{name}: no such figure{nearest(name, names)}; there are {', '.join(names)}, all"
            )
    return [name for name in names if name in figures or "all" in figures]
