"""The circuit of devices put together from parts, against scipy with the equations written out."""

import numpy as np
import pytest
from device_scenes import DEVICES, FOLLOWED, device
from device_truths import written_path

from harvester.engines.simulate import simulate
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time

EACH = [
    pytest.param(name, marks=() if name in FOLLOWED else pytest.mark.exhaustive, id=name)
    for name in DEVICES
]


def deviations(pool, scene, steps):
    """Greatest distance of X from scipy's path for each step, and the energies' residuals."""
    ready = prepared(scene)
    scales = ready.scales
    spacing = knot_spacing(ready)
    reference = written_path(scene, round(stop_time(ready) / spacing))[1:, 0] / scales.displacement
    found, residuals = [], []
    for step in steps:
        result = simulate(
            scene, step=step, device="behavioural", window=(0.0, 1e9), workers=1, runner=pool
        )
        waveform = np.array(result.waveform.record)
        knots = np.round(waveform[0] / spacing)
        at_knots = waveform[1, np.abs(waveform[0] - knots * spacing) < 1e-6 * spacing]
        found.append(np.abs(at_knots - reference).max())
        residuals.append(abs(result.energy_balance_residual))
    return found, residuals


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH)
def test_the_circuit_follows_scipys_path(pool, name):
    found, residuals = deviations(pool, device(name), ["fine", "finest"])
    assert found[-1] < 2e-4
    # Of order two, 64 times less at an eighth of the step.
    assert found[0] > 20.0 * found[1]
    assert max(residuals) < 5e-4
