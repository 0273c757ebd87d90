"""Sets of records as laboratories take them, right ones and ones with a fault, of random devices.

The base moves by sines (one, or many of random phases between two frequencies), so that what a
sensor makes of it is exact. The device is solved by scipy at tight tolerance.
"""

import math
from dataclasses import replace

import numpy as np
from measured_records import scene_of
from numba import njit
from scipy.integrate import ode

from harvester.identification.measurement import Measurement

FAULTS = (
    "highpass",
    "lowpass",
    "absolute velocity",
    "softening spring",
    "missing stopper",
    "wrong load",
    "mislabelled frequency",
    "swapped sign",
)
# Channels whose gain may be wrong.
GAINED = ("voltage", "acceleration")
# Beside the faults of which a verdict is asked; new kinds stand behind the others.
KINDS = (*FAULTS, "voltage highpass")
NOISE, DURATION, SETTLED, LINES = 0.004, 30.0, 15.0, 40
# Of the length, where a spring softens: the widest motion, and one that never comes back.
WIDE, GONE = 0.7, 10.0
# Samples a period of the motion.
PER_PERIOD = 12


def device(random, fault):
    """A piezoelectric device of some 10 Hz within some mm: bistable or hardening."""
    mass, frequency = random.uniform(0.01, 0.04), random.uniform(6.0, 12.0)
    rate, length = 2.0 * math.pi * frequency, random.uniform(3e-3, 15e-3)
    stiffness = mass * rate**2
    bistable = random.random() < 0.5
    shape = (-0.5, 0.5) if bistable else (1.0, random.uniform(0.1, 0.5))
    force = [0.0, shape[0] * stiffness, 0.0, shape[1] * stiffness / length**2]
    if fault == "softening spring":
        force = [
            0.0,
            stiffness,
            0.0,
            0.3 * stiffness / length**2,
            0.0,
            -0.15 * stiffness / length**4,
        ]
    damping = 2.0 * random.uniform(0.01, 0.03) * mass * rate
    capacitance = random.uniform(2e-8, 2e-7)
    # Of a load that is wrong only the work that it does tells.
    share = random.uniform(0.02, 0.08) if fault == "wrong load" else random.uniform(0.002, 0.05)
    coupling = math.sqrt(share * stiffness * capacitance)
    load = random.uniform(0.5, 3.0) / (rate * capacitance)
    piezo = {"piezo": {"coupling": coupling, "capacitance": capacitance}}
    where = length if bistable else 0.0
    return mass, damping, force, piezo, load, frequency, length, where


def base_sines(random, frequency, level, noise):
    """Frequency, amplitude and phase of each sine of the base."""
    if not noise:
        return np.array([[frequency * random.uniform(0.75, 1.15), level, random.uniform(0, 6.28)]])
    each = np.sort(random.uniform(0.4, 1.6, LINES)) * frequency
    amplitude = np.full(LINES, level * math.sqrt(1.0 / LINES))
    return np.column_stack([each, amplitude, random.uniform(0.0, 6.28, LINES)])


def summed(sines, times, gain=None):
    """The base's acceleration through a sensor, exactly."""
    found = np.zeros_like(times)
    for frequency, amplitude, phase in sines:
        through = gain(frequency) if gain else 1.0
        turn = 2.0 * math.pi * frequency * times + phase + np.angle(through)
        found += amplitude * abs(through) * np.sin(turn)
    return found


def solved(parts, sines, load, start, times, stopper=None, corner=None):
    """x, x', V and V behind a low-pass at the times."""
    mass, damping, force, piezo, *_ = parts
    coupling, capacitance = piezo["piezo"]["coupling"], piezo["piezo"]["capacitance"]
    rates, amplitudes, phases = 2.0 * math.pi * sines[:, 0], sines[:, 1], sines[:, 2]
    slow = 2.0 * math.pi * corner if corner else 0.0

    gap, contact = stopper or (np.inf, 0.0)
    lost = GONE * parts[6]
    others = (mass, damping, coupling, capacitance, load, gap, contact, slow, lost)
    solver = ode(_slope).set_integrator("dop853", rtol=1e-8, atol=1e-12, nsteps=1_000_000)
    solver.set_initial_value([start, 0.0, 0.0, 0.0], 0.0)
    solver.set_f_params(np.array(force), rates, amplitudes, phases, others)
    return np.column_stack([solver.y, *(solver.integrate(time) for time in times[1:])])


@njit
def _slope(time, state, force, rates, amplitudes, phases, others):
    """Of x, x', V and V behind a low-pass."""
    mass, damping, coupling, capacitance, load, gap, contact, slow, lost = others
    x, v, voltage, shown = state
    # From beyond its greatest force a softening spring never comes back: it stays there.
    if abs(x) > lost:
        return np.zeros(4)
    pull = damping * v + coupling * voltage
    for n in range(force.size):
        pull += force[n] * x**n
    if abs(x) > gap:
        pull += math.copysign(contact * (abs(x) - gap) ** 1.5, x)
    base = 0.0
    for n in range(rates.size):
        base += amplitudes[n] * math.sin(rates[n] * time + phases[n])
    leak = (coupling * v - voltage / load) / capacitance
    return np.array([v, -pull / mass - base, leak, slow * (voltage - shown)])


def a_set_with_gain(seed, channel, factor, loads, noise=False, duration=DURATION):
    """The scene to begin with, records at so many loads behind a channel's gain, and the truth.

    One record has each load; at one load there are two records of different strengths.
    """
    random = np.random.default_rng([seed, loads, GAINED.index(channel)])
    parts = device(random, None)
    mass, damping, force, piezo, load, frequency, length, where = parts
    rate, size = PER_PERIOD * frequency, length * (2.0 * math.pi * frequency) ** 2
    times = SETTLED + np.arange(int(duration * rate)) / rate
    records = []
    for number, share in enumerate((0.05, 0.1, 0.08)[: max(loads, 2)]):
        level = size * share * (1.4 if noise else 0.35)
        sines = base_sines(random, frequency, level, noise)
        own = load * (1.0, 0.3, 3.0)[number] if loads > 1 else load
        record = _record(random, parts, sines, own, where, times, None, number, 0.0)
        shown = {channel: factor * getattr(record, channel)}
        records.append(replace(record, **shown, changes={"load.resistance": own}))
    truth = scene_of(mass, damping, force, piezo, load)
    known = {
        "oscillator.damping": damping * random.uniform(0.75, 1.25),
        "piezo.coupling": piezo["piezo"]["coupling"] * random.uniform(0.8, 1.25),
        "piezo.capacitance": piezo["piezo"]["capacitance"] * random.uniform(0.8, 1.25),
    }
    changes = {**known, "length_scale": length} if where > 0.0 else known
    return truth.replace(changes), records, truth


def a_set(seed, fault=None, noise=False, strength=1.0, duration=DURATION):
    """The scene to begin with, off the truth, three records, the truth, and the sensor's corner.

    `fault` is one of `KINDS`; the corner is in Hz. The base is so many times as strong as usual.
    """
    random = np.random.default_rng([seed, KINDS.index(fault) if fault else 99])
    parts = device(random, fault)
    mass, damping, force, piezo, load, frequency, length, where = parts
    bistable = where > 0.0
    rate = PER_PERIOD * frequency
    size = length * (2.0 * math.pi * frequency) ** 2
    corner = frequency * {
        "highpass": random.uniform(0.05, 0.15),
        "lowpass": random.uniform(4, 8),
    }.get("highpass" if fault == "voltage highpass" else fault, 0.0)
    records, start = [], where
    for number, share in enumerate((0.03, 0.06, 0.12)):
        level = strength * size * share * (0.7 if noise else 0.35)
        sines = base_sines(random, frequency, level * (2.0 if noise else 1.0), noise)
        if fault == "softening spring":
            sines = _widened(parts, sines, load, rate, WIDE * (0.4, 0.7, 1.0)[number])
        own = load * (1.0, 0.3, 3.0)[number] if fault == "wrong load" else load
        times = SETTLED + np.arange(int(duration * rate)) / rate
        records.append(_record(random, parts, sines, own, start, times, fault, number, corner))
    truth = scene_of(mass, damping, _cubic(force), piezo, load)
    known = {
        "oscillator.damping": damping * random.uniform(0.75, 1.25),
        "oscillator.restoring_force[1]": force[1] * random.uniform(0.85, 1.15),
        "oscillator.restoring_force[3]": force[3] * random.uniform(0.75, 1.25),
        "piezo.coupling": piezo["piezo"]["coupling"] * random.uniform(0.8, 1.25),
        "piezo.capacitance": piezo["piezo"]["capacitance"] * random.uniform(0.8, 1.25),
    }
    changes = {**known, "length_scale": length} if bistable else known
    return truth.replace(changes), records, truth, corner


def _widened(parts, sines, load, rate, reach):
    """The base's sines so strong that the motion comes to a share of the device's length."""
    times, scaled = np.arange(int(20.0 * rate)) / rate, sines.copy()
    for _ in range(6):
        found = solved(parts, scaled, load, 0.0, times)
        moved = np.abs(found[0]).max() / parts[6]
        scaled[:, 1] *= 0.3 if moved >= GONE else np.clip(reach / moved, 0.5, 2.0)
    return scaled


def _cubic(force):
    return [*force[:3], force[3]]


def _record(random, parts, sines, load, start, times, fault, number, corner):
    """One measured record, with its fault."""
    rate = 1.0 / (times[1] - times[0])
    wanted = np.concatenate([[0.0], times])
    length = parts[6]
    stopper = None
    if fault == "missing stopper":
        quiet = solved(parts, sines, load, start, wanted)[0][1:]
        stopper = (0.8 * np.abs(quiet).max(), 5.0 * abs(parts[2][1]) / math.sqrt(length))
    low = corner if fault in ("lowpass", "voltage highpass") else None
    _, v, voltage, behind = solved(parts, sines, load, start, wanted, stopper, low)[:, 1:]
    gain = (lambda f: 1j * f / (corner + 1j * f)) if fault == "highpass" else None
    base = summed(sines, times, gain)
    columns = {"voltage": behind if fault == "lowpass" else voltage}
    if fault == "voltage highpass":
        columns["voltage"] = voltage - behind
    if fault == "absolute velocity":
        columns["velocity"] = v - _velocity(sines, times)
    if fault == "swapped sign":
        columns["voltage"] = -voltage
    stated = rate * (1.08 if fault == "mislabelled frequency" and number == 1 else 1.0)
    changes = {"load.resistance": load * (0.4 if fault == "wrong load" and number == 1 else 1.0)}
    noisy = {
        name: values + NOISE * values.std() * random.standard_normal(values.size)
        for name, values in {"acceleration": base, **columns}.items()
    }
    return Measurement(
        noisy.pop("acceleration"), stated, **noisy, changes=changes, name=f"record{number}.csv"
    )


def _velocity(sines, times):
    """Minus the base's velocity, by its sines."""
    rates = 2.0 * math.pi * sines[:, 0]
    return sum(
        amplitude / rate * np.cos(rate * times + phase)
        for rate, amplitude, phase in zip(rates, sines[:, 1], sines[:, 2], strict=True)
    )
