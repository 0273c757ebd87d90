"""`average`: a scene by stochastic averaging, as a result like any engine's."""

import math
import time
from dataclasses import replace

import numpy as np

from harvester.averaging import average as average_parameters
from harvester.averaging.symmetric import symmetric_device
from harvester.device import timescales
from harvester.errors import AveragingError
from harvester.estimates.estimate import Density, Estimate, root
from harvester.excitation import OrnsteinUhlenbeck, RecordedMotion
from harvester.excitation.spectrum_fit import fit_spectrum
from harvester.results import Result
from harvester.scene.units import require_resistor, scale

DIMENSIONS = {
    "mean_square_voltage": "voltage^2",
    "mean_power": "power",
    "power_conversion_efficiency": "1",
    "mean_square_displacement": "displacement^2",
    "mean_square_velocity": "velocity^2",
    "share_in_wells": "1",
}
# Points of half a density's grid: evenly spaced, and where orbits crowd.
EVEN = 100
LANDMARKS = 100
# Densities are given as far out as they exceed this share of their peak.
NEGLIGIBLE = 1e-6
# Beyond which a number of `Averages.validity` becomes a note, and what it says there.
ENDS = {
    "correlation_time_over_relaxation_time": (
        0.05,
        "the noise is remembered for {:.2g} of the energy's relaxation time: averaging takes it "
        "to forget at once",
    ),
    "decay_rate_over_orbit_frequency": (
        0.3,
        "the load's decay rate is {:.2g} of the orbits' angular frequency: its charge is no "
        "longer slow",
    ),
    "share_near_separatrix": (
        0.3,
        "{:.0%} of the probability lies within one noise kick of the separatrix, where the noise "
        "outlasts the energy",
    ),
    "noise_kept_to_the_next_pass": (
        0.05,
        "{:.2g} of the noise, by its share in what jumps add to the mean square voltage, is still "
        "there at the next pass of the separatrix: averaging takes it for new",
    ),
    "contact_loss_in_a_turn": (
        0.3,
        "the stoppers take {:.2g} of the mean square velocity in a turn of the orbits: averaging "
        "takes that for little",
    ),
}
INSTEAD = "the closure fokker_planck takes none of this for granted"


def average(scene, closure="slow_load", tolerance=None, fit=False):
    """Quantities and densities of a scene by stochastic averaging.

    Parameters
    ----------
    scene : Scene
    closure : str
        "paper" (Eqs. 10–37 as printed, slips corrected), "consistent" (the constant force of
        the piezo kept in the potential), "slow_load" (the slow part of the piezo's charge
        followed beside the energy) or "fokker_planck" (nothing averaged: the stationary density).
    fit : bool
        Of a record: take the Ornstein–Uhlenbeck noise that fits its spectrum, whose evidence is
        in `Result.spectrum_fit` and `notes`.
    tolerance : float, optional
        Largest numerical error that is an answer, as a share of it; by default 1e-3, and 2e-2 of
        `fokker_planck`.

    Returns
    -------
    Result
        `standard_error` holds the numerical error, from a coarser grid.

    Raises
    ------
    AveragingError
        Unknown closure, or one that does not hold for these parameters.
    LoadError
        The load is no resistor.
    """
    require_resistor(scene, "stochastic averaging")
    clock = time.perf_counter()
    spectrum_fit, noise = None, scene
    if fit:
        spectrum_fit, noise = _fitted(scene)
    parameters = averaged_device(noise)
    _, scales = scale(noise)
    averages = average_parameters(parameters, closure, tolerance)
    quantities = estimates_of(averages)
    quantities["rms_voltage"] = root(quantities["mean_square_voltage"])
    if parameters.linear_stiffness >= 0.0:
        quantities.pop("share_in_wells", None)
    densities = {name: _tabulated(averages.density, name) for name in averages.density.names}
    seconds = time.perf_counter() - clock
    return Result(
        scene=scene,
        engine=f"averaging {closure}" + (" of fitted noise" if fit else ""),
        scaled_quantities=quantities,
        scales=scales,
        error_kind="numerical",
        energy_balance_residual=None,
        wall_seconds=seconds,
        engine_seconds=seconds,
        simulated_time=0.0,
        steps=0,
        step=None,
        realizations=0,
        engine_version=f"stochastic averaging, closure {closure}",
        netlist_sha256=None,
        densities=densities,
        notes=(*(spectrum_fit.notes() if fit else ()), *_notes(averages.validity)),
        spectrum_fit=spectrum_fit,
    )


def averaged_device(scene):
    """A scene's device in the form that the closures take.

    Raises
    ------
    LoadError
        The load is no resistor.
    AveragingError
        Its excitation is no noise that can be averaged over, or the device has other parts.
    """
    require_resistor(scene, "stochastic averaging")
    refusal = scene.excitation.averaging_refusal()
    if refusal:
        raise AveragingError(f'excitation.kind = "{scene.excitation.kind}": {refusal}')
    return symmetric_device(scale(scene)[0])


def estimates_of(averages):
    """Those of `DIMENSIONS` that a closure gives, as estimates with its numerical error."""
    return {
        name: Estimate(
            float(getattr(averages, name)), averages.numerical_error[name], None, dimension
        )
        for name, dimension in DIMENSIONS.items()
        if name in averages.numerical_error
    }


def _fitted(scene):
    """The fit to the scene's record, and the scene with the fitted noise."""
    if not isinstance(scene.excitation, RecordedMotion):
        raise AveragingError(
            f'excitation.kind = "{scene.excitation.kind}": only a record is fitted (--fit)'
        )
    parameters, scales = scale(scene)
    found = fit_spectrum(
        scene.excitation, timescales.angular_frequency(parameters) / (2.0 * math.pi)
    )
    noise = OrnsteinUhlenbeck(found.intensity, found.correlation_time)
    # The length unit stays the one of the scene.
    length = scales.displacement if scene.units == "SI" else None
    return found, replace(scene, excitation=noise, length_scale=length)


def _tabulated(densities, name):
    """A density on a grid that reaches as far as it matters and is finer where orbits crowd."""
    density = getattr(densities, name)
    landmarks = densities.landmarks(name)
    rough = landmarks[np.linspace(0, landmarks.size - 1, LANDMARKS).astype(int)]
    values = density(rough)
    matters = np.flatnonzero(values > NEGLIGIBLE * values.max())
    # One point further to either side, where it no longer matters.
    first, last = rough[max(matters[0] - 1, 0)], rough[min(matters[-1] + 1, LANDMARKS - 1)]
    landmarks = landmarks[(landmarks >= first) & (landmarks <= last)]
    landmarks = landmarks[np.linspace(0, landmarks.size - 1, LANDMARKS).astype(int)]
    half = np.concatenate([np.linspace(first, last, EVEN), landmarks])
    half = np.unique(half)
    values = density(half)
    mirrored = slice(None, 0 if half[0] == 0.0 else None, -1)
    grid = np.append(-half[mirrored], half)
    return Density(grid, np.append(values[mirrored], values), None, name)


def _notes(validity):
    """Sentences on the assumptions that end here."""
    ended = [
        sentence.format(validity[name])
        for name, (limit, sentence) in ENDS.items()
        if validity.get(name, 0.0) > limit
    ]
    return (*ended, INSTEAD) if ended else ()
