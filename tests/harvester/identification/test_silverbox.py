"""The Silverbox of nonlinearbenchmark.org, a measured electronic Duffing oscillator.

Its data are not ours to ship: `data/Silverbox/SNLS80mV.csv` of biaslab/nsi-silverbox on GitHub; the
variable SILVERBOX names the file.
"""

import os

import numpy as np
import pytest

from harvester.identification.identify import identify
from harvester.identification.measurement import Measurement
from harvester.scene.model import Scene

RATE = 1e7 / 2**14
# The published split (nonlinear_benchmarks): fitted to three quarters of the multisine; tested on
# the rest of it, and on the growing noise, all of it or as far as it stays within the multisine's
# amplitude; the first samples of a test are left out.
TRAIN = slice(40_650, 105_712)
TESTS = {
    "multisine": slice(105_712, 127_400),
    "within": slice(100, 32_100),
    "beyond": slice(100, 40_575),
}
LEFT_OUT = 50
# Published NRMSE of identified models (of freq-statespace, on the multisine); ours may be a fifth
# greater. Beyond the multisine's amplitude no linear model comes near: the best filter of 400
# coefficients, fitted there, leaves 23 %.
LINEAR, CUBIC, SHARE = 0.132, 0.011, 1.2

pytestmark = [
    pytest.mark.exhaustive,
    pytest.mark.skipif("SILVERBOX" not in os.environ, reason="SILVERBOX names no file"),
]


@pytest.fixture(scope="module")
def measured():
    """Input and output, without the offsets of their sensors."""
    values = np.genfromtxt(os.environ["SILVERBOX"], delimiter=",", skip_header=1)[:, :2]
    return values - values[TRAIN].mean(axis=0)


@pytest.mark.parametrize(
    ("stiffness", "published", "parts"),
    [((0.0, 1e5), LINEAR, ("multisine", "within")), ((0.0, 1e5, 0.0, 1e5), CUBIC, TESTS)],
    ids=["linear", "cubic"],
)
def test_the_published_errors_are_met(measured, stiffness, published, parts):
    scene = Scene.from_tables(
        {
            "units": "scaled",
            "oscillator": {"damping": 20.0, "restoring_force": list(stiffness)},
            "piezo": {"coupling": 0.0},
            "load": {"decay_rate": 1.0},
            "excitation": {"kind": "white", "intensity": 1.0},
            "run": {"duration": 10.0},
        },
        name="silverbox",
    )
    spring = [f"oscillator.restoring_force[{n}]" for n in range(1, len(stiffness), 2)]
    u, y = measured[TRAIN].T
    free = ["oscillator.damping", *spring, "sensor.acceleration_scale"]
    found = identify(scene, Measurement(u, RATE, displacement=y), free=free, compare=False)
    for part in parts:
        u, y = measured[TESTS[part]].T
        simulated = found.simulated(Measurement(u, RATE, displacement=y))["displacement"]
        error = (simulated - y)[LEFT_OUT:]
        assert np.sqrt(np.mean(error**2)) / np.std(y[LEFT_OUT:]) < SHARE * published, part
