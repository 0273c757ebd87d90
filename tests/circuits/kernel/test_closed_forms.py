"""Bridge and SECE of near-ideal parts against closed forms that take the piezo's force back.

Y. C. Shu and I. C. Lien, Smart Materials and Structures 15 (2006) 1499–1512, in the form that
balances energy: with a = ωCpR + π/2, force F0 and damping η,

    u0 = F0/√{[ηω + 2ωθ²R/a²]² + [k − ω²M + ωθ²R/a]²},  P = ω²θ²R u0²/a².

E. Lefeuvre et al., Sensors and Actuators A 126 (2006) 405–416: at the best frequency
P/(F0²/8η) = 4x/(1 + x)², x = 4k²Q/π for SECE, k² = θ²/(k Cp), Q = Mω/η.
"""

import numpy as np
import pytest
from scipy.optimize import minimize
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


def sine(frequency, amplitude):
    return {"kind": "sine", "amplitude": amplitude, "frequency": frequency / (2.0 * np.pi)}


def shu_lien(omega, resistance, force, damping, coupling, capacitance):
    a = omega * capacitance * resistance + 0.5 * np.pi
    back = omega * coupling**2 * resistance
    lossy = damping * omega + 2.0 * back / a**2
    size = force / np.hypot(lossy, 1.0 - omega**2 + back / a)
    return (omega * coupling * size / a) ** 2 * resistance


@pytest.mark.parametrize(("ratio", "best"), [(0.01, 0.147), (0.09, 0.769), (0.3, 1.000)])
def test_a_coupled_bridge_is_shu_and_liens(ratio, best):
    """At its best frequency and resistance: off them the form, one harmonic, is up to 12 % off."""
    damping, force, coupling = 0.08, 3.0, 1e-3
    capacitance = coupling**2 / ratio
    given = (force, damping, coupling, capacitance)
    found = minimize(
        lambda z: -shu_lien(z[0], np.exp(z[1]) / capacitance, *given), [1.02, 0.5],
        method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-16},
    )  # fmt: skip
    assert -found.fun / (force**2 / (8.0 * damping)) == pytest.approx(best, abs=6e-4)
    omega, resistance = found.x[0], np.exp(found.x[1]) / capacitance
    values = {"diode": 0, "resistance": resistance, "storage": 60.0 / resistance}
    load = {"netlist": "bridge", "parameters": values}
    run = {"settle": 600.0, "duration": 200.0 * np.pi / omega}
    scene = scene_of(coupling, capacitance, damping, sine(omega, force), load, run)
    into, used, _ = powers(scene)
    assert used == pytest.approx(shu_lien(omega, resistance, *given), rel=0.02)
    assert used / into > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    ("figure", "best"), [(0.1, 0.401), (np.pi / 4.0, 1.0), (1.0, 0.986), (np.pi, 0.640)]
)
def test_sece_with_strong_coupling(figure, best):
    """What it takes from the piezo at the best frequency, k²Q being the figure of merit."""
    share = 0.005
    quality, coupling = figure / share, 1e-3
    damping, force = 1.0 / quality, 100.0 / quality
    capacitance = coupling**2 / share
    load = {
        "netlist": "sece",
        "parameters": {
            "diode": 0, "resistance": 0.1 / capacitance, "storage": 400.0 * capacitance,
            "capacitance": capacitance, "inversion_time": 0.02, "sense_time": 0.005,
            "quality": 1000, "threshold": 1e-6, "residual": 0.5,
        },
    }  # fmt: skip
    run = {"settle": 10.0 * quality, "duration": 100.0 * np.pi}
    taken = [
        powers(scene_of(coupling, capacitance, damping, sine(omega, force), load, run))[0]
        for omega in np.sqrt(1.0 + share * np.array([0.6, 0.8, 1.0, 1.2, 1.4]))
    ]
    assert max(taken) / (force**2 / (8.0 * damping)) == pytest.approx(best, rel=0.02)


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
