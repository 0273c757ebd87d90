"""Circuit and Monte Carlo on the same noise: means within the errors of their differences."""

import math

import pytest
from device_scenes import DEVICES, SCALED

from harvester.engines.simulate import simulate
from harvester.results.paired import paired_difference
from harvester.scene.model import Scene

EACH = [
    pytest.param("bias and quadratic term", marks=pytest.mark.exhaustive),
    pytest.param("tristable, degree 5", marks=pytest.mark.exhaustive),
    pytest.param("one-sided stopper", marks=pytest.mark.exhaustive),
    pytest.param("uneven stoppers", marks=pytest.mark.slow),
    pytest.param("quadratic damping", marks=pytest.mark.exhaustive),
]
COMPARED = (
    "mean_square_displacement",
    "mean_square_velocity",
    "mean_square_voltage",
    "mean_power",
    "mean_input_power",
    "mean_loss_power",
    "power_conversion_efficiency",
)
# So much that two paths on the same noise stay together, and their difference has a small error.
DAMPING = 0.8
# Standard error of the steps, as a share: of second order, 16 times less than the default ones'.
STEP_ERROR = 2e-4


@pytest.mark.parametrize("name", EACH)
def test_the_means_of_circuit_and_monte_carlo_agree(pool, name):
    """Within 3 joint standard errors of at most 0.5 %; false alarm under 2 % for the seven."""
    tables = {**SCALED, **DEVICES[name]}
    tables["oscillator"] = {**tables["oscillator"], "damping": DAMPING}
    tables["run"] = {"duration": 40.0, "settle": 10.0, "seed": 5, "realizations": 32}
    scene = Scene.from_tables(tables, name=name)
    circuit = simulate(scene, method="circuit", step="fine", runner=pool)
    monte_carlo = simulate(scene, method="monte-carlo", step="fine", runner=pool)
    differences = paired_difference(circuit, monte_carlo)
    for quantity in COMPARED:
        difference = differences[quantity]
        joint_error = math.hypot(difference.standard_error, STEP_ERROR)
        assert joint_error < 0.005, quantity
        assert abs(difference.estimate) < 3.0 * joint_error, quantity
