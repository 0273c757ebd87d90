"""The stationary density of a table of force, against Gibbs's with scipy's own interpolation."""

import pytest
from device_scenes import MAGNETS
from device_truths import gibbs, gibbs_share
from scipy.integrate import quad

from harvester.averaging.of_scene import average
from harvester.device import timescales
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared


@pytest.mark.slow
@pytest.mark.parametrize(
    "interpolation", ["monotone", pytest.param("smooth", marks=pytest.mark.exhaustive)]
)
def test_the_density_of_a_table_is_gibbss(interpolation):
    scene = Scene.from_tables(
        {
            "units": "scaled",
            "oscillator": {
                "damping": 0.4,
                "force_table": MAGNETS,
                "force_interpolation": interpolation,
            },
            "piezo": {"coupling": 0.0},
            "load": {"decay_rate": 1.0},
            # Knots so close that the noise is white for every motion.
            "excitation": {"kind": "white", "intensity": 0.2, "knot_spacing": 0.025},
            "run": {"duration": 100.0},
        }
    )
    weight = gibbs(scene)
    total = quad(weight, -3.0, 3.0, limit=400)[0]
    square = quad(lambda x: x * x * weight(x), -3.0, 3.0, limit=400)[0] / total
    found = average(scene, method="fokker_planck", tolerance=5e-3)
    assert found.quantities["mean_square_displacement"].estimate == pytest.approx(square, rel=5e-3)
    assert found.quantities["mean_square_velocity"].estimate == pytest.approx(0.5, rel=5e-3)
    [saddle] = timescales.saddles(prepared(scene).system)
    right = gibbs_share(weight, saddle, 3.0, 3.0)
    assert found.quantities["share_of_time_in_well_2"].estimate == pytest.approx(right, rel=1e-2)
