"""`harvester reproduce`: the source paper's figures and claims."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Unpack

from harvester.base.arguments import check_name
from harvester.base.signatures import Kind, RunnerOptions, Seed, Share, as_list
from harvester.cli.output import check_outputs, show, study_runner, write_result


def reproduce(
    figures: Annotated[Sequence[str], Kind("FIGURE", join=as_list)] = ("all",),
    /,
    *,
    quick: bool = False,
    seed: Seed | None = None,
    precision: Share | None = None,
    thorough: bool = False,
    **running: Unpack[RunnerOptions],
) -> int:
    """Compute the paper's figures again, and check its claims on trends.

    Averaging, Monte Carlo and the circuit compute them. Each finished figure is written as PNG and
    JSON. `claims` reuses the figures' simulations in the folder.

    Parameters
    ----------
    figures : list of str
        fig2 … fig10, claims, or all.
    quick : bool
        All figures in minutes: fewer points, error bars up to 5 % (circuit: more).
    seed : int or None
        Seed of the noise (default: the scene's).
    precision : float or None
        Target relative standard error of E[V²] and PCE in the figures' simulations.
    thorough : bool
        Check claims by longer runs, and by the circuit at every condition.
    output : str or Path
        Folder for results and intermediate results: repeat the same command to continue after an
        interruption (default: results).

    Examples
    --------
    ::

        harvester reproduce fig6 fig9 --quick --output results
    """
    from harvester.cli.console import progress
    from harvester.scene.model import Scene
    from harvester.validation.reproduce import NAMES, reproduce

    output = running.setdefault("output", "results")
    for name in figures:
        check_name("figure", name, (*NAMES, "all"))
    names = [name for name in NAMES if name in figures or "all" in figures]
    check_outputs(None, output, names=names)
    scene = Scene.read("paper", [] if seed is None else [f"run.seed={seed}"])
    finished = {}

    def keep(content):
        write_result(None, output, content.name, content)
        finished[content.name] = content

    try:
        with progress("figures") as running["progress"], study_runner(**running) as runner:
            effort: Any = {"quick": quick, "precision": precision, "thorough": thorough}
            reproduce(scene, names, **effort, runner=runner, on_figure=keep)
    except KeyboardInterrupt as interrupt:
        hint = f"finished figures are in {output}: {', '.join(finished)}" if finished else ""
        raise KeyboardInterrupt(
            f"{hint}; repeat the same command to continue" if hint else interrupt
        ) from None
    finally:
        for name in (name for name in names if name in finished):
            show(finished[name], f"the paper's {name}")
    return 1 if any(getattr(content, "failed_runs", 0) for content in finished.values()) else 0
