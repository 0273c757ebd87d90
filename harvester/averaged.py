"""`average`: a scene by stochastic averaging, as a result like any engine's."""

import time

import numpy as np

from harvester.averaging import TOLERANCE
from harvester.averaging import average as average_parameters
from harvester.estimators import Density, Estimate, root
from harvester.parameters import scale
from harvester.results import Result

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
}


def average(scene, closure="consistent", tolerance=TOLERANCE):
    """Quantities and densities of a scene by stochastic averaging.

    Parameters
    ----------
    scene : Scene
    closure : str
        "paper" (Eqs. 10–37 as printed, slips corrected), "consistent" (the constant force of
        the piezo kept in the potential) or "slow_load" (the slow part of the piezo's charge
        followed beside the energy).
    tolerance : float
        Largest numerical error that is an answer, as a share of it.

    Returns
    -------
    Result
        `standard_error` holds the numerical error, from a coarser grid.

    Raises
    ------
    AveragingError
        Unknown closure, or one that does not hold for these parameters.
    """
    parameters, scales = scale(scene)
    clock = time.perf_counter()
    averages = average_parameters(parameters, closure, tolerance)
    quantities = {
        name: Estimate(
            float(getattr(averages, name)), averages.numerical_error[name], None, dimension
        )
        for name, dimension in DIMENSIONS.items()
    }
    quantities["rms_voltage"] = root(quantities["mean_square_voltage"])
    if parameters.linear_stiffness >= 0.0:
        del quantities["share_in_wells"]
    densities = {name: _tabulated(averages.density, name) for name in averages.density.names}
    seconds = time.perf_counter() - clock
    return Result(
        scene=scene,
        engine=f"averaging {closure}",
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
        notes=_notes(averages.validity),
        densities=densities,
    )


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
    grid = np.unique(np.concatenate([-half, half]))
    return Density(grid, density(grid), None, name)


def _notes(validity):
    """Sentences on the assumptions that end here."""
    return tuple(
        sentence.format(validity[name])
        for name, (limit, sentence) in ENDS.items()
        if validity.get(name, 0.0) > limit
    )
