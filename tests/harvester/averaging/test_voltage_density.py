"""p(V) of the closure `fokker_planck`: of mass 1, with the answer's mean square voltage."""

import numpy as np
import pytest

from harvester.averaging import average
from harvester.averaging.of_scene import averaged_device
from harvester.scene.model import Scene


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("linear", ["load.decay_rate=1e-3"]),
        ("linear", ["load.decay_rate=3e-3", "oscillator.damping=1.5"]),
        ("paper", []),
        ("paper", ["excitation.intensity=0.1"]),
        ("paper", ["excitation.intensity=1", "load.decay_rate=0.01"]),
        pytest.param("asymmetric", [], marks=pytest.mark.slow),
        pytest.param("asymmetric", ["load.resistance=117e3"], marks=pytest.mark.slow),
        pytest.param("tristable", [], marks=pytest.mark.slow),
        pytest.param("one_sided", [], marks=pytest.mark.slow),
        pytest.param(
            "duffing",
            ["load.decay_rate=1e-3", "excitation.intensity=0.5"],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_mass_and_mean_square(name, overrides):
    answer = average(averaged_device(Scene.load(name, overrides)))
    voltage, density = answer.density.tabulated("voltage")
    assert density.min() >= 0.0
    assert np.trapezoid(density, voltage) == pytest.approx(1.0, abs=1e-3)
    error = answer.numerical_error["mean_square_voltage"]
    found = np.trapezoid(density * voltage**2, voltage)
    assert found == pytest.approx(answer.mean_square_voltage, abs=error)


@pytest.mark.parametrize("rate", [1e-3, 0.05, 2.0])
def test_normal_voltage_of_a_linear_device(rate):
    """All is linear and driven by normal noise: so is V, whatever way its density is found."""
    answer = average(averaged_device(Scene.load("linear", [f"load.decay_rate={rate}"])))
    voltage, density = answer.density.tabulated("voltage")
    variance = answer.mean_square_voltage
    normal = np.exp(-0.5 * voltage**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    assert np.trapezoid(abs(density - normal), voltage) < 0.01
