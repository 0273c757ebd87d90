"""Steps end where a source bends, however short its pulses."""

import numpy as np
import pytest

from circuits.kernel import waveform
from harvester import Scene, simulate

# Numbers of sources as tables hold them: sign, first and last corner, and seven of their own.
PULSES = np.array([1.0, 0.0, 0.0, 0.0, 5.0, 0.1, 0.02, 0.03, 0.2, 1.0])
ONE_PULSE = np.array([1.0, 0.0, 0.0, 0.0, 5.0, 0.1, 0.02, 0.03, 1e30, 1e30])
SINE = np.array([1.0, 0.0, 0.0, 0.0, 5.0, 50.0, 0.3, 0.0, 0.0, 0.0])
LINES = np.array([1.0, 0.0, 3.0, *np.zeros(7)])
CORNERS = np.array([[0.0, 0.0], [0.5, 1.0], [0.5001, 0.0]])


@pytest.mark.parametrize(
    ("kind", "row", "times"),
    [
        (waveform.PULSE, PULSES, [0.1, 0.12, 0.32, 0.35, 1.1, 1.12, 1.32, 1.35, 2.1]),
        (waveform.PULSE, ONE_PULSE, [0.1, 0.12, 1e30]),
        (waveform.SINE, SINE, [0.3, np.inf]),
        (waveform.LINES, LINES, [0.5, 0.5001, np.inf]),
        (waveform.EXPONENTIAL, PULSES, [0.03, 0.1, np.inf]),
    ],
    ids=["pulses", "one pulse", "sine", "lines", "exponential"],
)
def test_corners_in_turn(kind, row, times):
    """Each is found from the one before."""
    time, found = 0.0, []
    while np.isfinite(time) and len(found) < len(times):
        time = waveform.next_corner(kind, row, CORNERS, time)
        found.append(time)
    assert found == pytest.approx(times)


GATE = """.subckt gated p n
R1 p n 1Meg
Vg g n pulse(0 5 0.0101 1u 1u 200u 20m)
S1 p n g n gate
.model gate sw(vt=2.5 vh=0.1 ron=100 roff=1g)
.ends
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["monte-carlo", "circuit"])
def test_a_gate_shorter_than_a_step(tmp_path, method):
    """Both engines at their default steps discharge the piezo as the finest steps do.

    Where the gates are missed E[V²] is more than twice as large.
    """
    path = tmp_path / "gated.lib"
    path.write_text(GATE)
    scene = Scene.read("device").replace(
        {
            "load": {"netlist": str(path)},
            "oscillator.linear_stiffness": 120.0,
            "oscillator.cubic_stiffness": 0.0,
            "run.duration": 0.5,
            "run.settle": 0.0,
            "run.realizations": 1,
        }
    )
    usual = simulate(scene, method=method)["mean_square_voltage"].estimate
    finest = simulate(scene, method="monte-carlo", step="finest")["mean_square_voltage"].estimate
    assert usual == pytest.approx(finest, rel=0.02)
