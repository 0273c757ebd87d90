"""Method "spectral" against quadrature by scipy, closed forms and Lyapunov's equation."""

import cmath
import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import solve_continuous_lyapunov

import harvester
from harvester.averaging.of_scene import average
from harvester.base.errors import AveragingError, LoadError
from harvester.scene.model import Scene

pytestmark = pytest.mark.usefixtures("shared_workers")

MASS, STIFFNESS, DAMPING, FACTOR = 0.0141, 1158.0, 0.22, 1.085
THETA, CAPACITANCE, LEAK, RESISTANCE = 2.327e-3, 41.26e-9, 2e6, 47e3
PHI, COIL, INDUCTANCE, COIL_LOAD = 14.9, 391.0, 0.5, 1e3
POINTS = ((10.0, 0.5), (40.0, 0.5), (47.0, 0.9), (300.0, 0.002))
TRANSDUCERS = {
    "piezo": {"coupling": THETA, "capacitance": CAPACITANCE},
    "leaky piezo": {"coupling": THETA, "capacitance": CAPACITANCE, "leakage_resistance": LEAK},
    "coil": {"coupling": PHI, "resistance": COIL},
    "coil with inductance": {"coupling": PHI, "resistance": COIL, "inductance": INDUCTANCE},
}
SPECTRUM = {"kind": "spectrum", "unit": "(m/s^2)^2/Hz", "breakpoints": POINTS}
SINE = {"kind": "sine", "amplitude": 2.0, "frequency": 44.0}


def device(name, excitation=SPECTRUM, **run):
    coil = name.startswith("coil")
    return Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {
                "mass": MASS,
                "damping": DAMPING,
                "linear_stiffness": STIFFNESS,
                "base_factor": FACTOR,
            },
            "coil" if coil else "piezo": TRANSDUCERS[name],
            "load": {"resistance": COIL_LOAD if coil else RESISTANCE},
            "excitation": excitation,
            "run": {"duration": 60.0, "settle": 2.0, "seed": 4, "realizations": 4, **run},
        }
    )


def response(name, frequency):
    """Displacement and load voltage for one m/s² of the base, by impedances."""
    s = 2j * math.pi * frequency
    if name.startswith("coil"):
        current = PHI * s / (COIL + COIL_LOAD + s * TRANSDUCERS[name].get("inductance", 0.0))
        force, voltage = PHI * current, COIL_LOAD * current
    else:
        leak = 1.0 / LEAK if "leaky" in name else 0.0
        voltage = THETA * s / (s * CAPACITANCE + 1.0 / RESISTANCE + leak)
        force = THETA * voltage
    moved = FACTOR * MASS / (MASS * s**2 + DAMPING * s + STIFFNESS + force)
    return moved, voltage * moved


def integral(name, place, density):
    edges = [10.0, 40.0, 43.0, 45.0, 46.0, 47.0, 48.0, 50.0, 60.0, 300.0]
    parts = [
        quad(lambda f: abs(response(name, f)[place]) ** 2 * density(f), low, high, epsrel=1e-11)[0]
        for low, high in itertools.pairwise(edges)
    ]
    return sum(parts)


def straight(frequency):
    logarithms = np.log(np.array(POINTS))
    return math.exp(np.interp(math.log(frequency), *logarithms.T))


@pytest.mark.parametrize("name", TRANSDUCERS)
def test_means_are_those_of_quadrature(name):
    found = average(device(name), method="spectral").quantities
    load = COIL_LOAD if name.startswith("coil") else RESISTANCE
    power = integral(name, 1, straight) / load
    assert found["mean_power"].estimate == pytest.approx(power, rel=1e-8)
    square = integral(name, 0, straight)
    assert found["mean_square_displacement"].estimate == pytest.approx(square, rel=1e-8)


def test_a_sine_adds_its_own_mean_square():
    both = average(device("piezo", {"kind": "sum", "parts": [SPECTRUM, SINE]}), method="spectral")
    noise = average(device("piezo"), method="spectral").quantities["mean_square_voltage"].estimate
    sine = 0.5 * abs(2.0 * response("piezo", 44.0)[1]) ** 2
    found = both.quantities["mean_square_voltage"].estimate
    assert found == pytest.approx(noise + sine, rel=1e-9)
    assert not both.densities


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize(("amplitude", "phase"), [(2.0, math.pi), (2.0, 0.0), (1.5, -2.1)])
def test_sines_of_one_frequency_add_as_phasors(amplitude, phase, nested):
    """Powers added would give half the mean square in phase, and any where they cancel."""
    other = {**SINE, "amplitude": amplitude, "phase": phase}
    part = {"kind": "sum", "parts": [other]} if nested else other
    found = average(device("piezo", {"kind": "sum", "parts": [SINE, part]}), method="spectral")
    phasor = 2.0 + cmath.rect(amplitude, phase)
    exact = 0.5 * abs(phasor * response("piezo", 44.0)[1]) ** 2
    square = found.quantities["mean_square_voltage"].estimate
    assert square == pytest.approx(exact, rel=1e-9, abs=1e-20)


@pytest.mark.parametrize("time", [0.0, 0.4])
def test_coloured_and_white_noise_are_those_of_lyapunov(time):
    scene = Scene.read("linear")
    noise = {"kind": "ornstein-uhlenbeck", "correlation_time": time} if time else {"kind": "white"}
    tables = scene.to_tables()
    tables["excitation"] = {**noise, "intensity": 0.02}
    tables["load"] = {"decay_rate": 0.7}
    scene = Scene.from_tables(tables)
    stiffness, c = scene.oscillator.linear_stiffness, scene.oscillator.damping
    beta, rate = scene.transducer.coupling, 0.7
    matrix = np.array([[0.0, 1.0, 0.0], [-stiffness, -c, -beta], [0.0, 1.0, -rate]])
    push = np.zeros((3, 3))
    push[1, 1] = 2.0 * 0.02
    if time:
        matrix = np.block(
            [[matrix, np.array([[0.0], [1.0], [0.0]])], [np.zeros((1, 3)), -1 / time]]
        )
        push = np.zeros((4, 4))
        push[3, 3] = 2.0 * 0.02 / time**2
    exact = solve_continuous_lyapunov(matrix, -push)
    found = average(scene, method="spectral").quantities
    assert found["mean_square_displacement"].estimate == pytest.approx(exact[0, 0], rel=1e-8)
    assert found["mean_square_velocity"].estimate == pytest.approx(exact[1, 1], rel=1e-8)
    assert found["mean_square_voltage"].estimate == pytest.approx(exact[2, 2], rel=1e-8)


def test_what_is_not_linear_is_refused_by_name():
    with pytest.raises(AveragingError, match="the spring is not linear"):
        average("paper", method="spectral")
    bridge = Scene.read("device").replace({"load.netlist": "bridge"})
    with pytest.raises(LoadError, match="takes only a resistor as load"):
        average(bridge, method="spectral")


@pytest.mark.slow
def test_studies_take_it():
    scene = device("piezo")
    table = harvester.sweep(
        scene, {"load.resistance": [2e4, 2e5]}, methods=["spectral"], quantities=["mean_power"]
    )
    for place, cell in table.places():
        alone = average(scene.replace({"load.resistance": place[0]}), method="spectral")
        assert cell.estimates["mean_power"].estimate == alone.quantities["mean_power"].estimate


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", TRANSDUCERS)
def test_monte_carlo_agrees(name):
    """Three standard errors and the steps' share: a false alarm in 370 seeds."""
    scene = device(name, duration=300.0, realizations=8)
    exact = average(scene, method="spectral").quantities
    found = harvester.simulate(scene, method="monte-carlo").quantities
    for quantity in ("mean_power", "mean_square_displacement", "power_conversion_efficiency"):
        error = 3.0 * found[quantity].standard_error + 2e-3 * found[quantity].estimate
        assert abs(found[quantity].estimate - exact[quantity].estimate) < error, quantity
