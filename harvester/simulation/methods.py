"""What every engine offers, and the engines there are."""

from collections.abc import Callable
from typing import NamedTuple

from harvester.monte_carlo import engine as monte_carlo
from harvester.simulation import circuit


class Engine(NamedTuple):
    """One way to simulate realizations of a scene, in a worker process.

    Attributes
    ----------
    prepare : callable
        Of a scene: loads libraries and compiled code, so that they do not count as simulation.
    run_realizations : callable
        Of scene, paths, starts, observers, step, source, scheme, tolerance, device and, for a load
        with an output side in the circuit, outputs; see `circuits.ngspice.engine`. It hands every
        record to the observers and returns engine_version and netlist_sha256 as a dictionary.
    schemes : tuple of str
        Integration schemes, the default first.
    """

    prepare: Callable
    run_realizations: Callable
    schemes: tuple


ENGINES = {
    "circuit": Engine(circuit.prepare, circuit.run_realizations, ("trapezoidal", "gear")),
    "monte-carlo": Engine(
        monte_carlo.prepare, monte_carlo.run_realizations, ("runge-kutta", "heun")
    ),
}
