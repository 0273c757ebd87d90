"""The engines that simulate a scene, behind one protocol."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from harvester.registry import Registry
from harvester.scene.units import require_mass

if TYPE_CHECKING:
    from harvester.scene.model import Scene


class Engine(NamedTuple):
    """One way to simulate realizations of a scene, in a worker process.

    Each function imports its engine when it is called: what needs no SPICE loads none.

    Attributes
    ----------
    check : callable
        Of a scene: refuses what the engine does not take, before anything runs.
    prepare : callable
        Of a scene: loads libraries and compiled code, so that they do not count as simulation.
    run_realizations : callable
        Of scene, paths, starts, observers, step, source, scheme, tolerance, device and, for a load
        with an output side in the circuit, outputs; see `circuits.ngspice.engine`. It hands every
        record to the observers and returns engine_version and netlist_sha256 as a dictionary.
    schemes : tuple of str
        Integration schemes, the default first.
    """

    check: Callable
    prepare: Callable
    run_realizations: Callable
    schemes: tuple[str, ...]


def _prepare_circuit(scene: Scene) -> None:
    from circuits.ngspice import engine

    engine.prepare(scene)


def _run_circuit(*arguments: Any, **options: Any) -> dict[str, str]:
    from circuits.ngspice import engine

    return engine.run_realizations(*arguments, **options)


def _integrator(scene: Scene) -> Any:
    """Monte Carlo's loop for a resistor as load, or the one for a netlist."""
    if scene.load.is_resistor:
        from harvester.monte_carlo import engine as resistor

        return resistor
    from circuits.kernel import engine as netlist

    return netlist


def _check_monte_carlo(scene: Scene) -> None:
    """Refuse what Monte Carlo does not take: a motion prescribed, some elements of a load.

    Raises
    ------
    LoadError
    """
    require_mass(scene, "Monte Carlo")
    if not scene.load.is_resistor:
        _integrator(scene).circuit_of(scene)


def _prepare_monte_carlo(scene: Scene) -> None:
    _integrator(scene).prepare(scene)


def _run_monte_carlo(scene: Scene, *arguments: Any, **options: Any) -> dict[str, str | None]:
    return _integrator(scene).run_realizations(scene, *arguments, **options)


def _takes_everything(scene: Scene) -> None:
    """The circuit refuses while it reads a load."""


ENGINES: Registry[Engine] = Registry(
    "harvester.engines",
    {
        "circuit": Engine(
            _takes_everything, _prepare_circuit, _run_circuit, schemes=("trapezoidal", "gear")
        ),
        "monte-carlo": Engine(
            _check_monte_carlo,
            _prepare_monte_carlo,
            _run_monte_carlo,
            schemes=("runge-kutta", "heun"),
        ),
    },
)
