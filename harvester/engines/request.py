"""Runs a scene by a method, and adds realizations until the error bars are small enough."""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import KW_ONLY, InitVar, dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

from harvester.averaging.closures import CLOSURES
from harvester.averaging.method import Stationary
from harvester.base.arguments import Named, check_name
from harvester.base.errors import EnergyNotBalanced, HarvesterError
from harvester.base.serialising import plain
from harvester.device.cores import is_of_jumps
from harvester.engines.methods import method_of
from harvester.engines.orbits import followed
from harvester.engines.outcome import (
    LARGEST_RESIDUAL,
    NOTED_RESIDUAL,
    is_symmetric,
    notes_on_excitation,
)
from harvester.engines.realizations import MANY_REALIZATIONS, Realizations, averaging
from harvester.engines.simulate import require_paths
from harvester.engines.task import Wanted
from harvester.results.orbit import Attractor
from harvester.scene.model import Scene
from harvester.scene.paths import distinct_realizations
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.steps import knot_spacing, step_error
from harvester.scene.units import Scales
from harvester.statistics.densities import densities
from harvester.statistics.estimate import Density, Estimate, with_roots
from harvester.statistics.run_estimates import run_estimates
from harvester.statistics.settling import unseen_jump

Found = TypeVar("Found")

# A precision applies to these quantities if a request names none.
JUDGED = ("mean_square_voltage", "power_conversion_efficiency")
COMPLETE = "complete"
OUT_OF_TIME = "the time budget was spent"
# With a precision: realizations of the first round, and the most in all rounds.
FIRST_REALIZATIONS, MOST_REALIZATIONS = 8, 80
# The next round raises the number of realizations to MARGIN times the number that the latest error
# bar requires, at most to GROWTH times the present number, since the first error bars are rough.
MARGIN, GROWTH = 1.1, 2.0


@dataclass(frozen=True)
class Request:
    """One scene to be computed by one method.

    Attributes
    ----------
    scene
        Length and seed of the realizations and, if no other is given, their number.
    method
        An engine or a stationary method, or its name.
    precision
        Relative error, from standard error and step error, down to which realizations are added; or
        None.
    quantities
        The precision applies to these quantities; names that the scene does not have are ignored.
    step, tolerance
        Options of the method, if it is given by its name.
    realizations
        Number in the first round with a precision, else in total. None: `FIRST_REALIZATIONS` with a
        precision, else the scene's number.
    most
        Maximum number of realizations with a precision.
    density, moments
        Whether the answer contains them.
    """

    scene: Scene
    method: Any
    _: KW_ONLY
    precision: float | None = None
    quantities: tuple[str, ...] = JUDGED
    step: InitVar[str | float] = "default"
    realizations: int | None = None
    most: int = MOST_REALIZATIONS
    tolerance: InitVar[float | None] = None
    density: bool = False
    moments: bool = False

    def __post_init__(self, step, tolerance):
        method = method_of(self.method, step=step, tolerance=tolerance)
        if isinstance(method, Stationary) and any(map(is_of_jumps, self.quantities)):
            method = replace(method, jump_rates=CLOSURES[method.closure].jump_rates)
        object.__setattr__(self, "method", method)
        if self.precision is not None and not 0.0 < self.precision < 1.0:
            raise HarvesterError(f"precision {self.precision}: must be a number in (0, 1)")
        if self.precision and not self.is_averaged:
            require_paths(self.scene, "a precision")

    @property
    def is_averaged(self) -> bool:
        """Whether the method is a stationary method, not an engine."""
        return isinstance(self.method, Stationary)

    @property
    def cut_from(self) -> Prepared:
        """The prepared scene of the tasks: identical for all requests that share realizations.

        Each realization is cut into as many batches as in a run of many realizations. If a request
        runs the scene's own, small number of realizations, there are more batches.
        """
        unrefined = self.realizations is None and self.precision is None
        count = (
            min(self.scene.run.realizations, MANY_REALIZATIONS) if unrefined else MANY_REALIZATIONS
        )
        return self.prepared_scene.with_run(realizations=count)

    @cached_property
    def prepared_scene(self) -> Prepared:
        """The prepared scene of the request."""
        return prepared(self.scene)

    @property
    def first(self) -> int:
        """Number of realizations in the first round."""
        if self.precision:
            return self.realizations or FIRST_REALIZATIONS
        requested = self.realizations or self.scene.run.realizations
        return distinct_realizations(self.prepared_scene, requested)


@dataclass(frozen=True)
class Answer:
    """The answer of a method to a request.

    Attributes
    ----------
    scene
        Scene with the number of realizations that were run.
    quantities
        Scaled; `standard_error` is the numerical error for a stationary method.
    seconds
        Processor time of one core (s).
    outcome : "complete", or the reason for an early end.
    simulated_time
        Simulated time of all realizations (s); 0 for a stationary method.
    misses_jumps
        Whether a single further jump between the wells would change E[V²] by more than
        the precision; the error bar does not include jumps that no realization made.
    on_orbits
        Notes on the followed orbit.
    orbits
        Without noise: the orbits that starts reached, the followed one first.
    density
        Density of the displacement.
    moments
        One per realization, for paired differences.
    """

    scene: Scene
    method: str
    quantities: dict[str, Estimate]
    seconds: float
    outcome: str = COMPLETE
    realizations: int = 0
    simulated_time: float = 0.0
    energy_balance_residual: float | None = None
    misses_jumps: bool = False
    notes: tuple[str, ...] = ()
    on_orbits: tuple[str, ...] = ()
    orbits: tuple[Attractor, ...] = field(default=(), repr=False)
    density: Density | None = field(default=None, repr=False)
    moments: tuple = field(default=(), repr=False)

    @cached_property
    def prepared_scene(self) -> Prepared:
        """The prepared scene of the answer."""
        return prepared(self.scene)

    def in_units(self) -> Named:
        """The quantities and the roots of mean squares, in the scene's units."""
        means = with_roots(in_units(self.quantities, self.prepared_scene.scales))
        return Named(f"{self.scene.name} by {self.method}: no quantity", means)

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        content = {
            "quantities": self.quantities,
            "seconds": self.seconds,
            "outcome": self.outcome,
            "notes": self.notes,
        }
        if self.simulated_time > 0.0:
            content |= {
                "simulated_time": self.simulated_time,
                "seed": self.scene.run.seed,
                "realizations": self.realizations,
                "knot_spacing": knot_spacing(self.prepared_scene),
                "energy_balance_residual": self.energy_balance_residual,
                "misses_jumps": self.misses_jumps,
            }
        if self.density is not None:
            content["density"] = {
                "displacement": self.density.centre,
                "density": self.density.density,
                "standard_error": self.density.standard_error,
            }
        return plain(content)


def answering(
    request: Request, version: str, density: bool = False
) -> Generator[Wanted, list, Answer | HarvesterError | None]:
    """A plan for `Runner.follow` that returns the answer to a request.

    Parameters
    ----------
    version : str
        Version of the program that computes, see `Runner.version`.
    density : bool
        Whether histograms are kept even if this request does not ask for them.

    Returns
    -------
    generator
        A plan that returns the Answer, the HarvesterError of its first task, or None if the time
        ran out before that.
    """
    density = density or request.density
    if request.is_averaged:
        return (yield from _averaged(request, density))
    try:
        request.method.check(request.scene)
    except HarvesterError as error:
        return error
    cut = Realizations.of(request.cut_from, request.method, version, density)
    most = cut.whole(request.most) if request.precision else request.first
    first = min(cut.whole(request.first), most)
    cost = step_error(request.prepared_scene, request.method.step, request.method.name)
    aim = sampling_error_budget(request.precision, cost) if request.precision else None

    def judge(good, ended):
        if not good:
            return None if ended == OUT_OF_TIME else ended, 0.0
        return _answer(request, good, ended, cost)

    return (yield from in_rounds(cut, first, most, aim, judge))


def sampling_error_budget(precision: float, step_error: float) -> float:
    """Standard error whose square plus the step error's square is the precision's square. If the
    step error alone exceeds the precision, return the precision; `note_on_steps` reports this.
    """
    left = precision**2 - step_error**2
    return math.sqrt(left) if left > 0.0 else precision


def note_on_steps(precision: float, step_error: float) -> str:
    """A note if the step error exceeds the requested precision; empty otherwise."""
    if step_error < precision:
        return ""
    return (
        f"the relative step error of a power may be {step_error:.2g}, above the requested "
        f"precision {precision:g}: choose step = fine or finest"
    )


def in_rounds(
    cut: Realizations,
    first: int,
    most: int,
    precision: float | None,
    judge: Callable[[list, HarvesterError | str], tuple[Found, float]],
) -> Generator[Wanted, list, Found]:
    """A plan for `Runner.follow` that adds realizations until they are precise enough.

    Parameters
    ----------
    first, most : int
        Number of realizations in the first round, and the most in all rounds.
    precision : float or None
        Relative error at which to stop; None: only one round.
    judge : callable
        Function of the answers of all tasks so far and the reason of an end ("" if more may
        follow); returns the estimates and their relative error, or 0 for the error if more
        realizations would not help.

    Returns
    -------
    generator
        Value of `judge` after the last round.
    """
    had, count, answers, ahead = 0, first, [], 0.0
    while True:
        answers += yield Wanted(cut.tasks(had, count, most), ahead)
        good, ended = answers_before_failure(answers)
        content, reached = judge(good, ended)
        if ended or count >= most or precision is None or reached <= precision:
            return content
        had = count
        # The ratio is limited before it is squared, since the square may overflow.
        needed = had * min(MARGIN * min(reached / precision, GROWTH) ** 2, GROWTH)
        count = min(max(cut.whole(math.ceil(needed)), had + cut.size), most)
        needed = min(had * min(reached / precision, most) ** 2, most)
        ahead = max(needed - count, 0.0) / cut.size


def relative_error(estimate: Estimate | None) -> float:
    """Standard error as a share of the estimate; infinite without one."""
    if estimate is None or estimate.standard_error is None or not estimate.estimate:
        return math.inf
    share = abs(estimate.standard_error / estimate.estimate)
    return math.inf if math.isnan(share) else share


def not_balanced(residual: float) -> EnergyNotBalanced:
    """The exception for a run with this energy balance residual."""
    return EnergyNotBalanced(
        f"the energy balance leaves {abs(residual):.0%}: choose a shorter step"
    )


def residual_notes(residual: float) -> list[str]:
    """Notes on a residual of the energy balance."""
    if abs(residual) <= NOTED_RESIDUAL:
        return []
    return [f"energy balance residual {residual:.1%}: choose a shorter step"]


def in_units(quantities: dict[str, Estimate], scales: Scales) -> dict[str, Estimate]:
    """Scaled estimates in the units of a scene."""
    return {
        name: estimate.times(scales.of(estimate.dimension)) for name, estimate in quantities.items()
    }


def told(error: HarvesterError) -> str:
    """The name of an error's class and its message, in one line of printable characters."""
    text = f"{type(error).__name__}: {error}"
    return "".join(character if character.isprintable() else " " for character in text)


def answers_before_failure(found: Sequence) -> tuple[list, HarvesterError | str]:
    """The answers before the first missing one, and why it is missing: an error or lack of time."""
    good: list = []
    for answer in found:
        if answer is None:
            return good, OUT_OF_TIME
        if isinstance(answer, HarvesterError):
            return good, answer
        good.append(answer)
    return good, ""


def _averaged(request, density):
    task = averaging(request.scene, request.method, density)
    (answer,) = yield Wanted([task])
    if answer is None or isinstance(answer, HarvesterError):
        return answer
    return Answer(
        scene=request.scene,
        method=request.method.name,
        quantities=answer["quantities"],
        seconds=answer["seconds"],
        density=answer["density"] if request.density else None,
    )


def _answer(request, good, ended, cost):
    """The answer from the tasks' answers, and the relative error that the precision limits.

    `cost` is the largest relative step error of a power.
    """
    prepared_scene, moments, orbits, on_orbits = followed(request.prepared_scene, good, cost)
    scene, system = prepared_scene.scene, prepared_scene.system
    estimates = run_estimates(prepared_scene, moments, cost)
    if not abs(estimates.residual) <= LARGEST_RESIDUAL:
        return not_balanced(estimates.residual), 0.0
    reached, unseen = _reached(request, scene, system, estimates.whole)
    shape = None
    if request.density:
        even = is_symmetric(scene, system)
        shape = densities(estimates.moments, even, estimates.balance).get("displacement")
    if estimates.shortfalls and shape:
        shape = replace(shape, standard_error=None)
    notes = [*notes_on_excitation(prepared_scene), *on_orbits, *estimates.notes]
    notes += residual_notes(estimates.residual)
    precision = request.precision
    if precision and note_on_steps(precision, cost):
        notes.append(note_on_steps(precision, cost))
    if precision and reached > sampling_error_budget(precision, cost):
        error = f"{reached:.1%}" if math.isfinite(reached) else "unknown"
        notes.append(f"relative standard error {error}, above the requested {precision:.1%}")
    if isinstance(ended, HarvesterError):
        ended = told(ended)
    answer = Answer(
        scene=scene,
        method=request.method.name,
        quantities=estimates.scaled,
        seconds=sum(part["seconds"] for part in good),
        outcome=f"ended after {len(moments)} realizations: {ended}" if ended else COMPLETE,
        realizations=len(moments),
        simulated_time=sum(m.time_reached for m in moments),
        energy_balance_residual=estimates.residual,
        misses_jumps=bool(precision and unseen > precision),
        notes=tuple(notes),
        on_orbits=on_orbits,
        orbits=orbits,
        density=shape,
        moments=tuple(moments) if request.moments else (),
    )
    return answer, reached


def _reached(request, scene, system, scaled):
    """The largest relative error of the requested quantities, and the effect of one more jump.

    The effect is the relative rise of E[V²] by one further jump between the wells; above the
    precision it counts as an error.
    """
    scaled = with_roots(scaled)
    unknown = [name for name in request.quantities if name not in scaled]
    if len(unknown) == len(request.quantities):
        check_name("quantity", unknown[0], scaled)
    reached = max(relative_error(scaled.get(n)) for n in request.quantities if n not in unknown)
    square = scaled["mean_square_voltage"].estimate
    unseen = unseen_jump(system, square, scene.run.duration * scene.run.realizations)
    # The effect of one jump falls as 1/time, an error as 1/√time.
    if request.precision and unseen > request.precision:
        reached = max(reached, math.sqrt(unseen * request.precision))
    return reached, unseen
