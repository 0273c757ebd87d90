"""The likeliest cause of an energy balance that does not close, from the run's own record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.device import timescales
from harvester.scene.passband import misplacement
from harvester.scene.steps import knot_spacing, steps_per_contact
from harvester.statistics.balance import stored_change
from harvester.statistics.moments import QUANTITIES

if TYPE_CHECKING:
    from harvester.results.result import Result

# The step is suspected if the residual is at most this multiple of (ω h)²/12, the error of the
# trapezoidal rule over one step h of the fastest motion, which has the angular frequency ω. Under
# noise far above the resonance that is the motion's mean frequency.
STEP_ERROR_FACTOR = 10.0
# A run counts as short when the energy stored in the device changes by at least this share of the
# energy that flows through it.
STORED_SHARE_OF_SHORT_RUNS = 0.5
# A residual is ascribed to a part (load or transducer) if it correlates with the dissipation of
# that part at least this well, over at least this number of realizations.
FEWEST_REALIZATIONS, LEAST_CORRELATION = 4, 0.98


def suspected_cause(result: Result) -> str:
    """The likeliest cause of the energy balance residual, with evidence, as one clause."""
    return next(_causes(result))


def _causes(result):
    """Clauses on the causes that the evidence suggests, the most certain first."""
    prepared_scene = result.prepared_scene
    scene = prepared_scene.scene
    system, converter = prepared_scene.system, result.scaled_quantities.get("mean_converter_loss")
    # Integrals of each realization, and the change of its stored energy.
    sums = np.array([m.integrals.sum(axis=0) for m in result.moments])
    totals = {name: sums[:, column] for column, name in enumerate(QUANTITIES)}
    stored = np.array([stored_change(m, system) for m in result.moments])
    put_in, delivered = totals["input_power"].sum(), totals["load_power"].sum()
    if not (np.isfinite(result.energy_balance_residual) and np.all(np.isfinite(stored))):
        yield (
            "the run diverged, its energies are not finite: look for a negative resistance or "
            "a gain that feeds back in the load"
        )
    if delivered < 0.0:
        yield (
            f"the load is active: it delivers {-delivered / max(abs(put_in), -delivered):.0%} of "
            "the energy flow; remove sources, negative resistances and feedback gains from "
            "its netlist"
        )
    if converter and converter.estimate < 0.0:
        yield (
            "the load's output takes more energy than enters the load: there is a source in its "
            "netlist, or its resistors and capacitors differ from the values that were read"
        )
    flow = max(abs(put_in), delivered)
    share = np.abs(stored).sum() / flow if flow > 0.0 else np.inf
    if not share < STORED_SHARE_OF_SHORT_RUNS:
        yield (
            f"the run is too short: the stored energy changes by {share:.2g} of the input; "
            f"{scene.excitation.longer_run(scene.run)}"
        )
    fastest = _fastest(prepared_scene)
    beyond_steps = (
        abs(result.energy_balance_residual)
        >= STEP_ERROR_FACTOR * (fastest * result.step) ** 2 / 12.0
    )
    missing = totals["input_power"] - totals["load_power"] - totals["loss_power"] - stored
    absorbers = _absorbers(totals, missing)
    if absorbers and beyond_steps:
        share = missing.sum() / next(iter(absorbers.values())).sum()
        names = " or the ".join(absorbers)
        yield (
            f"the {names}: the missing energy is proportional to its dissipation (ratio "
            f"{share:+.2g}); the circuit's {names} differs from the {names} that the power is "
            "computed with: check value, parameters, temperature and multiplier"
        )
    load = result.scene.load.circuit
    if load and load.switches and beyond_steps:
        yield ("the load's switches, coils or sources need shorter steps; choose a shorter step")
    impacts, contact_time = totals["impacts"].sum(), timescales.contact_time(system)
    resolving = steps_per_contact(prepared_scene, result.step, result.engine)
    if impacts and not contact_time > resolving * result.step:
        yield (
            f"contacts: {impacts:.0f} of about {contact_time:.2g} s each, against "
            f"steps of {result.step:.2g} s between them; choose a shorter step"
        )
    if not beyond_steps:
        yield (
            f"the step: {result.step:.2g} s is {fastest * result.step / (2.0 * np.pi):.2g} of the "
            "fastest period; choose a shorter step"
        )
    yield (
        "neither load, contacts, step nor length of the run explains it: compare a run with "
        "step = fine"
    )


def _absorbers(totals, missing):
    """Dissipation of every part that correlates with the missing energy better than the loss."""
    if len(missing) < FEWEST_REALIZATIONS:
        return {}
    loss = totals["loss_power"] - totals["transducer_loss"]
    least = max(LEAST_CORRELATION, _together(missing, loss))
    energies = {"load": totals["load_power"], "transducer": totals["transducer_loss"]}
    return {
        name: energy for name, energy in energies.items() if _together(missing, energy) >= least
    }


def _together(missing, energy):
    """Squared correlation of the residuals with an energy, through the origin."""
    squares = float(np.sum(missing**2) * np.sum(energy**2))
    return float(np.sum(missing * energy)) ** 2 / squares if squares > 0.0 else 0.0


def _fastest(prepared_scene):
    """Angular frequency of the fastest motion, the device's own or that under the excitation."""
    natural = timescales.fastest_angular_frequency(prepared_scene.system)
    if prepared_scene.scene.excitation.prescribes_displacement:
        return natural
    # Far above the resonance E[X²] goes with the fourth power of the frequency.
    return max(natural, 0.5 * misplacement(prepared_scene, knot_spacing(prepared_scene), 2) ** 0.5)
