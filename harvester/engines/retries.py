"""Options of ngspice to retry with if Newton's iterations fail, in the order users try them.

Gear's rule, steps a quarter as long from the first one on, a source ramp, gmin, and a capacitance
from each node to ground. The last three change the circuit. They are used if twice the value
changes no energy by more than `NEGLIGIBLE`, and if the energy balance holds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from circuits.netlist.kinds import BATTERY, LOSS, OUTPUT, SUPPLY
from harvester.base.errors import NotConverged, SimulatorAborted, SolutionDiverged
from harvester.engines.methods import Circuit, Engine
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.statistics.balance import energy_balance_residual
from harvester.statistics.measures import CHANGE
from harvester.statistics.moments import QUANTITIES
from harvester.statistics.output_moments import QUANTITIES as OUTPUT_QUANTITIES

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.scene.prepared import Prepared
    from harvester.statistics.moments import Moments

# Largest relative change of the energies by an option, and largest energy balance residual.
NEGLIGIBLE, CONVERGED_RESIDUAL = 0.005, 0.01
FINER = 4
GMIN = 1e-10
# Capacitances of each node to ground, as shares of the transducer's.
SHUNTS = 1e-4, 1e-3
# Largest number of the load's expressions that are named.
MOST_NAMED = 3


def run_converged(prepared_scene: Prepared, engine: Engine, simulate: Callable) -> list[Any]:
    """Realizations of `simulate(engine)`, with the first option that converges if it fails.

    Parameters
    ----------
    prepared_scene : Prepared
    engine : Engine
    simulate : callable
        Function of an engine that returns a list of `Realization`.

    Raises
    ------
    SimulationError
        All options failed: the message names the element and the options.
    """
    try:
        return simulate(engine)
    except (NotConverged, SolutionDiverged) as error:
        load = prepared_scene.scene.load
        if not isinstance(engine, Circuit) or load.is_resistor or engine.source == "pwl":
            raise
        failure = error
    tried = []
    for words, aided, doubled in _options(prepared_scene, engine):
        try:
            realizations = simulate(aided)
            others = simulate(doubled) if doubled else realizations
            reason = _too_large(prepared_scene.system, realizations, others)
        except (NotConverged, SolutionDiverged):
            tried.append(words)
            continue
        if not reason:
            note = f"ngspice converged only with {words}; without: {_trouble(failure)}"
            if doubled:
                note += f" (energies change by less than {NEGLIGIBLE:.1%} with twice the value)"
            for realization in realizations:
                realization.moments.note = note
            return realizations
        tried.append(f"{words} (refused: {reason})")
    steep = (source.place for source in load.circuit.elements if source.expression)
    raise SimulatorAborted(
        f"{failure}; tried without success: {'; '.join(tried)}; give the node a capacitor, "
        f"or smooth {', '.join(itertools.islice(steep, MOST_NAMED)) or 'the elements at it'}",
        failure.partial,
    )


def _trouble(failure):
    """The node or element at which Newton's iterations failed, without the realization's number."""
    return str(failure).partition("trouble with ")[2] or str(failure)


def _options(
    prepared_scene: Prepared, engine: Circuit
) -> Iterator[tuple[str, Circuit, Circuit | None]]:
    """Each option: its description, the engine with it, and with twice its value if it has one."""
    spacing = knot_spacing(prepared_scene)
    if engine.scheme != "gear":
        yield "Gear's rule", replace(engine, scheme="gear"), None
    steps = FINER * steps_per_sample(prepared_scene, engine.step)
    yield "steps a quarter as long", replace(engine, step=spacing / steps), None
    values = {"gmin": GMIN}
    if prepared_scene.scene.load.circuit.sources:
        values = {"ramp": spacing} | values
    capacitance = prepared_scene.network.reference_capacitance
    shunts = [("cshunt", share * capacitance) for share in SHUNTS]
    for name, value in [*values.items(), *shunts]:
        words = {
            "ramp": f"the sources ramped up within {value:.2g} s",
            "gmin": f"gmin = {value:.1g} S",
            "cshunt": f"cshunt = {value:.2g} F from each node to ground",
        }[name]
        one: dict[str, Any] = {name: value, "scheme": "gear"}
        two: dict[str, Any] = {name: 2.0 * value, "scheme": "gear"}
        yield f"Gear's rule and {words}", replace(engine, **one), replace(engine, **two)


def _too_large(system: System, realizations: list[Any], doubled: list[Any]) -> str:
    """Why an option that changes the circuit is not used; empty if its effect is negligible."""
    moments, others = ([one.moments for one in runs] for runs in (realizations, doubled))
    residual = abs(energy_balance_residual(moments, system))
    if not residual <= CONVERGED_RESIDUAL:
        return f"energy balance residual {residual:.1%}"
    change = max(map(_change, moments, others))
    return "" if change <= NEGLIGIBLE else f"changes the energies by {change:.1%}"


def _change(moments: Moments, others: Moments) -> float:
    """Largest relative difference between the energies of two runs.

    The differences of the input and of the energy from the transducer are relative to these
    energies; those of the output, stores and sources are relative to the energy from the
    transducer.
    """
    columns = [QUANTITIES.index("input_power"), QUANTITIES.index("load_power")]
    sums = np.array([run.integrals[:, columns].sum(axis=0) for run in (moments, others)])
    differences = np.abs(sums[1] - sums[0]) / np.abs(sums[0])
    if moments.output is not None and others.output is not None:
        output = np.array([_energies(output) for output in (moments.output, others.output)])
        differences = np.append(differences, np.abs(output[1] - output[0]) / abs(sums[0, 1]))
    return float(np.max(differences))


def _energies(output):
    """Energies of a load's output, stores and sources."""
    kinds = OUTPUT, LOSS, SUPPLY, BATTERY
    powers = [row for row, (kind, _) in enumerate(output.rows) if kind in kinds]
    square = output.integrals[:, OUTPUT_QUANTITIES.index("square_voltage")].sum()
    measured = output.measured[:, powers, 0].sum(axis=0)
    return np.append(measured, [output.conductance * square, output.stored[:, CHANGE].sum()])
