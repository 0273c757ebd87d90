"""The engines that simulate a scene: one class per engine, one attribute per setting."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from harvester.averaging.method import Stationary
from harvester.base.arguments import check_name
from harvester.base.errors import HarvesterError
from harvester.base.method import Method
from harvester.base.numbers import is_real, on_quotes
from harvester.base.plain_text import named, nearest
from harvester.base.registry import Registry
from harvester.base.signatures import Count, Share

if TYPE_CHECKING:
    from harvester.scene.model import Scene
    from harvester.scene.prepared import Prepared

SOURCES = ("external", "pwl")
DEVICES = ("automatic", "behavioural", "compiled")


@dataclass(frozen=True)
class Engine(Method):
    """One way to simulate realizations of a scene, in a worker process.

    `simulator` imports its module when it is called, so that Monte Carlo loads no SPICE.

    Attributes
    ----------
    step : str or float
        default, fine, finest, or the longest step in seconds.
    schemes : tuple of str
        Integration schemes that `scheme` may name, the default first.
    """

    step: str | float = "default"
    scheme: str = ""
    schemes: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "step", check_step(self.step))
        check_name("scheme", self.scheme, self.schemes)

    @property
    def name(self) -> str:
        """The name of its class in `ENGINES`."""
        return ENGINES.name_of(type(self))

    @property
    def title(self) -> str:
        """Name of the method in results."""
        return self.name

    @property
    def chooses_steps(self) -> bool:
        """Whether the simulator chooses every step itself, so that the step error is unknown."""
        return False

    def in_lockstep(self, scene: Scene) -> bool:
        """Whether Monte Carlo's loop for a resistor integrates the scene's realizations."""
        return False

    @abstractmethod
    def check(self, scene: Scene) -> None:
        """Raise if the engine does not support the scene, before anything runs."""

    @abstractmethod
    def simulator(self, scene: Scene) -> Any:
        """Return the module that does the work, with functions `prepare` and `run_realizations`;
        the first argument of `run_realizations` is this object.
        """

    def prepare(self, prepared_scene: Prepared) -> None:
        """Load libraries and compiled code, so that they do not count as simulation."""
        self.simulator(prepared_scene.scene).prepare(prepared_scene)

    def run_realizations(
        self,
        prepared_scene: Prepared,
        paths: list,
        starts: list,
        observers: list,
        outputs: list | None = None,
    ) -> dict[str, Any]:
        """Run realizations and hand every record to their observers.

        Parameters
        ----------
        paths, starts : list of ExcitationPath, list of (float, float, float)
            Excitation of each realization, and its initial X, X' and transducer's state, scaled.
        observers : list of lists of objects with `add(record)`
        outputs : list of harvester.statistics.output_moments.OutputMoments or None
            One per realization, if the load has an output side.

        Returns
        -------
        dict
            engine_version, netlist_sha256.

        Raises
        ------
        SimulationError, NetlistError, EngineNotFound
        """
        return self.simulator(prepared_scene.scene).run_realizations(
            self, prepared_scene, paths, starts, observers, outputs
        )


@dataclass(frozen=True)
class Circuit(Engine):
    """The engine "circuit": the equivalent circuit, simulated by ngspice.

    Attributes
    ----------
    step : str or float
        default, fine, finest, or the longest step in seconds. It is rounded down so that a whole
        number of steps fits between two samples of the excitation; in contact it is shorter.
    scheme : str
        trapezoidal or gear.
    source : str
        The source of the excitation, external (samples by compiled callbacks) or pwl (a source in
        the netlist, with ngspice's own steps; for comparison).
    device : str
        behavioural (elements), compiled (one device for mechanics and piezo, of the extra `fast`)
        or automatic (compiled if it is installed). Results agree to 1e-9.
    copies : int or None
        Number of realizations that run in one netlist, with common time steps; None: the fastest.
    tolerance : float or None
        Relative tolerance of ngspice's control by the local error, which shortens steps below
        `step`; None: fixed steps, or ngspice's own tolerance for "pwl".
    gmin, cshunt : float
        ngspice's options of these names (S, F), which change the circuit; 0: ngspice's defaults.
    ramp : float
        Time (s) in which the load's constant sources rise from 0.
    """

    scheme: str = "trapezoidal"
    source: str = "external"
    device: str = "automatic"
    copies: Count | None = None
    tolerance: Share | None = None
    gmin: float = 0.0
    cshunt: float = 0.0
    ramp: float = 0.0
    schemes: ClassVar[tuple[str, ...]] = ("trapezoidal", "gear")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_name("source", self.source, SOURCES)
        check_name("device", self.device, DEVICES)
        for name in ("gmin", "cshunt", "ramp"):
            value = getattr(self, name)
            if value < 0.0:
                raise HarvesterError(f"{name} {value}: must be a number ≥ 0")

    @property
    def title(self) -> str:
        """The name, with the source of the noise if it is not the default."""
        return self.name if self.source == "external" else f"{self.name} ({self.source} source)"

    @property
    def chooses_steps(self) -> bool:
        """True if ngspice chooses its steps, which it does with a source in the netlist."""
        return self.source == "pwl"

    def check(self, scene: Scene) -> None:
        """Raise if copies cannot share a netlist; loads are checked when they are read."""
        if (self.copies or 1) > 1 and not (scene.load.is_resistor and self.source == "external"):
            raise _no_copies(self.copies)

    def simulator(self, scene: Scene) -> Any:
        """See `Engine`."""
        from circuits.ngspice import engine

        return engine


@dataclass(frozen=True)
class MonteCarlo(Engine):
    """Direct integration of the equations, without ngspice.

    Attributes
    ----------
    step : str or float
        default, fine, finest, or the longest step in seconds; shorter in contact.
    scheme : str
        runge-kutta, or for a resistor heun, for comparison.
    """

    scheme: str = "runge-kutta"
    schemes: ClassVar[tuple[str, ...]] = ("runge-kutta", "heun")

    def in_lockstep(self, scene: Scene) -> bool:
        """Whether the load is a resistor."""
        return scene.load.is_resistor

    def check(self, scene: Scene) -> None:
        """Raise for what Monte Carlo does not support: prescribed motion, some load elements."""
        from harvester.scene.prepared import prepared
        from harvester.scene.units import require_mass

        require_mass(scene, "Monte Carlo")
        if not scene.load.is_resistor:
            from circuits.kernel.assembly import collect

            collect(prepared(scene))

    def simulator(self, scene: Scene) -> Any:
        """The integrator for a resistor as load, or the one for a netlist."""
        if scene.load.is_resistor:
            from harvester.engines.monte_carlo import engine as resistor

            return resistor
        from circuits.kernel import engine as netlist

        return netlist


ENGINES: Registry[type[Engine]] = Registry(
    "harvester.engines", {"circuit": Circuit, "monte-carlo": MonteCarlo}
)
# Defaults of the options of `simulate`. If a method is given as an object, the object holds its
# options.
DEFAULTS = {"step": "default", "source": "external", "device": "automatic"}


def engine_of(method: str | Method, **options: Any) -> Engine:
    """The engine of a call, given by name and options or as an object.

    Raises HarvesterError for an unknown name, a stationary method, or an unknown option.
    """
    if isinstance(method, Engine):
        return method.check_options_agree(options, DEFAULTS)
    _check_options(options)
    from harvester.averaging.closures import CLOSURES

    if isinstance(method, Stationary) or str(method).replace("-", "_") in (*CLOSURES, "averaging"):
        raise HarvesterError(
            f"method {method}: does not simulate: {', '.join(CLOSURES)} are for average, sweep, "
            f"load_study and optimum; here there are {', '.join(ENGINES)}"
        )
    engine: Engine = ENGINES[check_name("method", str(method), ENGINES)]()
    if (options.get("copies") or 1) > 1 and not hasattr(engine, "copies"):
        raise _no_copies(options["copies"])
    return engine.with_options(options)


def method_of(method: str | Method, **options: Any) -> Method:
    """The engine or the method of a call; see `engine_of`."""
    if isinstance(method, Engine) or method in ENGINES:
        return engine_of(method, **options)
    from harvester.averaging.closures import CLOSURES

    if isinstance(method, Stationary):
        return method.check_options_agree(options, DEFAULTS)
    check_name("method", str(method), {**ENGINES, **CLOSURES})
    _check_options(options)
    return Stationary(str(method)).with_options(options)


def check_step(step: str | float) -> str | float:
    """A level's name or a positive number of seconds; raises HarvesterError for anything else."""
    from harvester.scene.steps import STEP_LEVELS

    if isinstance(step, str) and step in STEP_LEVELS:
        return step
    if isinstance(step, str) or not (is_real(step) and 0.0 < step < math.inf):
        raise HarvesterError(
            f"step {named(step)}{nearest(step, STEP_LEVELS)}: must be one of "
            f"{', '.join(STEP_LEVELS)}, or the longest step in seconds > 0{on_quotes(step)}"
        )
    return step


def _check_options(options: Mapping[str, Any]) -> None:
    """Raise for values that no engine accepts; `Circuit` has the options of all engines."""
    stated = {name: options.get(name) for name in ("step", "source", "device", "copies")}
    Circuit().with_options(stated)


def _no_copies(copies: int | None) -> HarvesterError:
    return HarvesterError(
        f"copies {copies}: only the circuit with its external source and a resistor as load "
        "takes more than one"
    )
