"""Commands that judge the program: known results, accuracy, stiff cases, the source paper.

Each imports its study when it is called, since the help of a command must not import numba.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import nearest
from harvester.base.signatures import (
    File,
    Kind,
    Overrides,
    RunnerOptions,
    Seconds,
    Seed,
    Share,
    Step,
)
from harvester.cli.output import check_places, result_files, show, study_runner, write_result
from harvester.cli.parsing import overrides_of
from harvester.cli.shown import say

if TYPE_CHECKING:
    from harvester.scene.calling import SceneOrName
    from harvester.scene.model import Scene
    from harvester.validation.claims import Judgement
    from harvester.validation.stability import StabilityMatrix
    from harvester.validation.verify import Verification
    from harvester.validation.work_precision import WorkPrecision

# Default scenes: the source paper's device at an intensity at which it jumps, and one with a
# rectifier.
SCENES = (("paper", ("excitation.intensity=0.1",)), ("device", ("load.netlist=bridge",)))
ACCURACY = "time-to-accuracy"
PICTURES = ("work-precision", "time-to-accuracy")


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


def work_precision(
    scene: SceneOrName, *, thorough: bool = False, **running: Unpack[RunnerOptions]
) -> WorkPrecision:
    """Error against run time of every method on one scene.

    Parameters
    ----------
    scene : Scene, str or Path
    thorough : bool
        More paths, steps and realizations.
    """
    from harvester.validation.work_precision import work_precision

    return work_precision(scene, thorough=thorough, **running)


def accuracy(
    scene: Scene,
    *,
    thorough: bool = False,
    json: File | None = None,
    **running: Unpack[RunnerOptions],
) -> None:
    """Error of every method: against its run time, and how long it takes to 10, 3 and 1 %.

    Parameters
    ----------
    scene : Scene
    thorough : bool
        More paths, steps and realizations.
    json : str or None
        Write JSON; - for standard output.
    """
    from harvester.base.writing import in_folder, write_json
    from harvester.results import figures
    from harvester.validation.accuracy import accuracy

    output, name = os.fspath(running.get("output") or ""), f"{scene.name}-accuracy.json"
    pictures = {picture: f"{scene.name}-{picture}.png" for picture in PICTURES}
    check_places(json, output, files=[name, *pictures.values()])
    with study_runner("accuracy", **running) as runner:
        measured = accuracy(scene, thorough=thorough, runner=runner)
        pair = measured.work_precision, measured.time_to_accuracy
        views: dict[str, Any] = dict(zip(PICTURES, pair, strict=True))
        for title, view in views.items():
            show(view, title.replace("-", " "), json)
        if json:
            write_json(json, measured.to_dict())
        if output:
            write_json(in_folder(output, name), measured.to_dict())
            for title, view in views.items():
                figures.write(view.figure(), in_folder(output, pictures[title]))
            say(f"written to {output}: {name}, {scene.name}-*.png")


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


def time_to_accuracy(
    scenes: Annotated[Sequence[str], Kind("scene")] = (),
    /,
    *,
    overrides: Overrides = (),
    seed: Seed | None = None,
    seconds: Seconds | None = None,
    json: File | None = None,
    **running: Unpack[RunnerOptions],
) -> None:
    """How long every method takes to an error of 10, 3 and 1 %.

    Parameters
    ----------
    scenes : list of str
        TOML files or names of built-in scenes (default: paper with excitation.intensity=0.1 and
        device with load.netlist=bridge).
    overrides : list of str
        Override a value of every scene; TABLE=none removes a table.
    seed : int or None
        Same as --set run.seed=SEED.
    seconds : float or None
        Time on one core for each method's run (default: 10). A longer run gives smaller error bars
        of the biases.
    json : str or None
        Write JSON; - for standard output.
    """
    from harvester.base.writing import in_folder, write_json
    from harvester.results import figures
    from harvester.scene.model import Scene
    from harvester.validation.accuracy_drawing import draw
    from harvester.validation.time_to_accuracy import SECONDS, time_to_accuracy

    named = [(scene, ()) for scene in scenes] or SCENES
    output = os.fspath(running.get("output") or "")
    changes = overrides_of(overrides, seed)
    loaded = [Scene.read(scene, [*values, *changes]) for scene, values in named]
    check_places(json, output, files=[f"{ACCURACY}.json", f"{ACCURACY}.png"])
    with study_runner(ACCURACY.replace("-", " "), **running) as runner:
        results = [
            time_to_accuracy(scene, seconds=seconds or SECONDS, runner=runner) for scene in loaded
        ]
        for result in results:
            show(result, "time to accuracy", json)
        content = {"results": [result.to_dict() for result in results]}
        if json:
            write_json(json, content)
        if output:
            write_json(in_folder(output, f"{ACCURACY}.json"), content)
            figures.save(draw, results, in_folder(output, f"{ACCURACY}.png"))
            say(f"written to {output}: {ACCURACY}.*")
