"""A bridge of near-ideal parts on narrow-band noise, against a closed form.

Bridge and SECE under a sine are entries of `harvester verify`.
"""

import numpy as np
import pytest
from scipy.special import erfc

from circuits.kernel.engine import circuit_of, integrate
from circuits.netlist.part_values import conductance
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import steps_per_sample, stop_time


def scene_of(coupling, capacitance, damping, excitation, load, run):
    """Mass and stiffness 1, SI."""
    tables = {
        "units": "SI",
        "length_scale": 1.0,
        "oscillator": {"mass": 1.0, "damping": damping, "linear_stiffness": 1.0},
        "piezo": {"coupling": coupling, "capacitance": capacitance},
        "excitation": excitation,
        "load": load,
        "run": {"seed": 1, "realizations": 1, **run},
    }
    tables["oscillator"]["cubic_stiffness"] = 0.0
    return Scene.from_tables(tables, name="unit", origin="unit")


def powers(scene):
    """(into the load, into its output's resistors, W; rms displacement, m) in the measured time."""
    ready = prepared(scene)
    s, scales = ready.system, ready.scales
    circuit = circuit_of(prepared(scene))
    fixed = steps_per_sample(ready, "default", "monte-carlo")
    path, stop, start = (
        noise_path(ready, 0),
        stop_time(ready),
        start_state(ready, 0),
    )
    found = [
        np.array([record.time, record.load_power, volts**2, record.displacement**2])
        for record, (volts, *_) in integrate(s, circuit, path, start, stop, fixed)
    ]
    columns = np.concatenate(found, axis=1)
    columns = columns[:, columns[0] >= scene.run.settle]
    length = columns[0, -1] - columns[0, 0]
    into, square, place = np.trapezoid(columns[1:], columns[0], axis=1) / length
    used = conductance(circuit.load.across_output) * square * scales.voltage**2
    return into * scales.power, used, np.sqrt(place) * scales.displacement


HELD = """* a bridge into a voltage that is held
.subckt held p n
.model d d(is=1e-8 n=0.1)
D1 p out d
D2 ref p d
D3 n out d
D4 ref n d
Rleak ref n 1g
V1 out ref {volts}
.ends
"""


@pytest.mark.slow
def test_a_bridge_on_narrow_band_noise(tmp_path):
    """4 f Cp V σ √(π/2) erfc(V/(√2 σ)) with the amplitudes of a Rayleigh law, weak coupling."""
    coupling, capacitance, damping, sigma = 1e-3, 0.01, 0.01, 50.0
    # σ = θ x/Cp of the mass alone, E[x²] = D/c.
    intensity = damping * (sigma * capacitance / coupling) ** 2
    excitation = {"kind": "white", "intensity": intensity}
    for share in (0.4, 0.752, 1.2):
        path = tmp_path / f"held{share}.lib"
        path.write_text(HELD.replace("{volts}", str(share * sigma)))
        run = {"settle": 500.0, "duration": 1e5}
        load = {"netlist": str(path)}
        scene = scene_of(coupling, capacitance, damping, excitation, load, run)
        into, _, rms = powers(scene)
        # The run's own σ, known to 3 %: what is left scatters by under 1 %.
        here, volts = rms * coupling / capacitance, share * sigma
        tail = np.sqrt(np.pi / 2.0) * here * erfc(volts / (np.sqrt(2.0) * here))
        assert into == pytest.approx(4.0 * capacitance * volts / (2.0 * np.pi) * tail, rel=0.02)
