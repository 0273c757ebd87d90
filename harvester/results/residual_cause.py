"""The likeliest cause of an energy balance that does not close, from the run's own record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.device import timescales
from harvester.scene.passband import misplacement
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, steps_per_contact
from harvester.statistics.balance import stored_change
from harvester.statistics.moments import QUANTITIES

if TYPE_CHECKING:
    from harvester.results.result import Result

# The step is suspected when the residual is at most so many times (ω h)²/12, the error of the
# trapezoidal rule over one step h of the fastest motion, which has the angular frequency ω. Under
# noise far above the resonance that is the motion's mean frequency.
STEP_ERROR_FACTOR = 10.0
# A run counts as short when the energy stored in the device changes by at least this share of the
# energy that flows through it.
STORED_SHARE_OF_SHORT_RUNS = 0.5
# A residual is ascribed to load or damper when, over at least so many realizations, it has at least
# this correlation with what that part dissipates.
FEWEST_REALIZATIONS, LEAST_CORRELATION = 4, 0.98


def suspected_cause(result: Result) -> str:
    """One clause that names the likeliest cause of the energy balance residual, with evidence."""
    p = prepared(result.scene).system
    # Integrals of each realization, and the change of its stored energy.
    sums = np.array([m.integrals.sum(axis=0) for m in result.moments])
    totals = {name: sums[:, column] for column, name in enumerate(QUANTITIES)}
    stored = np.array([stored_change(m, p) for m in result.moments])
    finders = (_diverged, _active_load, _short_run, _load, _switching, _contacts, _step)
    for find in finders:
        cause = find(result, p, totals, stored)
        if cause:
            return cause
    return (
        "neither load, contacts, step nor length of the run explains it: compare a run with "
        "--step fine"
    )


def _diverged(result, p, totals, stored):
    """Whether energies are not finite."""
    if not (np.isfinite(result.energy_balance_residual) and np.all(np.isfinite(stored))):
        return (
            "the run diverged, its energies are not finite: look for a negative resistance or "
            "a gain that feeds back in the load"
        )


def _active_load(result, p, totals, stored):
    """Whether the load gives energy instead of taking it."""
    delivered = -totals["load_power"].sum()
    converter = result.scaled_quantities.get("mean_converter_loss")
    if delivered > 0.0:
        share = delivered / max(abs(totals["input_power"].sum()), delivered)
        return (
            f"the load is active: it delivers {share:.0%} of the energy that flows; take sources, "
            "negative resistances and gains that feed back out of its netlist"
        )
    if converter and converter.estimate < 0.0:
        return (
            "the load's output takes more than goes into the load: there is a source in its "
            "netlist, or its resistors and capacitors are not what was read"
        )


def _short_run(result, p, totals, stored):
    """Whether what the device stores changes by about as much as flows through it."""
    flow = max(abs(totals["input_power"].sum()), totals["load_power"].sum())
    share = np.abs(stored).sum() / flow if flow > 0.0 else np.inf
    if not share < STORED_SHARE_OF_SHORT_RUNS:
        return (
            f"the run is too short: the stored energy changes by {share:.2g} of what is put in, so "
            "that its ends matter; raise run.duration"
        )


def _load(result, p, totals, stored):
    """The clause for residuals that are proportional to the load's or the transducer's energy."""
    if len(stored) < FEWEST_REALIZATIONS:
        return None
    left = totals["input_power"] - totals["load_power"] - totals["loss_power"] - stored
    loss = totals["loss_power"] - totals["transducer_loss"]
    takers = {"load": totals["load_power"], "transducer": totals["transducer_loss"]}
    going = {name: _together(left, energy) for name, energy in takers.items()}
    absorbers = [
        name
        for name, share in going.items()
        if share >= max(LEAST_CORRELATION, _together(left, loss))
    ]
    if not absorbers or abs(result.energy_balance_residual) < _of_the_step(result):
        return None
    share = left.sum() / takers[absorbers[0]].sum()
    names = " or the ".join(absorbers)
    return (
        f"the {names}: the missing energy is proportional to what it takes, {share:+.2g} of it in "
        f"every realization; the circuit's {names} differs from the one that the power is computed "
        "with (its value, its parameters, a temperature or a multiplier)"
    )


def _together(left, taken):
    """Squared correlation of the residuals with an energy, through the origin."""
    squares = float(np.sum(left**2) * np.sum(taken**2))
    return float(np.sum(left * taken)) ** 2 / squares if squares > 0.0 else 0.0


def _switching(result, p, totals, stored):
    """Whether the load switches, and the step alone does not explain the residual."""
    load = result.scene.load.circuit
    if load and load.switches and not abs(result.energy_balance_residual) < _of_the_step(result):
        return (
            "the load's switches, coils or sources ask for shorter steps than these; choose a "
            "shorter --step"
        )


def _contacts(result, p, totals, stored):
    """Whether there were contacts that the steps do not resolve."""
    impacts = totals["impacts"].sum()
    resolving = steps_per_contact(prepared(result.scene), result.step, result.engine)
    if impacts and not timescales.contact_time(p) > resolving * result.step:
        return (
            f"contacts: {impacts:.0f} of about {timescales.contact_time(p):.2g} s each, against "
            f"steps of {result.step:.2g} s between them; choose a shorter --step"
        )


def _step(result, p, totals, stored):
    """Whether the residual is as large as the step's own error may be."""
    if not abs(result.energy_balance_residual) > _of_the_step(result):
        steps = 2.0 * np.pi / _fastest(result) / result.step
        return (
            f"the step: {result.step:.2g} s is {1.0 / steps:.2g} of the fastest period; choose a "
            "shorter --step"
        )


def _of_the_step(result):
    """The largest residual that the step explains, see `STEP_ERROR_FACTOR`."""
    return STEP_ERROR_FACTOR * (_fastest(result) * result.step) ** 2 / 12.0


def _fastest(result):
    """Angular frequency of the fastest motion, the device's own or that under the excitation."""
    prepared_scene = prepared(result.scene)
    natural = timescales.fastest_angular_frequency(prepared_scene.system)
    if prepared_scene.scene.excitation.prescribes_displacement:
        return natural
    # Far above the resonance E[X²] goes with the fourth power of the frequency.
    return max(natural, 0.5 * misplacement(prepared_scene, knot_spacing(prepared_scene), 2) ** 0.5)
