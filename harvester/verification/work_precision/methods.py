"""The methods that `work-precision` compares: a new one is one more entry in `METHODS`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing, steps_per_knot
from harvester.simulation import side_by_side

if TYPE_CHECKING:
    from harvester.running import Runner
    from harvester.scene.model import Scene


@dataclass(frozen=True)
class Method:
    """One way to solve a scene; those of one family differ in their steps only.

    Attributes
    ----------
    family : str
    engine, source, scheme, tolerance
        See `harvester.simulate`.
    order : int
        Of the scheme, in theory.
    refinement : float
        Of the engine's default step.
    device, copies : str, int or None
        See `harvester.simulate`.
    brief : bool
        Too slow for the scene's own run: its means come from a shorter one.
    """

    family: str
    engine: str
    order: int
    refinement: float = 1
    source: str = "external"
    scheme: str | None = None
    tolerance: float | None = None
    device: str = "behavioural"
    copies: int | None = 1
    brief: bool = False

    def step(self, scene: Scene) -> float:
        """Longest step (s)."""
        ready = prepared(scene)
        return knot_spacing(ready) / (steps_per_knot(ready, engine=self.engine) * self.refinement)

    def together(self, scene: Scene) -> int:
        """Realizations in one netlist: as many as pay where nothing else is asked for."""
        if self.copies is not None:
            return self.copies
        options = self.step(scene), self.source, self.tolerance
        if not side_by_side.share_steps(scene, *options):
            return 1
        return side_by_side.copies(scene.run.realizations, self.device)

    def setting(self, scene: Scene) -> str:
        """What tells it from others of its family, as text."""
        if self.tolerance is not None:
            return f"tolerance {self.tolerance:.0e}".replace("e-0", "e-")
        return f"step {self.step(scene):.4g}"

    def options(self, scene: Scene) -> dict[str, Any]:
        """Arguments that `harvester.simulation.realization.run` and `harvester.simulate` share."""
        return {
            "engine": self.engine,
            "step": self.step(scene),
            "source": self.source,
            "scheme": self.scheme,
            "tolerance": self.tolerance,
            "device": self.device,
        }


def _own_steps(scheme, tolerance):
    family = f"PWL in the netlist, {scheme}"
    return Method(
        family, "circuit", 2, source="pwl", scheme=scheme, tolerance=tolerance, brief=True
    )


def _fixed_steps(scheme, refinement, brief=False):
    family = f"external source, {scheme}"
    return Method(family, "circuit", 2, refinement, scheme=scheme, brief=brief)


def _local_error(tolerance, brief=False):
    return Method("external source, local error", "circuit", 2, tolerance=tolerance, brief=brief)


def _batched(name, device):
    return Method(name, "circuit", 2, scheme="trapezoidal", device=device, copies=None)


METHODS = (
    *(_own_steps("trapezoidal", tolerance) for tolerance in (1e-3, 1e-6)),
    *(_own_steps("gear", tolerance) for tolerance in (1e-3, 1e-6)),
    *(_fixed_steps("trapezoidal", refinement) for refinement in (0.5, 1)),
    *(_fixed_steps("trapezoidal", refinement, brief=True) for refinement in (2, 4)),
    *(_fixed_steps("gear", refinement, brief=True) for refinement in (0.5, 1, 2)),
    _batched("side by side, trapezoidal", "behavioural"),
    _local_error(1e-4),
    *(_local_error(tolerance, brief=True) for tolerance in (1e-5, 1e-6)),
    *(Method("Monte Carlo, Runge–Kutta", "monte-carlo", 4, n) for n in (1, 2, 4)),
    *(Method("Monte Carlo, Heun", "monte-carlo", 2, n, scheme="heun") for n in (1, 2, 4)),
)
# Where the compiled device is on.
COMPILED_METHODS = (_batched("compiled device, trapezoidal", "compiled"),)


def with_compiled(methods: Sequence[Method], runner: Runner) -> tuple[Method, ...]:
    """The methods, and those of the compiled device where it is on."""
    return (*methods, *(COMPILED_METHODS if "compiled" in runner.version("circuit") else ()))


# What `time-to-accuracy` times, one setting of each family: ngspice's own tolerance, default steps.
TIMED_METHODS = (
    _own_steps("trapezoidal", 1e-3),
    _own_steps("gear", 1e-3),
    _fixed_steps("trapezoidal", 1),
    _fixed_steps("gear", 1),
    _local_error(1e-4),
    _batched("side by side, trapezoidal", "behavioural"),
    Method("Monte Carlo, Runge–Kutta", "monte-carlo", 4),
    Method("Monte Carlo, Heun", "monte-carlo", 2, scheme="heun"),
)
# The same where the load is a netlist; a PWL is slow there.
TIMED_LOAD_METHODS = (
    _fixed_steps("trapezoidal", 1),
    _fixed_steps("gear", 1),
    _local_error(1e-4),
    Method("Monte Carlo, TR-BDF2", "monte-carlo", 2),
)
# The same for `work-precision`.
LOAD_METHODS = (
    _fixed_steps("trapezoidal", 1),
    *(_fixed_steps("trapezoidal", refinement, brief=True) for refinement in (0.5, 2)),
    *(_fixed_steps("gear", refinement, brief=True) for refinement in (0.5, 1)),
    *(_local_error(tolerance, brief=True) for tolerance in (1e-4, 1e-6)),
    *(Method("Monte Carlo, TR-BDF2", "monte-carlo", 2, n) for n in (1, 2, 4)),
)
# What biases are reckoned against: a quarter of the default step.
REFERENCE = Method("Monte Carlo, Runge–Kutta, a quarter of the step", "monte-carlo", 4, 4)
LOAD_REFERENCE = Method("Monte Carlo, TR-BDF2, a quarter of the step", "monte-carlo", 2, 4)
# What the paths' errors are reckoned against where no other integrator knows the load.
LOAD_PATHS = Method("Monte Carlo, TR-BDF2, a 32nd of the step", "monte-carlo", 2, 32)
THOROUGH_METHODS = (
    *METHODS,
    _fixed_steps("trapezoidal", 8, brief=True),
    _fixed_steps("gear", 4, brief=True),
    _local_error(1e-7, brief=True),
    Method("Monte Carlo, Heun", "monte-carlo", 2, 8, scheme="heun"),
)
