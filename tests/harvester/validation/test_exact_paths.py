"""The independent path and Monte Carlo at its finest step solve every device alike."""

import every_command
import numpy as np
import pytest

from harvester.engines.methods import MonteCarlo
from harvester.engines.realization import run
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.validation import exact_paths

KNOTS = 120
# Enough noise to meet the stoppers within these knots.
LOUD = {"uneven stoppers": 0.5, "held impact velocity": 2.0, "paper": 2.0}


# A held speed, drag, a start; the rest by `make test-all`.
FOLLOWED = ("held impact velocity", "leak and drag", "start")
EACH = [
    pytest.param(name, marks=() if name in FOLLOWED else pytest.mark.exhaustive, id=name)
    for name in sorted(set(every_command.DEVICES) - {"device", "duffing", "linear", "paper_si"})
]


@pytest.mark.parametrize("device", EACH)
def test_monte_carlo_follows_the_independent_path(device):
    name, overrides = every_command.DEVICES[device]
    scene = Scene.read(name, overrides)
    spacing = knot_spacing(prepared(scene))
    scene = scene.replace(
        {
            "run.duration": KNOTS * spacing,
            "run.settle": 0.0,
            "run.realizations": 1,
            "excitation.knot_spacing": spacing,
            "excitation.intensity": LOUD.get(device, scene.excitation.intensity),
        }
    )
    reference = exact_paths.run(prepared(scene), 0, None)
    window = (0.0, 2.0 * scene.run.duration)
    [realization] = run(prepared(scene), MonteCarlo("finest"), [0], window, lambda _: None)
    record = realization.waveform
    times = spacing * np.arange(1, KNOTS + 1)
    for column, quantity in enumerate(("displacement", "velocity", "voltage")):
        found = np.interp(times, record.time, getattr(record, quantity))
        size = np.abs(reference[:, column]).max()
        np.testing.assert_allclose(found, reference[:, column], atol=1e-6 * size)
