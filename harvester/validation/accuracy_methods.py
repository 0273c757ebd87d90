"""The methods that are compared: a new one is one more entry in accuracy_methods.toml."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from harvester.base.serialising import LEFT_OUT, key
from harvester.engines import side_by_side
from harvester.validation import entries
from harvester.validation.paths import longest_step

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared


@dataclass(frozen=True)
class ComparedMethod:
    """One way to solve a scene; the methods of one family differ in their steps only.

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

    def step(self, model: Prepared) -> float:
        """Longest step (s): a whole part of the time between two samples of the excitation."""
        asked = longest_step(model, "default", self.engine) / self.refinement
        return longest_step(model, asked, self.engine)

    def together(self, model: Prepared) -> int:
        """Realizations in one netlist: as many as pay where `copies` is None."""
        if self.copies is not None:
            return self.copies
        if not side_by_side.share_steps(model, self.step(model), self.source, self.tolerance):
            return 1
        return side_by_side.copies(model.scene.run.realizations, self.device)

    def setting(self, model: Prepared) -> str:
        """The setting, as text, that distinguishes this method in its family: tolerance or step."""
        if self.tolerance is not None:
            return f"tolerance {self.tolerance:.0e}".replace("e-0", "e-")
        return f"step {self.step(model):.4g}"

    def options(self, model: Prepared) -> dict[str, Any]:
        """The engine's name and settings, as arguments of `harvester.simulate`."""
        names = ("engine", "source", "scheme", "tolerance", "device")
        return {"step": self.step(model), **{name: getattr(self, name) for name in names}}


def _listed(name):
    """The settings of all families in one of the lists."""
    methods = []
    for entry in entries("accuracy_methods")["method"]:
        common = {key: value for key, value in entry.items() if not isinstance(value, list)}
        for setting in entry.get(name, ()):
            method = ComparedMethod(**(common | setting))
            methods.append(method if method.copies else replace(method, copies=None))
    return tuple(methods)


METHODS, COMPILED_METHODS, LOAD_METHODS = map(_listed, ("all", "compiled", "load"))
THOROUGH_METHODS = (*METHODS, *_listed("thorough"))
# The references of all biases, and the reference of paths with a netlist as load, which no
# independent integrator runs.
REFERENCE = ComparedMethod("Monte Carlo, Runge–Kutta, a quarter of the step", "monte-carlo", 4, 4)
LOAD_REFERENCE = ComparedMethod("Monte Carlo, TR-BDF2, a quarter of the step", "monte-carlo", 2, 4)
LOAD_PATHS = ComparedMethod("Monte Carlo, TR-BDF2, a 32nd of the step", "monte-carlo", 2, 32)
