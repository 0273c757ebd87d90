"""The methods that are compared: a new one is one more entry in `METHODS`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from harvester.base.serialising import LEFT_OUT, key
from harvester.engines import side_by_side
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, steps_per_sample

if TYPE_CHECKING:
    from harvester.engines.runner import Runner
    from harvester.scene.model import Scene


@dataclass(frozen=True)
class ComparedMethod:
    """One way to solve a scene; those of one family differ in their steps only.

    Attributes
    ----------
    order : int
        Order of the scheme, in theory.
    refinement : float
        Number by which the engine's default step is divided.
    source, scheme, tolerance, device, copies
        See `harvester.simulate`.
    brief : bool
        Too slow for the scene's own run: its means come from a shorter one.
    """

    family: str
    engine: str
    order: int = field(metadata=key("theoretical_order"))
    refinement: float = field(default=1, metadata=LEFT_OUT)
    source: str = "external"
    scheme: str | None = None
    tolerance: float | None = None
    device: str = "behavioural"
    copies: int | None = 1
    brief: bool = field(default=False, metadata=LEFT_OUT)

    @property
    def group(self) -> str:
        """The family without its scheme, if that is the trapezoidal rule or Gear's formula."""
        return self.family.removesuffix(", trapezoidal").removesuffix(", gear")

    def step(self, scene: Scene) -> float:
        """Longest step (s)."""
        model = prepared(scene)
        return knot_spacing(model) / (steps_per_sample(model, engine=self.engine) * self.refinement)

    def together(self, scene: Scene) -> int:
        """Realizations in one netlist: as many as pay where `copies` is None."""
        if self.copies is not None:
            return self.copies
        if not side_by_side.share_steps(
            prepared(scene), self.step(scene), self.source, self.tolerance
        ):
            return 1
        return side_by_side.copies(scene.run.realizations, self.device)

    def setting(self, scene: Scene) -> str:
        """The setting, as text, that distinguishes this method in its family: tolerance or step."""
        if self.tolerance is not None:
            return f"tolerance {self.tolerance:.0e}".replace("e-0", "e-")
        return f"step {self.step(scene):.4g}"

    def options(self, scene: Scene) -> dict[str, Any]:
        """The engine's name and what it is set to, as `harvester.simulate` takes them."""
        names = ("engine", "source", "scheme", "tolerance", "device")
        return {"step": self.step(scene), **{name: getattr(self, name) for name in names}}


def _steps(method, *refinements, **changes):
    return tuple(replace(method, refinement=refinement, **changes) for refinement in refinements)


def _tolerances(method, *tolerances, **changes):
    return tuple(replace(method, tolerance=tolerance, **changes) for tolerance in tolerances)


_SCHEMES = ("trapezoidal", "gear")
PWL, PWL_GEAR = (
    ComparedMethod(f"PWL in the netlist, {s}", "circuit", 2, source="pwl", scheme=s, brief=True)
    for s in _SCHEMES
)
TRAPEZOIDAL, GEAR = (
    ComparedMethod(f"external source, {s}", "circuit", 2, scheme=s) for s in _SCHEMES
)
LOCAL_ERROR = ComparedMethod("external source, local error", "circuit", 2)
SIDE_BY_SIDE, COMPILED = (
    ComparedMethod(
        f"{name}, trapezoidal", "circuit", 2, scheme="trapezoidal", device=device, copies=None
    )
    for name, device in (("side by side", "behavioural"), ("compiled device", "compiled"))
)
RUNGE_KUTTA = ComparedMethod("Monte Carlo, Runge–Kutta", "monte-carlo", 4)
HEUN = ComparedMethod("Monte Carlo, Heun", "monte-carlo", 2, scheme="heun")
TR_BDF2 = ComparedMethod("Monte Carlo, TR-BDF2", "monte-carlo", 2)

METHODS = (
    *_tolerances(PWL, 1e-3, 1e-6),
    *_tolerances(PWL_GEAR, 1e-3, 1e-6),
    *_steps(TRAPEZOIDAL, 0.5, 1),
    *_steps(TRAPEZOIDAL, 2, 4, brief=True),
    *_steps(GEAR, 0.5, 1, 2, brief=True),
    SIDE_BY_SIDE,
    *_tolerances(LOCAL_ERROR, 1e-4),
    *_tolerances(LOCAL_ERROR, 1e-5, 1e-6, brief=True),
    *_steps(RUNGE_KUTTA, 1, 2, 4),
    *_steps(HEUN, 1, 2, 4),
)
THOROUGH_METHODS = (
    *METHODS,
    *_steps(TRAPEZOIDAL, 8, brief=True),
    *_steps(GEAR, 4, brief=True),
    *_tolerances(LOCAL_ERROR, 1e-7, brief=True),
    *_steps(HEUN, 8),
)
# Methods that are added if the compiled device is available.
COMPILED_METHODS = (COMPILED,)
# Methods for scenes with a netlist as load. The PWL source is left out, since it is slow there.
LOAD_METHODS = (
    *_steps(TRAPEZOIDAL, 1),
    *_steps(TRAPEZOIDAL, 0.5, 2, brief=True),
    *_steps(GEAR, 0.5, 1, brief=True),
    *_tolerances(LOCAL_ERROR, 1e-4, 1e-6, brief=True),
    *_steps(TR_BDF2, 1, 2, 4),
)
# The reference of all biases.
REFERENCE, LOAD_REFERENCE = (
    replace(method, family=f"{method.family}, a quarter of the step", refinement=4)
    for method in (RUNGE_KUTTA, TR_BDF2)
)
# The reference of paths with a netlist as load, which no independent integrator runs.
LOAD_PATHS = replace(TR_BDF2, family=f"{TR_BDF2.family}, a 32nd of the step", refinement=32)


def with_compiled(methods: Sequence[ComparedMethod], runner: Runner) -> tuple[ComparedMethod, ...]:
    """The methods, and those of the compiled device where it is on."""
    return (*methods, *(COMPILED_METHODS if "compiled" in runner.version("circuit") else ()))
