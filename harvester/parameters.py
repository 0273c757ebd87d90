"""The scaled form of a scene (Eqs. 3–6) and the scales that lead back to its units."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from harvester.errors import LoadError, SceneError
from harvester.forces import contact_time

# Knots per period of small oscillations.
KNOTS_PER_PERIOD = 40
# Steps per period of the fastest oscillation. The trapezoidal rule is of order two, Runge–Kutta of
# order four; as `work-precision` shows, each then biases the means by less than 1 %.
STEPS_PER_PERIOD = {"circuit": 80, "monte-carlo": 40}
# Fewest steps from the beginning of a contact to its end.
STEPS_PER_CONTACT = 30
# Energy up to which the default step resolves the motion, in units of the mean-square velocity:
# the density of the energy falls as exp(−H/E[X'²]), so it is beyond for under 1 % of the time.
RESOLVED_ENERGY = 5.0
# Steps by name, as divisions of the default one.
STEP_LEVELS = {"default": 1, "fine": 4, "finest": 32}
# A load that switches rejects steps, and after each of them ngspice takes one of first order: at a
# step of this share of the usual one that costs the motion under 0.1 % of its energy, not 1 %.
SWITCHING_STEPS = 4
# A damper that acts within a knot makes the velocity follow the noise's straight lines: the mean of
# its square needs points within them (sixteen times less of the interpolation's loss is then left).
STEPS_OF_SLAVED_VELOCITY = 4
# λ (1/s) whose square is still a number.
FASTEST_DECAY = 1e150


class ScaledParameters(NamedTuple):
    """Coefficients of Eqs. 4–6; time in seconds, lengths in `Scales.displacement`.

    A named tuple, so that compiled functions take it as it is; `_replace` changes a copy.

    Attributes
    ----------
    damping, linear_stiffness, cubic_stiffness : float
        c, −ω0² (with its sign) and κ of Eq. 4a.
    gap, contact_stiffness, restitution : float
        δ (infinite without stoppers), K, e of Eq. 5.
    held_impact_velocity : bool
        v0 of Eq. 5 is held from the moment of contact (`event`) instead of `energy`.
    coupling, decay_rate : float
        β and λ of Eq. 4.
    intensity, correlation_time : float
        D and τ1 of Eq. 6, or of the noise that other excitations are equivalent to.
    """

    damping: float
    linear_stiffness: float
    cubic_stiffness: float
    gap: float
    contact_stiffness: float
    restitution: float
    held_impact_velocity: bool
    coupling: float
    decay_rate: float
    intensity: float
    correlation_time: float

    @property
    def has_stoppers(self):
        """Whether a contact force can ever act."""
        return math.isfinite(self.gap) and self.contact_stiffness > 0.0

    @property
    def damping_factor(self):
        """¾ (1 − e²): b·v0 of Eq. 5, without unit."""
        return 0.75 * (1.0 - self.restitution**2)

    @property
    def well(self):
        """Rest position on the right of the bare spring, √(ω0²/κ); 0 when monostable."""
        if self.linear_stiffness >= 0.0:
            return 0.0
        if self.cubic_stiffness == 0.0:
            return math.inf
        return math.sqrt(-self.linear_stiffness / self.cubic_stiffness)

    @property
    def preloaded(self):
        """Whether the mass rests on the stopper, because the gap ends before the bare well."""
        return self.has_stoppers and self.gap < self.well

    @property
    def rest(self):
        """Stable rest position X ≥ 0 with the stoppers, without charge on the piezo."""
        if not self.preloaded:
            return self.well
        return _pressed_rest(self)

    @property
    def angular_frequency(self):
        """Of small oscillations about `rest` with the piezo open (rad/s).

        The stiffness is V''(rest) + β; a vanishing one is replaced by the noise's own rate.
        """
        x = self.rest
        stiffness = self.linear_stiffness + 3.0 * self.cubic_stiffness * x * x + self.coupling
        if self.preloaded:
            stiffness += 1.5 * self.contact_stiffness * math.sqrt(x - self.gap)
        return math.sqrt(stiffness) if stiffness > 0.0 else 1.0 / self.correlation_time

    @property
    def relaxation_time(self):
        """Time in which damper and load take the energy of small oscillations (s).

        1/(c + βλ/(λ² + ω²)), Eq. 12; infinite without either.
        """
        rate = _loss_rate(self, self.angular_frequency)
        return 1.0 / rate if rate > 0.0 else math.inf

    def driven_square_velocity(self, frequency):
        """E[X'²] of motion at this frequency, D/(1 + ω²τ1²) over the rate of loss (Eqs. 12, 20)."""
        loss = _loss_rate(self, frequency)
        colour = 1.0 + (frequency * self.correlation_time) ** 2
        return self.intensity / (loss * colour) if loss > 0.0 else math.inf

    @property
    def contact_time(self):
        """Duration of a contact at the rms speed of small oscillations (s); inf without any."""
        speed = math.sqrt(self.driven_square_velocity(self.angular_frequency))
        if not self.has_stoppers:
            return math.inf
        return contact_time(self, speed) if math.isfinite(speed) else 0.0

    @property
    def fastest_angular_frequency(self):
        """Of small oscillations or of the greatest that the noise drives, whichever is faster.

        The greatest has the energy `RESOLVED_ENERGY` E[X'²] at the frequency ω of that motion
        itself; its stiffness is that of harmonic balance, −ω0² + β + ¾ κ A². What the stoppers
        add belongs to the contact's own step (rad/s).
        """
        frequency = slowest = self.angular_frequency
        # The greater the frequency, the less noise it meets: half-way steps settle.
        for _ in range(60):
            square = _driven_stiffness(self, frequency)
            frequency = math.sqrt(0.5 * (frequency**2 + max(square, slowest**2)))
        return frequency


@dataclass(frozen=True)
class Scales:
    """One scaled unit of each quantity, in the scene's units (all 1 for a scaled scene).

    displacement l, voltage θ l/Cp, power M l² (s⁻³); acceleration and velocity go with l,
    energy with power.
    """

    displacement: float = 1.0
    voltage: float = 1.0
    power: float = 1.0

    def of(self, dimension):
        """Factor for "displacement^2", "voltage", "power", "1" and the like."""
        base, _, exponent = dimension.partition("^")
        if base in ("1", "rate", "time"):
            return 1.0
        name = {"velocity": "displacement", "energy": "power"}.get(base, base)
        return getattr(self, name) ** int(exponent or 1)


def scale(scene):
    """Scaled parameters and scales of a scene (Eq. 3; time is not rescaled).

    Parameters
    ----------
    scene : harvester.scene.Scene

    Returns
    -------
    ScaledParameters, Scales
    """
    parameters, scales = _scale_si(scene) if scene.units == "SI" else _scale_scaled(scene)
    if scene.excitation.prescribes_displacement:
        parameters = _without_mechanics(parameters)
    return parameters, scales


def _without_mechanics(p):
    """Only the piezo is left: what drives a mass without spring and damper is its η."""
    return p._replace(
        damping=0.0,
        linear_stiffness=0.0,
        cubic_stiffness=0.0,
        gap=math.inf,
        contact_stiffness=0.0,
        restitution=1.0,
        held_impact_velocity=False,
    )


def _scale_scaled(scene):
    stoppers = scene.stoppers
    parameters = ScaledParameters(
        damping=scene.oscillator.damping,
        linear_stiffness=scene.oscillator.linear_stiffness,
        cubic_stiffness=scene.oscillator.cubic_stiffness,
        gap=stoppers.gap if stoppers else math.inf,
        contact_stiffness=stoppers.stiffness if stoppers else 0.0,
        restitution=stoppers.restitution if stoppers else 1.0,
        held_impact_velocity=bool(stoppers) and stoppers.impact_velocity == "event",
        coupling=scene.piezo.coupling,
        decay_rate=_decay_rate(scene, 1.0),
        intensity=math.nan,
        correlation_time=math.inf,
    )
    return _with_noise(parameters, scene.excitation, 1.0), Scales()


def _scale_si(scene):
    oscillator, piezo, stoppers = scene.oscillator, scene.piezo, scene.stoppers
    mass, length = oscillator.mass, length_scale(scene)
    theta, cp = piezo.coupling, piezo.capacitance
    parameters = ScaledParameters(
        damping=oscillator.damping / mass,
        linear_stiffness=oscillator.linear_stiffness / mass,
        cubic_stiffness=oscillator.cubic_stiffness * length**2 / mass,
        gap=stoppers.gap / length if stoppers else math.inf,
        contact_stiffness=stoppers.stiffness * math.sqrt(length) / mass if stoppers else 0.0,
        restitution=stoppers.restitution if stoppers else 1.0,
        held_impact_velocity=bool(stoppers) and stoppers.impact_velocity == "event",
        coupling=theta**2 / (mass * cp),
        decay_rate=_decay_rate(scene, cp),
        intensity=math.nan,
        correlation_time=math.inf,
    )
    return _with_noise(parameters, scene.excitation, length), Scales(
        displacement=length, voltage=theta * length / cp, power=mass * length**2
    )


def _with_noise(parameters, excitation, length):
    """The parameters with the D and τ1 of the excitation, or of its equivalent."""
    longest = _longest_spacing(parameters)
    intensity, time = excitation.equivalent_noise(parameters.relaxation_time, longest)
    return parameters._replace(intensity=intensity / length**2, correlation_time=time)


def _longest_spacing(parameters):
    """What resolves small oscillations (s); infinite where there are none."""
    frequency = parameters.angular_frequency
    return 2.0 * math.pi / frequency / KNOTS_PER_PERIOD if frequency > 0.0 else math.inf


def _decay_rate(scene, capacitance):
    """λ of Eq. 4b; 0, an open circuit, where the load is no resistor.

    Steps are then chosen for the motion that the damper alone bounds, the greatest there is,
    and the load's power is measured in the circuit.
    """
    load = scene.electrical_load
    if load.decay_rate is not None:
        return load.decay_rate
    resistance = load.circuit.resistance if load.circuit else load.resistance
    if not resistance:
        return 0.0
    if resistance * capacitance * FASTEST_DECAY < 1.0:
        raise LoadError(
            f"{scene.name}: the load's resistance of {resistance:g} Ω discharges the piezo's "
            f"{capacitance:g} F faster than {FASTEST_DECAY:g} times a second: choose a greater one"
        )
    return 1.0 / (resistance * capacitance)


def require_resistor(scene, method):
    """Refuse a load that λ does not describe.

    Raises
    ------
    LoadError
    """
    if not scene.electrical_load.is_resistor:
        raise LoadError(
            f"{scene.name}: {method} knows a resistor as load, and load.netlist is "
            f"{scene.electrical_load.netlist!r}; use the circuit engine"
        )
    if scene.excitation.prescribes_displacement:
        raise LoadError(
            f"{scene.name}: {method} knows a moving mass, and excitation.kind is "
            f"{scene.excitation.kind!r}; use the circuit engine"
        )


def length_scale(scene):
    """The scene's length unit l in metres: as given, else the well's distance, else the gap.

    A monostable device without stoppers has neither: its rms displacement under white noise
    of the same intensity is taken.
    """
    if scene.length_scale is not None:
        return scene.length_scale
    if scene.excitation.prescribes_displacement:
        return scene.excitation.amplitude
    oscillator = scene.oscillator
    if oscillator.linear_stiffness < 0.0 and oscillator.cubic_stiffness > 0.0:
        return math.sqrt(-oscillator.linear_stiffness / oscillator.cubic_stiffness)
    if scene.stoppers:
        return scene.stoppers.gap
    mass, damping = oscillator.mass, oscillator.damping
    stiffness = oscillator.linear_stiffness / mass
    longest = 2.0 * math.pi / math.sqrt(stiffness) / KNOTS_PER_PERIOD if stiffness else math.inf
    relaxation_time = mass / damping if damping else 1.0
    intensity, time = scene.excitation.equivalent_noise(relaxation_time, longest)
    rate = damping / mass or 1.0 / time
    return math.sqrt(intensity / (rate * (stiffness or rate**2)))


def knot_spacing(scene):
    """Spacing of the excitation's knots (s): the scene's, else what its kind chooses.

    Raises
    ------
    SceneError
        The scene's own does not fit its noise or its run.
    """
    parameters, _ = scale(scene)
    spacing, duration = scene.excitation.spacing(_longest_spacing(parameters)), scene.run.duration
    if spacing > duration and getattr(scene.excitation, "knot_spacing", None) is not None:
        raise SceneError(
            f"{scene.name}: run.duration = {duration:g}: must be at least one knot_spacing, "
            f"{spacing:g}"
        )
    return min(spacing, duration)


def steps_per_knot(scene, step="default", engine="circuit"):
    """Steps of an engine between two knots of the noise, away from the stoppers.

    Parameters
    ----------
    scene : Scene
    step : str or float
        A name in `STEP_LEVELS`, or the longest step in s.
    engine : str
        A key of `STEPS_PER_PERIOD`.
    """
    parameters, _ = scale(scene)
    spacing = knot_spacing(scene)
    if not isinstance(step, str):
        return max(1, math.ceil(spacing / step - 1e-9))
    if scene.excitation.prescribes_displacement:
        return STEP_LEVELS[step]
    longest = 2.0 * math.pi / parameters.fastest_angular_frequency / STEPS_PER_PERIOD[engine]
    load = scene.electrical_load.circuit
    finer = SWITCHING_STEPS if load and load.switches else 1
    if parameters.damping * spacing > 1.0:
        finer = max(finer, STEPS_OF_SLAVED_VELOCITY)
    return max(1, math.ceil(spacing / longest - 1e-9)) * STEP_LEVELS[step] * finer


def stop_time(scene):
    """End of a realization: settle and duration, in whole knots (s)."""
    spacing = knot_spacing(scene)
    total = scene.run.settle + scene.run.duration
    return math.ceil(total / spacing - 1e-9) * spacing


def _loss_rate(p, frequency):
    """c + N1 of Eq. 12: the rate at which damper and load take energy (1/s)."""
    return p.damping + p.coupling * p.decay_rate / (p.decay_rate**2 + frequency**2)


def _driven_stiffness(p, frequency):
    """Square of the frequency at the amplitude that noise at this frequency drives."""
    energy = RESOLVED_ENERGY * p.driven_square_velocity(frequency)
    if p.cubic_stiffness == 0.0 or energy == math.inf:
        return p.linear_stiffness + p.coupling
    # Above the bottom, which is −k²/4κ in a double well and 0 otherwise.
    height = energy
    if p.linear_stiffness >= 0.0:
        height += p.linear_stiffness**2 / (4.0 * p.cubic_stiffness)
    square = (math.sqrt(4.0 * p.cubic_stiffness * height) - p.linear_stiffness) / p.cubic_stiffness
    if p.has_stoppers:
        square = min(square, (p.gap + (2.5 * energy / p.contact_stiffness) ** 0.4) ** 2)
    return p.linear_stiffness + p.coupling + 0.75 * p.cubic_stiffness * square


def _pressed_rest(parameters):
    """Where spring and stopper balance, between gap and bare well."""
    from scipy.optimize import brentq

    def force(x):
        spring = parameters.linear_stiffness * x + parameters.cubic_stiffness * x**3
        return spring + parameters.contact_stiffness * (x - parameters.gap) ** 1.5

    far = parameters.gap
    step = 0.1 * parameters.gap
    while force(far) <= 0.0:
        far += step
        step *= 2.0
    return brentq(force, parameters.gap, far, xtol=1e-15, rtol=1e-15)
