"""p(V) of the closure `fokker_planck`: of mass 1, with the answer's mean square voltage."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.stats import norm

from harvester.averaging.closures import average
from harvester.averaging.flow import PhaseGrid, lagrange
from harvester.averaging.of_scene import average as average_scene
from harvester.averaging.of_scene import averaged_device
from harvester.averaging.voltage_density import density_of_charge
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

pytestmark = pytest.mark.usefixtures("shared_workers")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("linear", ["load.decay_rate=1e-3"]),
        ("linear", ["load.decay_rate=3e-3", "oscillator.damping=1.5"]),
        ("paper", []),
        ("paper", ["excitation.intensity=0.1"]),
        ("paper", ["excitation.intensity=1", "load.decay_rate=0.01"]),
        pytest.param("asymmetric", ["load.resistance=117e3"], marks=pytest.mark.exhaustive),
        pytest.param("one_sided", [], marks=pytest.mark.exhaustive),
        pytest.param(
            "duffing",
            ["load.decay_rate=1e-3", "excitation.intensity=0.5"],
            marks=pytest.mark.exhaustive,
        ),
    ],
)
def test_mass_and_mean_square(name, overrides):
    answer = average(averaged_device(prepared(Scene.read(name, overrides))))
    voltage, density = answer.density.tabulated("voltage")
    assert density.min() >= 0.0
    assert np.trapezoid(density, voltage) == pytest.approx(1.0, abs=1e-3)
    error = answer.numerical_error["mean_square_voltage"]
    found = np.trapezoid(density * voltage**2, voltage)
    assert found == pytest.approx(answer.mean_square_voltage, abs=error)


@pytest.mark.parametrize("rate", [1e-3, 0.05, 2.0])
def test_normal_voltage_of_a_linear_device(rate):
    """All is linear and driven by normal noise: so is V, whatever way its density is found."""
    answer = average(averaged_device(prepared(Scene.read("linear", [f"load.decay_rate={rate}"]))))
    voltage, density = answer.density.tabulated("voltage")
    variance = answer.mean_square_voltage
    normal = np.exp(-0.5 * voltage**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    assert np.trapezoid(abs(density - normal), voltage) < 0.01


@pytest.mark.parametrize("share_left_behind", [0.0, 0.02, 0.3])
def test_charge_left_behind_in_another_well(share_left_behind):
    """X in two wells, and Z near the same one or, less often, the other: sums of normal densities.

    Its nodes tell moments of Z alone, far apart against the width of either part.
    """
    places, width_of_x, width_of_z, slope = (-1.0, 1.0), 0.15, 0.12, 0.3
    x, v = np.linspace(-2.0, 2.0, 101), np.linspace(-1.0, 1.0, 9)
    z = 1.7 * leggauss(18)[0]
    fine, step = np.linspace(z[0], z[-1], 2001, retstep=True)
    shares, step_x = lagrange(fine, z) * step, x[1] - x[0]
    along, charge = np.zeros((x.size, z.size)), np.linspace(-4.0, 4.0, 2001)
    exact = np.zeros(charge.size)
    for well in places:
        for kept, share in ((well, 1.0 - share_left_behind), (-well, share_left_behind)):
            mass = 0.5 * share * norm.pdf(x, well, width_of_x) * step_x
            centre = kept + slope * (x[:, None] - well)
            along += mass[:, None] * (norm.pdf(fine, centre, width_of_z) @ shares)
            spread = np.hypot((1.0 - slope) * width_of_x, width_of_z)
            exact += 0.5 * share * norm.pdf(charge, well - kept, spread)
    mass = along[:, :, None] * norm.pdf(v, 0.0, 0.3) / norm.pdf(v, 0.0, 0.3).sum()
    grid = PhaseGrid(x, v, z, False, 1, 0.1)
    places, density = density_of_charge(grid, mass)
    found = np.interp(charge, places, density, 0.0, 0.0)
    assert np.trapezoid(abs(found - exact), charge) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("paper", []),
        pytest.param("paper", ["excitation.intensity=0.05"], marks=pytest.mark.exhaustive),
        pytest.param("asymmetric", [], marks=pytest.mark.exhaustive),
        pytest.param("tristable", [], marks=pytest.mark.exhaustive),
    ],
)
def test_distance_from_monte_carlo(name, overrides):
    """∫|Δp(V)| dV, to 0.006 beside what the run's noise adds in the mean."""
    scene = Scene.read(name, overrides)
    scene = scene.replace({"run.duration": 10.0 * scene.run.duration})
    seen = simulate(scene, method="monte-carlo").densities["voltage"]
    answer = average_scene(scene).densities["voltage"]
    found = np.interp(seen.centre, answer.centre, answer.density, 0.0, 0.0)
    width = seen.centre[1] - seen.centre[0]
    distance = np.sum(np.abs(found - seen.density)) * width
    # Of normal deviations the mean size is √(2/π) of the standard one.
    assert distance < 0.006 + np.sqrt(2.0 / np.pi) * np.sum(seen.standard_error) * width
