import numpy as np
import pytest

from harvester.averaging.of_scene import average
from harvester.scene.model import Scene


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["paper", "consistent"])
@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["excitation.intensity=1e-6"],
        ["stoppers.stiffness=1e6", "stoppers.gap=0.5"],
        ["excitation.intensity=100"],
    ],
)
def test_densities_are_tabulated_where_they_are_however_narrow(closure, overrides):
    result = average(Scene.read("paper", overrides), method=closure)
    for name, density in result.densities.items():
        assert np.all(np.diff(density.centre) > 0.0)
        mass = np.trapezoid(density.density, density.centre)
        square = np.trapezoid(density.density * density.centre**2, density.centre)
        assert mass == pytest.approx(1.0, abs=0.02)
        mean = result.scaled_quantities[f"mean_square_{name}"].estimate
        assert square == pytest.approx(mean, rel=0.02)
