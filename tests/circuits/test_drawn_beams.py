"""A bistable beam from its drawing: both engines against scipy with the dipoles written out."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from truths import Keep

from harvester.device.beam.lumped import lumped
from harvester.device.beam.magnets import Magnets
from harvester.engines.methods import MonteCarlo
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time

MAGNETS = {"distance": 8e-3, "reach": 6e-3, "tip_moment": 0.2, "frame_moment": 0.2}


def drawn():
    changes = {"excitation.intensity": 0.3, "run.duration": 0.2, "run.settle": 0.0}
    return Scene.read("bimorph").replace(changes | {"run.realizations": 1}, magnets=MAGNETS)


def scipys_path(scene, knots):
    """Displacements (m) and voltages at the knots by DOP853.

    The magnets' force is by complex steps of the dipoles' energy.
    """
    ready, made, magnets = prepared(scene), lumped(scene.beam), Magnets(**MAGNETS)
    length, spacing = ready.scales.displacement, knot_spacing(ready)
    noise = noise_path(ready, 0).read(knots + 1) * length
    strength, d = 1e-7 * magnets.tip_moment * magnets.frame_moment, magnets.distance
    slope, load = made.tip_slope, scene.load.resistance
    # What the modes left out add to the voltage for each unit of the noise, minus μ times the base.
    added = made.rest_charge / (made.base_factor * made.capacitance)

    def energy(x):
        r, along = np.sqrt(d**2 + x**2), d * np.cos(slope * x) - x * np.sin(slope * x)
        return -strength * (np.cos(slope * x) / r**3 - 3.0 * d * along / r**5)

    def derivative(t, y, start, rise):
        x, v, voltage = y
        force = made.stiffness * x + energy(x + 1e-30j).imag / 1e-30
        force += made.damping * v + made.coupling * voltage
        rate = (made.coupling * v - voltage / load) / made.capacitance + added * rise
        return [v, start + rise * t - force / made.mass, rate]

    state = np.array(start_state(ready, 0)) * [length, length, ready.scales.voltage]
    state[2] += added * noise[0]
    places = []
    for knot in range(knots):
        call = noise[knot], (noise[knot + 1] - noise[knot]) / spacing
        tolerances = {"rtol": 1e-11, "atol": [1e-14, 1e-12, 1e-11]}
        solved = solve_ivp(derivative, (0.0, spacing), state, "DOP853", args=call, **tolerances)
        state = solved.y[:, -1]
        places.append(state[[0, 2]])
    return np.array(places)


@pytest.mark.exhaustive
def test_both_engines_follow_scipys_path(pool):
    scene = drawn()
    ready = prepared(scene)
    spacing, length = knot_spacing(ready), ready.scales.displacement
    volts = ready.scales.voltage
    expected = scipys_path(scene, round(stop_time(ready) / spacing)) / [length, volts]
    nearness = 1e-4 * np.maximum(1.0, np.abs(expected).max(axis=0))
    keep = Keep()
    engine = MonteCarlo("finest")
    engine.run_realizations(ready, [noise_path(ready, 0)], [start_state(ready, 0)], [[keep]])
    assert (np.abs(keep.at_knots(spacing)[:, [0, 2]] - expected) < nearness).all()
    result = simulate(scene, step="finest", window=(0.0, 1e9), workers=1, runner=pool)
    waveform = np.array(result.waveform.record)
    knots = np.round(waveform[0] / spacing)
    at_knots = waveform[1:4:2, np.abs(waveform[0] - knots * spacing) < 1e-6 * spacing].T
    assert (np.abs(at_knots - expected) < nearness).all()
