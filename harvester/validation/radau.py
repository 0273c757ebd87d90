"""A harvester behind the project's diode bridge by scipy's Radau, on node equations written out.

M x'' = …, Cp p' = θ x' − i1 + i3, and with the diodes' currents i and s the stray capacitance
C (o' − r') = i1 + i2 − (o − r)/R,  (C + s) r' − C o' = −i3 − i4 + (o − r)/R.
"""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from harvester.engines.realization import start_state
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.validation.paths import noise_at_knots

# 1N4148, of netlists/diodes.lib: saturation current (A), series resistance and leakage (ohm).
SATURATION, SERIES, LEAKAGE = 2.52e-9, 0.568, 0.9e9
# Emission coefficient times k T/e at 300.15 K, in volts.
SWING = 1.752 * 1.380649e-23 * 300.15 / 1.602176634e-19
# Conductance that ngspice puts across every junction, in siemens.
GMIN = 1e-12
# Stray capacitances: between the bridge's output and the piezo, in farads, and of every output node
# as a share of the piezo's.
STRAY, STRAY_SHARE = 10e-12, 1e-6
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 1e-6, 1e-9


def bridge_path(scene: Scene) -> np.ndarray:
    """X and terminal voltage (scaled) of the first realization at the knots 1, 2, …

    The scene is in SI, with `bridge` of 1N4148s as load, its `resistance` and `storage` given, a
    piezo, spring and damper of the source paper's form, and no contacts.
    """
    model = prepared(scene)
    noise, spacing = noise_at_knots(scene, 0), knot_spacing(model)
    state = np.array([*start_state(model, 0)[:2], 0.0, 0.0, 0.0])
    derivative = _equations(scene)
    points = np.empty((noise.size - 1, 2))
    for k in range(noise.size - 1):
        begin, end = k * spacing, (k + 1) * spacing
        slope = (noise[k + 1] - noise[k]) / spacing
        solved = solve_ivp(
            derivative, (begin, end), state, "Radau", args=(begin, noise[k], slope),
            rtol=RELATIVE_TOLERANCE, atol=ABSOLUTE_TOLERANCE,
        )  # fmt: skip
        state = solved.y[:, -1]
        points[k] = state[0], state[2]
    return points / (1.0, model.scales.voltage)


def _equations(scene):
    """Right-hand side for (X, X', piezo, output and its reference in V) on a line of noise."""
    model = prepared(scene)
    system, scales = model.system, model.scales
    damping, coupling = system.damper.damping, system.transducer.coupling / scales.voltage
    polynomial: Any = system.spring
    spring = polynomial.coefficients
    charge = scene.transducer.coupling * scales.displacement
    capacitance = scene.transducer.capacitance
    parameters = scene.load.parameters
    storage, resistance = parameters["storage"], parameters["resistance"]
    extra = STRAY_SHARE * capacitance
    matrix = [[storage + extra, -storage], [-storage, storage + STRAY + extra]]
    inverse = np.linalg.inv(matrix)

    def derivative(time, state, begin, first, slope):
        x, v, piezo, out, ref = state
        one, two = _diode(piezo - out), _diode(-out)
        three, four = _diode(ref - piezo), _diode(ref)
        load = (out - ref) / resistance
        rates = inverse @ [one + two - load, load - three - four]
        force = first + slope * (time - begin) - damping * v - coupling * piezo
        force -= sum(k * x**n for n, k in enumerate(spring))
        return [v, force, (charge * v - one + three) / capacitance, *rates]

    return derivative


def _diode(volts):
    """Current through junction, series resistance and leakage, by Newton on the junction."""
    junction = min(volts, 0.6)
    for _ in range(60):
        # Trial steps of the integrator may have any voltage: the exponent is limited.
        grown = np.exp(min(junction / SWING, 300.0))
        current = SATURATION * (grown - 1.0) + GMIN * junction
        slope = SATURATION * grown / SWING + GMIN
        change = (volts - junction - SERIES * current) / (1.0 + SERIES * slope)
        junction += change
        if abs(change) < 1e-15:
            break
    return current + volts / LEAKAGE
