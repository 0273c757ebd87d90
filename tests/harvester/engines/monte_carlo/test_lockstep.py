"""Averages of motions whose steps change their length at a stopper."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from harvester import simulate
from harvester.scene.model import Scene

GAP, STIFFNESS, RESTITUTION, DAMPING = 0.3, 500.0, 0.7, 0.12
SPRING, COUPLING, DECAY, FREQUENCY = 9.0, 0.4, 0.9, 0.6
SCENE = f"""
units = "scaled"
[oscillator]
damping = {DAMPING}
linear_stiffness = {SPRING}
cubic_stiffness = 0.0
[[stoppers]]
side = "right"
gap = {GAP}
stiffness = {STIFFNESS}
restitution = {RESTITUTION}
impact_velocity = "energy"
[piezo]
coupling = {COUPLING}
[start]
displacement = 0.0
velocity = 0.0
[load]
kind = "resistor"
decay_rate = {DECAY}
[excitation]
kind = "sine"
amplitude = 1.0
frequency = {FREQUENCY}
[run]
settle = {5 / FREQUENCY}
duration = {10 / FREQUENCY}
seed = 1
realizations = 1
"""


def means_by_scipy(stiffness, amplitude):
    """Means of V², X² and X'² over periods 5 to 15, by DOP853 with events."""
    omega, stop, marks = 2.0 * np.pi * FREQUENCY, 15 / FREQUENCY, {}

    def rates(t, y, touching):
        x, v, voltage = y[:3]
        force = amplitude * np.sin(omega * t) - DAMPING * v - SPRING * x - COUPLING * voltage
        if touching:
            depth = max(x - GAP, 0.0)
            gain = SPRING * (x * x - GAP * GAP) + 0.8 * stiffness * depth**2.5
            share = 0.75 * (1.0 - RESTITUTION**2) * v / np.sqrt(v * v + gain + 1e-300)
            force -= stiffness * depth**1.5 * (1.0 + share)
        return [v, force, v - DECAY * voltage, voltage**2, x * x, v * v]

    def edge(t, y, touching):
        return y[0] - GAP

    edge.terminal = True
    t, y, touching, ends = 0.0, np.zeros(6), False, [5 / FREQUENCY, stop]
    while ends:
        edge.direction = -1.0 if touching else 1.0
        found = solve_ivp(
            rates, (t, ends[0]), y, "DOP853", args=(touching,), events=edge, rtol=1e-9, atol=1e-11,
            max_step=0.002 if touching else 0.05,
        )  # fmt: skip
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 0:
            marks[ends.pop(0)] = y
        else:
            touching = not touching
            y[0] = GAP + (1e-13 if touching else -1e-13)
    return (y - marks[5 / FREQUENCY])[3:] / (10 / FREQUENCY)


@pytest.mark.slow
@pytest.mark.parametrize(("stiffness", "amplitude"), [(500.0, 1.0), (1e5, 2.0)])
def test_means_across_a_stopper(tmp_path, stiffness, amplitude):
    # Trapezoids alone give a power that is 0.2 % too high at the first, 0.4 % at the second.
    (tmp_path / "scene.toml").write_text(SCENE)
    overrides = [f"stoppers[0].stiffness={stiffness}", f"excitation.amplitude={amplitude}"]
    result = simulate(
        Scene.read(tmp_path / "scene.toml", overrides), method="monte-carlo", workers=1
    )
    names = ["mean_square_voltage", "mean_square_displacement", "mean_square_velocity"]
    found = [result.quantity(name).estimate for name in names]
    assert found == pytest.approx(means_by_scipy(stiffness, amplitude), rel=2e-4)
