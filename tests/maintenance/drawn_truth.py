"""Mean powers of drawn scenes that the project's own integrators have no part in.

A linear device behind a resistor has closed forms: phasors, and ∫ |H|² G df. Any other device
behind a resistor is integrated by the classical Runge–Kutta method at a step far below its periods.
It is driven by sines, by the samples of a record, or by Gaussian noise drawn from its density.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import quad

# Steps over the shortest period of device and sines; a Hertzian contact lasts a thirtieth of one.
STEPS, STEPS_IN_CONTACT = 300, 1500
# Fewest steps in the time in which the transducer's own state decays.
STEPS_PER_DECAY = 5
# Share of a power that these steps may cost, of a well stiffer than the device's own frequency.
STEP_ERROR = 1e-6
# Samples of noise over the shortest period. The density is raised by 1/sinc⁴, which straight lines
# between the samples take.
SAMPLES = 48
# Independent paths of a truth under noise, whose scatter is its error.
PATHS = 32
# Periods that a motion under sines is averaged over: whole periods of most subharmonic motions.
AVERAGED = 960
# Starts beside the given one. Where they end on other motions, any of these is right.
BESIDE = (0.0, 1e-5, -1e-5, 1e-4)
NO_WELLS = np.zeros((0, 3))


class Device(NamedTuple):
    """A device and its resistor in the scene's units, written out from the scene's tables."""

    mass: float
    damping: float
    spring: np.ndarray
    contacts: np.ndarray
    coil: bool
    coupling: float
    storage: float
    winding: float
    resistance: float
    base_factor: float
    base_charge: float

    @property
    def linear(self):
        """Whether the response has a closed form."""
        return len(self.contacts) == 0 and not self.spring[2:].any()


class Motion(NamedTuple):
    """What shakes a device: sines, the density of Gaussian noise, or samples of a record.

    Between its corners (Hz) each density is smooth.
    """

    sines: tuple = ()
    densities: tuple = ()
    corners: tuple = ()
    record: np.ndarray | None = None
    spacing: float = 0.0


def device_of(scene):
    """The device of a scene in SI with a resistor as load; a drawing's from its derived values."""
    oscillator, transducer = scene.oscillator, scene.transducer
    short = (0.0, oscillator.linear_stiffness, 0.0, oscillator.cubic_stiffness)
    spring = np.array(oscillator.restoring_force or short, dtype=float)
    contacts = [(s.gap, s.stiffness, s.restitution) for s in scene.stoppers or ()]
    coil = not hasattr(transducer, "capacitance")
    return Device(
        mass=oscillator.mass,
        damping=oscillator.damping,
        spring=spring,
        contacts=np.array(contacts, dtype=float).reshape(-1, 3),
        coil=coil,
        coupling=transducer.coupling,
        storage=transducer.inductance if coil else transducer.capacitance,
        winding=transducer.resistance if coil else 0.0,
        resistance=scene.load.resistance,
        base_factor=oscillator.base_factor,
        base_charge=0.0 if coil else transducer.base_charge,
    )


def motion_of(tables):
    """Sines (amplitude, frequency, phase) and densities of an excitation's table."""
    kind = tables["kind"]
    if kind == "sum":
        parts = [motion_of(part) for part in tables["parts"]]
        return Motion(
            tuple(sine for part in parts for sine in part.sines),
            tuple(density for part in parts for density in part.densities),
            tuple(corners for part in parts for corners in part.corners),
        )
    if kind == "sine":
        return Motion(((tables["amplitude"], tables["frequency"], tables.get("phase", 0.0)),))
    if kind == "ornstein-uhlenbeck":
        intensity, memory = tables["intensity"], tables["correlation_time"]
        return Motion(
            densities=(lambda f: 4.0 * intensity / (1.0 + (2.0 * math.pi * f * memory) ** 2),),
            corners=(np.concatenate([[0.0], np.geomspace(1e-2, 1e9, 34)]),),
        )
    if kind == "spectrum":
        points = np.array(tables["breakpoints"])
        return specified(points)
    # A record is the base's acceleration, and η is minus that.
    samples = np.loadtxt(tables["file"], delimiter=",", skiprows=1)
    return Motion(record=samples[:, 1].mean() - samples[:, 1], spacing=samples[1, 0])


def specified(points):
    """Noise of a density by breakpoints."""
    return Motion(densities=(lambda f: lines_of(points, f),), corners=(points[:, 0],))


def lines_of(points, f):
    """A density of straight lines on log–log axes, 0 outside."""
    f = np.asarray(f, dtype=float)
    inside = (f >= points[0, 0]) & (f <= points[-1, 0])
    log = np.interp(np.log(np.where(inside, f, points[0, 0])), *np.log(points.T))
    return np.where(inside, np.exp(log), 0.0)


# --- closed forms ------------------------------------------------------------------------------


def power_gain(device, f):
    """Mean power over the mean square of η at a frequency, of a linear device."""
    s = 2j * math.pi * np.asarray(f, dtype=float)
    inertia = device.mass * s**2 + device.damping * s + device.spring[1]
    forced = device.base_factor * device.mass
    if device.coil:
        loop = device.winding + device.resistance + s * device.storage
        current = s * device.coupling * forced / (inertia * loop + s * device.coupling**2)
        return device.resistance * np.abs(current) ** 2
    admittance = s * device.storage + 1.0 / device.resistance
    driven = s * (device.coupling * forced + device.base_charge * inertia)
    voltage = driven / (inertia * admittance + s * device.coupling**2)
    return np.abs(voltage) ** 2 / device.resistance


def linear_power(device, motion):
    """Mean power under sines and noise, and its error by quadrature.

    Phasors of one frequency add before they are squared.
    """
    phasors = {}
    for amplitude, frequency, phase in motion.sines:
        phasors[frequency] = phasors.get(frequency, 0.0) + amplitude * np.exp(1j * phase)
    power = sum(0.5 * abs(p) ** 2 * power_gain(device, f) for f, p in phasors.items())
    error = 0.0
    for density, corners in zip(motion.densities, motion.corners, strict=True):
        cuts = np.unique(np.concatenate([corners, _crowded(device, *corners)]))
        for low, high in itertools.pairwise(cuts):
            part, off = quad(
                lambda f, g=density: power_gain(device, f) * g(f), low, high, epsrel=1e-9
            )
            power, error = power + part, error + off
    return float(power), float(error)


def _crowded(device, low, *high):
    """Frequencies that lie closest about the resonance, between those of a density."""
    own = math.sqrt(device.spring[1] / device.mass) / (2.0 * math.pi)
    width = device.damping / device.mass / (2.0 * math.pi)
    cuts = own + width * np.sinh(np.linspace(-8.0, 8.0, 33))
    return cuts[(cuts > low) & (cuts < high[-1])]


# --- integration -------------------------------------------------------------------------------


@njit(cache=True)
def _spring(spring, x):
    force = 0.0
    for k in range(spring.size - 1, -1, -1):
        force = force * x + spring[k]
    return force


@njit(cache=True)
def _stored(spring, x):
    energy = 0.0
    for k in range(spring.size - 1, -1, -1):
        energy = energy * x + spring[k] / (k + 1)
    return energy * x


@njit(cache=True)
def _slope(device, x, v, u, eta):
    """Rates of displacement, velocity and transducer's state, and the power into the resistor."""
    mass, damping, spring, contacts, coil, coupling, storage, winding, load, factor, charge = device
    force = factor * mass * eta - damping * v - _spring(spring, x)
    for gap, stiffness, restitution in contacts:
        depth = x - gap
        if depth > 0.0:
            energy = 0.4 * stiffness * depth**2.5
            gain = max(_stored(spring, x) - _stored(spring, gap), 0.0)
            speed = math.sqrt(v * v + 2.0 / mass * (gain + energy))
            loss = 0.75 * (1.0 - restitution**2) / speed if speed > 0.0 else 0.0
            force -= stiffness * depth**1.5 * (1.0 + loss * v)
    if coil:
        if storage == 0.0:
            u = coupling * v / (winding + load)
            rate = 0.0
        else:
            rate = (coupling * v - (winding + load) * u) / storage
        return v, (force - coupling * u) / mass, rate, load * u * u
    voltage = u + charge * eta / storage
    rate = (coupling * v - voltage / load) / storage
    return v, (force - coupling * voltage) / mass, rate, voltage * voltage / load


@njit(cache=True)
def _run(device, start, sines, path, spacing, substeps, first, parts, wells):
    """Mean power of each of `parts` equal parts behind the first samples, and the last state.

    Also the times spent in each well and the ends of stays. A well is reached with a quarter of the
    energy that leads out of it; a stay ends where another one is reached.
    """
    x, v, u = start
    count = path.size - 1
    h = spacing / substeps
    power = np.zeros(parts)
    times, exits = np.zeros(len(wells)), np.zeros(len(wells))
    well = -1
    for knot in range(count):
        part = -1 if knot < first else (knot - first) * parts // (count - first)
        for sub in range(substeps):
            time = knot * spacing + sub * h
            eta = np.empty(3)
            for m in range(3):
                share = (sub + 0.5 * m) / substeps
                eta[m] = path[knot] + (path[knot + 1] - path[knot]) * share
                for amplitude, frequency, phase in sines:
                    angle = 2.0 * math.pi * frequency * (time + 0.5 * m * h) + phase
                    eta[m] += amplitude * math.sin(angle)
            a = _slope(device, x, v, u, eta[0])
            b = _slope(device, x + 0.5 * h * a[0], v + 0.5 * h * a[1], u + 0.5 * h * a[2], eta[1])
            c = _slope(device, x + 0.5 * h * b[0], v + 0.5 * h * b[1], u + 0.5 * h * b[2], eta[1])
            d = _slope(device, x + h * c[0], v + h * c[1], u + h * c[2], eta[2])
            if part >= 0:
                power[part] += (a[3] + 2.0 * b[3] + 2.0 * c[3] + d[3]) / 6.0
            x += h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
            v += h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
            u += h / 6.0 * (a[2] + 2.0 * b[2] + 2.0 * c[2] + d[2])
            if well >= 0:
                times[well] += h
            for k in range(len(wells)):
                low, high, limit = wells[k]
                energy = 0.5 * device[0] * v * v + _stored(device[2], x)
                if k != well and low < x < high and energy <= limit:
                    if well >= 0:
                        exits[well] += 1.0
                    well = k
    return power * (parts / (substeps * (count - first))), (x, v, u), times, exits


def wells_of(device):
    """Both ends of each well of a spring, and the energy with which it is reached."""
    roots = np.roots(np.trim_zeros(device.spring, "b")[::-1])
    places = np.sort(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots).max()].real)
    ends = [-math.inf, *places[1::2], math.inf]
    heights = [math.inf, *(_stored(device.spring, each) for each in places[1::2]), math.inf]
    wells = []
    for k, bottom in enumerate(places[::2]):
        low = _stored(device.spring, bottom)
        out = min(heights[k], heights[k + 1]) - low
        wells.append((ends[k], ends[k + 1], low + 0.25 * out))
    return np.array(wells)


def _substeps(device, fastest, spacing):
    steps = STEPS_IN_CONTACT if len(device.contacts) else STEPS
    resistance = device.winding + device.resistance
    decay = resistance / device.storage if device.coil and device.storage else 0.0
    decay = decay if device.coil else 1.0 / (device.resistance * device.storage)
    return max(1, math.ceil(spacing * max(fastest * steps, decay * STEPS_PER_DECAY)))


def periodic(device, sines, start, own, settle, averaged=AVERAGED):
    """Mean power with its error under sines from one start, and the state at its end.

    Averages of quarters give the error of a motion that does not repeat.
    """
    base = min(frequency for _, frequency, _ in sines)
    fastest = max(own, *(frequency for _, frequency, _ in sines))
    knots = 8
    path = np.zeros(knots * (settle + averaged) + 1)
    spacing = 1.0 / (knots * base)
    power, end, _, _ = _run(
        device, start, np.array(sines), path, spacing, _substeps(device, fastest, spacing),
        knots * settle, 4, NO_WELLS,
    )  # fmt: skip
    mean, error = float(power.mean()), float(power.std(ddof=1) / 2.0)
    return (mean, math.hypot(error, STEP_ERROR * mean)), end


def on_record(device, motion, start, own, settle, duration):
    """Mean power over one pass of a record, whose samples straight lines join."""
    knots = round((settle + duration) / motion.spacing)
    substeps = _substeps(device, own, motion.spacing)
    first = round(settle / motion.spacing)
    path = motion.record[: knots + 1]
    power, *_ = _run(
        device, start, np.zeros((0, 3)), path, motion.spacing, substeps, first, 1, NO_WELLS
    )
    return float(power[0])


def noise(densities, spacing, count, generator):
    """Gaussian samples whose straight lines have these one-sided densities."""
    count = 2 ** math.ceil(math.log2(count))
    f = np.fft.rfftfreq(count, spacing)
    density = sum(each(f) for each in densities) / np.sinc(f * spacing) ** 4
    lines = generator.standard_normal((2, f.size))
    amplitudes = np.sqrt(0.5 * density / (2.0 * count * spacing)) * (lines[0] + 1j * lines[1])
    amplitudes[0] = 0.0
    return np.fft.irfft(amplitudes, count) * count


def under_noise(device, motion, starts, own, highest, settle, duration, generator, wells=NO_WELLS):
    """Mean power with its error, and times and exits of the wells, on paths of its own."""
    fastest = max(own, highest, *(frequency for _, frequency, _ in motion.sines), 0.0)
    spacing = 1.0 / (SAMPLES * fastest)
    substeps = _substeps(device, fastest, spacing)
    sines = np.array(motion.sines).reshape(-1, 3)
    count, first = math.ceil((settle + duration) / spacing), math.ceil(settle / spacing)
    found = []
    for k in range(PATHS):
        path = noise(motion.densities, spacing, count + 1, generator)[: count + 1]
        start = starts[k % len(starts)]
        found.append(_run(device, start, sines, path, spacing, substeps, first, 1, wells))
    power = np.array([each[0][0] for each in found])
    error = float(power.std(ddof=1) / math.sqrt(PATHS))
    times, exits = (np.array([each[k] for each in found]) for k in (2, 3))
    return (float(power.mean()), error), times, exits
