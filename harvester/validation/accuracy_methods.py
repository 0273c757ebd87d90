"""The methods that are compared: a new one is one more entry in `METHODS`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
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
        return {
            "engine": self.engine,
            "step": self.step(scene),
            "source": self.source,
            "scheme": self.scheme,
            "tolerance": self.tolerance,
            "device": self.device,
        }


def _own_steps(scheme, *tolerances):
    family = f"PWL in the netlist, {scheme}"
    return tuple(
        ComparedMethod(
            family, "circuit", 2, source="pwl", scheme=scheme, tolerance=tolerance, brief=True
        )
        for tolerance in tolerances
    )


def _fixed_steps(scheme, *refinements, brief=False):
    family = f"external source, {scheme}"
    return tuple(
        ComparedMethod(family, "circuit", 2, refinement, scheme=scheme, brief=brief)
        for refinement in refinements
    )


def _local_error(*tolerances, brief=False):
    family = "external source, local error"
    return tuple(
        ComparedMethod(family, "circuit", 2, tolerance=tolerance, brief=brief)
        for tolerance in tolerances
    )


def _batched(name, device):
    return ComparedMethod(name, "circuit", 2, scheme="trapezoidal", device=device, copies=None)


def _monte_carlo(scheme, *refinements):
    orders = {"Runge–Kutta": 4, "Heun": 2, "TR-BDF2": 2}
    option = "heun" if scheme == "Heun" else None
    return tuple(
        ComparedMethod(
            f"Monte Carlo, {scheme}", "monte-carlo", orders[scheme], refinement, scheme=option
        )
        for refinement in refinements
    )


METHODS = (
    *_own_steps("trapezoidal", 1e-3, 1e-6),
    *_own_steps("gear", 1e-3, 1e-6),
    *_fixed_steps("trapezoidal", 0.5, 1),
    *_fixed_steps("trapezoidal", 2, 4, brief=True),
    *_fixed_steps("gear", 0.5, 1, 2, brief=True),
    _batched("side by side, trapezoidal", "behavioural"),
    *_local_error(1e-4),
    *_local_error(1e-5, 1e-6, brief=True),
    *_monte_carlo("Runge–Kutta", 1, 2, 4),
    *_monte_carlo("Heun", 1, 2, 4),
)
THOROUGH_METHODS = (
    *METHODS,
    *_fixed_steps("trapezoidal", 8, brief=True),
    *_fixed_steps("gear", 4, brief=True),
    *_local_error(1e-7, brief=True),
    *_monte_carlo("Heun", 8),
)
# Methods that are added if the compiled device is available.
COMPILED_METHODS = (_batched("compiled device, trapezoidal", "compiled"),)
# Methods for scenes with a netlist as load. The PWL source is left out, since it is slow there.
LOAD_METHODS = (
    *_fixed_steps("trapezoidal", 1),
    *_fixed_steps("trapezoidal", 0.5, 2, brief=True),
    *_fixed_steps("gear", 0.5, 1, brief=True),
    *_local_error(1e-4, 1e-6, brief=True),
    *_monte_carlo("TR-BDF2", 1, 2, 4),
)
# `time-to-accuracy` measures one setting of each family: ngspice's own tolerance and the default
# steps.
TIMED_METHODS = (
    *_own_steps("trapezoidal", 1e-3),
    *_own_steps("gear", 1e-3),
    *_fixed_steps("trapezoidal", 1),
    *_fixed_steps("gear", 1),
    *_local_error(1e-4),
    _batched("side by side, trapezoidal", "behavioural"),
    *_monte_carlo("Runge–Kutta", 1),
    *_monte_carlo("Heun", 1),
)
TIMED_LOAD_METHODS = (
    *_fixed_steps("trapezoidal", 1),
    *_fixed_steps("gear", 1),
    *_local_error(1e-4),
    *_monte_carlo("TR-BDF2", 1),
)
# The reference of all biases.
REFERENCE = ComparedMethod("Monte Carlo, Runge–Kutta, a quarter of the step", "monte-carlo", 4, 4)
LOAD_REFERENCE = ComparedMethod("Monte Carlo, TR-BDF2, a quarter of the step", "monte-carlo", 2, 4)
# The reference of paths with a netlist as load, which no independent integrator runs.
LOAD_PATHS = ComparedMethod("Monte Carlo, TR-BDF2, a 32nd of the step", "monte-carlo", 2, 32)


def with_compiled(methods: Sequence[ComparedMethod], runner: Runner) -> tuple[ComparedMethod, ...]:
    """The methods, and those of the compiled device where it is on."""
    return (*methods, *(COMPILED_METHODS if "compiled" in runner.version("circuit") else ()))
