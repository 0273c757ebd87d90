"""What steps cost a linear device under sines, against closed forms."""

import math

import numpy as np
import pytest

from harvester import Scene, simulate
from harvester.scene.prepared import prepared
from harvester.scene.steps import step_error


def coil(ratio, decays):
    """A device with a coil whose current decays so many times in a radian, and its mean power."""
    omega, mass, damping, load, winding = 100.0, 0.01, 0.05, 900.0, 100.0
    inductance, constant = (load + winding) / (decays * omega), math.sqrt(20.0)
    scene = Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {
                "mass": mass, "damping": damping, "restoring_force": [0.0, mass * omega**2],
            },
            "coil": {"coupling": constant, "resistance": winding, "inductance": inductance},
            "load": {"kind": "resistor", "resistance": load},
            "excitation": {
                "kind": "sine", "amplitude": 1.0, "frequency": ratio * omega / (2.0 * math.pi),
            },
            "run": {"seed": 1, "settle": 20.0, "duration": 2.0, "realizations": 1},
        },
        name="coil",
    )  # fmt: skip
    s = 1j * ratio * omega
    inertia = mass * (s**2 + omega**2) + damping * s
    loop = load + winding + s * inductance
    current = s * constant * mass / (inertia * loop + s * constant**2)
    return scene, 0.5 * load * abs(current) ** 2


@pytest.mark.usefixtures("shared_workers")
@pytest.mark.parametrize(
    ("ratio", "decays"),
    [
        pytest.param(1.1, 60.0, marks=pytest.mark.exhaustive),
        (0.97, 120.0),
        pytest.param(0.5, 60.0, marks=pytest.mark.exhaustive),
    ],
)
def test_a_current_that_decays_within_a_step_is_in_the_error_of_the_steps(ratio, decays):
    scene, power = coil(ratio, decays)
    found = simulate(scene, method="monte-carlo", workers=1)["mean_power"]
    off = abs(found.estimate - power)
    assert off < 1.5 * found.standard_error < 1e-3 * power
    if ratio > 0.9:
        # The decay taken exactly has order three: nothing else shows such an error.
        assert off > 0.5 * found.standard_error


def test_finer_steps_with_the_decay_taken_exactly_cost_less_by_their_cube():
    ready = prepared(coil(0.97, 400.0)[0])
    default, fine = (step_error(ready, step, "monte-carlo") for step in ("default", "fine"))
    assert np.log(default / fine) / np.log(4.0) == pytest.approx(3.0, abs=0.5)
