"""The compared methods; accuracy_methods.toml lists them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from circuits.equivalent.export import longest_in_contact
from harvester.base.errors import HarvesterError
from harvester.base.serialising import LEFT_OUT, key
from harvester.engines import side_by_side
from harvester.scene.steps import STEP_LEVELS
from harvester.validation import entries
from harvester.validation.paths import longest_step

if TYPE_CHECKING:
    from harvester.engines.methods import Engine
    from harvester.scene.prepared import Prepared

# Order of each scheme.
ORDERS = {"runge-kutta": 4, "heun": 2, "tr-bdf2": 2, "trapezoidal": 2, "gear": 2}


@dataclass(frozen=True)
class ComparedMethod:
    """A method to solve a scene; the methods of a family differ only in their steps.

    Attributes
    ----------
    order : float
        Theoretical order of the scheme; nan if unknown.
    refinement : float
        Divisor of the engine's default step.
    source, scheme, tolerance, device, copies
        See `harvester.simulate`.
    brief : bool
        Whether the method is too slow for the scene's run, so that its means come from a shorter
        run.
    """

    family: str
    engine: str
    order: float = field(metadata=key("theoretical_order"))
    refinement: float = field(default=1, metadata=LEFT_OUT)
    source: str = "external"
    scheme: str | None = None
    tolerance: float | None = None
    device: str = "behavioural"
    copies: int | None = 1
    brief: bool = field(default=False, metadata=LEFT_OUT)

    @classmethod
    def of(cls, engine: Engine, model: Prepared) -> ComparedMethod:
        """An engine with its settings; raises HarvesterError for a setting that is not compared."""
        settings = {"scheme": engine.scheme, **engine.settings}
        step = settings.pop("step", "default")
        refinement = STEP_LEVELS.get(step) or longest_step(model, "default", engine.name) / step
        for name in settings:
            if name not in cls.__dataclass_fields__:
                raise HarvesterError(f"accuracy: {engine}: compares no {name}; omit it")
        of_load = engine.name == "monte-carlo" and not model.scene.load.is_resistor
        order = ORDERS.get("tr-bdf2" if of_load else engine.scheme, math.nan)
        return cls(engine.label, engine.name, order, refinement, **settings)

    @property
    def group(self) -> str:
        """The family without the words for the trapezoidal rule or Gear's formula."""
        return self.family.removesuffix(", trapezoidal").removesuffix(", gear")

    def step(self, model: Prepared) -> float:
        """Longest step (s): a whole part of the time between two samples of the excitation.

        With ngspice's own steps it is no longer than a contact allows.
        """
        asked = longest_step(model, "default", self.engine) / self.refinement
        if self.source == "pwl":
            asked = min(asked, longest_in_contact(model.system) or asked)
        return longest_step(model, asked, self.engine)

    def together(self, model: Prepared) -> int:
        """Realizations per netlist; the fastest number if `copies` is None."""
        if self.copies is not None:
            return self.copies
        if not side_by_side.share_steps(model, self.step(model), self.source, self.tolerance):
            return 1
        return side_by_side.copies(model.scene.run.realizations, self.device)

    def setting(self, model: Prepared) -> str:
        """The tolerance or step, as text, that distinguishes this method in its family."""
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
# References of biases, and the reference of paths with a netlist as load, for which there is no
# independent integrator.
REFERENCE = ComparedMethod("Monte Carlo, Runge–Kutta, a quarter of the step", "monte-carlo", 4, 4)
LOAD_REFERENCE = ComparedMethod("Monte Carlo, TR-BDF2, a quarter of the step", "monte-carlo", 2, 4)
LOAD_PATHS = ComparedMethod("Monte Carlo, TR-BDF2, a 32nd of the step", "monte-carlo", 2, 32)
