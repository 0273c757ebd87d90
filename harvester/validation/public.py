"""The public checks of the program.

Signatures and docstrings define the commands' options and help; computing code is imported inside,
so that reading them does not import numba.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Unpack

from harvester.base.arguments import listed
from harvester.base.errors import HarvesterError
from harvester.base.signatures import Methods, RunnerOptions, Step
from harvester.engines.simulate import check_step, require_noise
from harvester.scene.calling import checked, takes_scene
from harvester.validation import TIME_LIMIT

if TYPE_CHECKING:
    from harvester.scene.model import Scene
    from harvester.validation.accuracy import Accuracy
    from harvester.validation.known_results import Truth
    from harvester.validation.stability import StabilityMatrix
    from harvester.validation.stability_cases import Case
    from harvester.validation.verify import Verification


@checked
def verify(
    *, chosen: Sequence[Truth] | None = None, **running: Unpack[RunnerOptions]
) -> Verification:
    """Compare with exact and published results.

    The circuit, Monte Carlo and the stationary solver are compared with closed forms, limits,
    published powers and other integrators; exit code 1 if one disagrees.

    Parameters
    ----------
    **running
        See `harvester.open_runner`.

    Other Parameters
    ----------------
    chosen : sequence of Truth or None
        Results from `catalogue` and `measured` of `harvester.validation.known_results`; None: all.

    Examples
    --------
    ::

        harvester verify --output results
    """
    from harvester.engines.opening import open_runner
    from harvester.validation.known_results import Truth
    from harvester.validation.verify import verification

    if chosen is not None:
        chosen = listed(chosen, "chosen", "some of known_results.catalogue()", Truth)
    with open_runner(**running) as runner:
        return verification(runner, chosen)


@takes_scene
def stability(
    scene: Scene = "paper",  # type: ignore[assignment]  # of the command
    *,
    cases: Sequence[Case] | None = None,
    step: Step = "default",
    **running: Unpack[RunnerOptions],
) -> StabilityMatrix:
    """Check stiff and extreme variations of one scene; exit code 1 if a result is wrong.

    Parameters
    ----------
    scene : Scene, str or Path
        Device that is varied; its seed is used, its run length is not.
    step : str or float
        default, fine, finest, or the longest step in seconds.
    time_limit : float
        Wall-clock limit of one case by one method (default: 120).
    **running
        See `harvester.open_runner`.

    Other Parameters
    ----------------
    cases : sequence of Case or None
        None: `harvester.validation.stability_cases.default_cases`.

    Raises
    ------
    HarvesterError
        The excitation is not noise.

    Examples
    --------
    ::

        harvester stability paper --output results
    """
    from harvester.engines.opening import open_runner
    from harvester.validation.stability import matrix_of
    from harvester.validation.stability_cases import Case

    if cases is not None:
        cases = listed(cases, "cases", "some of stability_cases.default_cases()", Case)
    step = check_step(step)
    require_noise(scene, "stability")
    running.setdefault("time_limit", TIME_LIMIT)
    with open_runner(**running) as runner:
        return matrix_of(scene, runner, cases, step)


@takes_scene
def accuracy(
    scene: Scene,
    *,
    thorough: bool = False,
    methods: Methods | None = None,
    **running: Unpack[RunnerOptions],
) -> Accuracy:
    """Error of every method against run time, and time to an error of 10, 3 and 1 %.

    Parameters
    ----------
    scene : Scene, str or Path
        The scene; its [run] defines the compared means.
    thorough : bool
        More paths, steps and realizations.
    methods : sequence of str or Method
        Engines and closures; several may be given. The name of an engine means all its steps and
        schemes, an object such as `MonteCarlo(step=0.01)` its own settings (default: all, and the
        throughput of every way to run the circuit).
    **running
        See `harvester.open_runner`. Stored answers include their measured times.

    Raises
    ------
    HarvesterError
        The excitation is not noise, or the reference failed.
    OutOfTime
        The time budget was spent before the reference was complete.

    Examples
    --------
    ::

        harvester accuracy paper --output results
    """
    from harvester.engines.opening import open_runner
    from harvester.validation.accuracy import Accuracy
    from harvester.validation.accuracy_measurement import measure

    require_noise(scene, "accuracy")
    if methods is not None:
        example = 'methods=["circuit", "consistent"]'
        methods = listed(methods, "methods", example)
        if not methods:
            raise HarvesterError(f"methods = []: give at least one, {example}")
    with open_runner(**running) as runner:
        return Accuracy(**measure(scene, runner, thorough, methods))
