"""Records whose truth is known: equations written out here, solved by scipy at tight tolerance."""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from harvester.identification.measurement import Measurement
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers

NOISE = 0.02


def band_noise(rng, samples, rate, low, high, rms):
    """Gaussian noise between two frequencies, by random phases."""
    frequencies = np.fft.rfftfreq(samples, 1.0 / rate)
    inside = (frequencies > low) & (frequencies < high)
    spectrum = np.where(inside, np.exp(2j * np.pi * rng.random(frequencies.size)), 0.0)
    values = np.fft.irfft(spectrum, samples)
    return values * rms / values.std()


def scene_of(mass, damping, force, transducer, resistance, stoppers=None):
    """An SI scene; `transducer` is its table by its name."""
    tables = {
        "units": "SI",
        "oscillator": {"mass": mass, "damping": damping, "restoring_force": list(force)},
        **transducer,
        "load": {"kind": "resistor", "resistance": resistance},
        "excitation": {"kind": "white", "intensity": 0.01},
        "run": {"duration": 10.0},
    }
    return Scene.from_tables(tables | ({"stoppers": stoppers} if stoppers else {}), name="made")


def states(scene, acceleration, rate, start=(0.0, 0.0, 0.0)):
    """x, x' and V (or x alone of a coil's) at the samples, the acceleration linear between them."""
    o, t, load = scene.oscillator, scene.transducer, scene.load.resistance
    piezo = hasattr(t, "capacitance")
    times = np.arange(acceleration.size) / rate
    base = [*map(float, acceleration), float(acceleration[-1])]
    coefficients = list(enumerate(map(float, o.coefficients)))

    def spring_force(x):
        return sum(k * x**n for n, k in coefficients)

    def spring_energy(x):
        return sum(k * x ** (n + 1) / (n + 1) for n, k in coefficients)

    def slope(time, state):
        x, v, voltage = map(float, state)
        force = -o.damping * v - o.quadratic_damping * abs(v) * v - spring_force(x)
        for each in scene.stoppers:
            depth, side = abs(x) - each.gap, math.copysign(1.0, x)
            if depth > 0.0:
                # v0 from the state, by the energies of spring and contact (Eq. 5).
                gain = max(spring_energy(x) - spring_energy(side * each.gap), 0.0)
                gain += each.stiffness * depth**2.5 / 2.5
                b = 0.75 * (1.0 - each.restitution**2) / math.sqrt(v * v + 2.0 * gain / o.mass)
                force -= side * each.stiffness * depth**1.5 * (1.0 + b * side * v)
        if piezo:
            force -= t.coupling * voltage
            rate_of_voltage = (t.coupling * v - voltage / load) / t.capacitance
        else:
            force -= t.coupling**2 * v / (t.resistance + load)
            rate_of_voltage = 0.0
        place = min(int(time * rate), len(base) - 2)
        share = time * rate - place
        moved = (1.0 - share) * base[place] + share * base[place + 1]
        return v, force / o.mass - moved, rate_of_voltage

    found = solve_ivp(
        slope, (0.0, times[-1]), start, t_eval=times, rtol=1e-8, atol=1e-11, max_step=1.0 / rate
    )
    x, v, voltage = found.y
    if not piezo:
        voltage = t.coupling * v * load / (t.resistance + load)
    return x, v, voltage


def measured(scene, acceleration, rate, rng, outputs=("voltage",), start=(0.0, 0.0, 0.0), **more):
    """A record with white sensor noise of 2 % of each output's standard deviation."""
    x, v, voltage = states(scene, acceleration, rate, start)
    true = {"voltage": voltage, "displacement": x, "velocity": v}
    seen = {
        name: true[name] + NOISE * true[name].std() * rng.standard_normal(x.size)
        for name in outputs
    }
    return Measurement(acceleration, rate, **seen, **more)


def off(scene, keys, rng, share=0.25):
    """The scene with values that are off by up to a share."""
    known = numbers(scene)
    return scene.replace({key: known[key][0] * rng.uniform(1 - share, 1 + share) for key in keys})


# A linear device, and the sampling rate of its records (Hz).
RATE = 400.0
STIFFNESS = 0.01 * (2.0 * np.pi * 12.0) ** 2
MASS, COUPLING, CAPACITANCE, LOAD = 0.01, 1e-3, 5e-8, 2e5


def linear_device(damping):
    """The scene of the linear device."""
    piezo = {"piezo": {"coupling": COUPLING, "capacitance": CAPACITANCE}}
    return scene_of(MASS, damping, [0.0, STIFFNESS], piezo, LOAD)


def linear_record(damping, seed, rms, samples=1200, own=(), load=LOAD):
    """Voltage of a linear device, the acceleration linear between samples: exact, by scipy."""
    random = np.random.default_rng(seed)
    base = band_noise(random, samples, RATE, 4.0, 30.0, rms)
    a = [
        [0.0, 1.0, 0.0],
        [-STIFFNESS / MASS, -damping / MASS, -COUPLING / MASS],
        [0.0, COUPLING / CAPACITANCE, -1.0 / (load * CAPACITANCE)],
    ]
    times = np.arange(samples) / RATE
    voltage = lsim((a, [[0.0], [-1.0], [0.0]], [[0.0, 0.0, 1.0]], [[0.0]]), base, times)[1]
    noisy = voltage + 0.005 * voltage.std() * random.standard_normal(samples)
    return Measurement(
        base, RATE, noisy, changes={"load.resistance": load}, name=f"record{seed}.csv", own=own
    )
