"""Conversion of a scene to the scaled form (Eqs. 3–6), and the scales for converting back.

`harvester.scene.model` defines `Scene` and imports this module.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harvester.base.errors import LoadError, SceneError
from harvester.device import timescales
from harvester.device.contact import LAWS, SIDES, Contact
from harvester.device.damper import damper
from harvester.device.force_table import force_table
from harvester.device.hertz import HERTZ_EXPONENT
from harvester.device.polynomial import polynomial
from harvester.device.spring import ranged
from harvester.device.system import Noise, System
from harvester.device.terminals import Setting

if TYPE_CHECKING:
    from collections.abc import Iterator

    from harvester.device.spring import Spring

# Knots of the noise per period of small oscillations.
KNOTS_PER_PERIOD = 40
# Dimensions that are not scaled: powers of time, which has no scale, and stress in Pa.
UNSCALED = ("rate", "hourly_rate", "time", "stress")


@dataclass(frozen=True)
class Scales:
    """Size of one scaled unit of each quantity, in the scene's units (all 1 for a scaled scene).

    Displacement has the unit l, voltage the transducer's unit, and power M l² (s⁻³). Acceleration
    and velocity scale with l, energy with power.
    """

    displacement: float = 1.0
    voltage: float = 1.0
    power: float = 1.0

    def of(self, dimension: str) -> float:
        """Factor for a dimension such as "displacement^2", "voltage", "power" or "1"."""
        base, _, exponent = dimension.partition("^")
        if base in ("1", *UNSCALED):
            return 1.0
        name = {"velocity": "displacement", "energy": "power", "hourly_energy": "power"}.get(
            base, base
        )
        return getattr(self, name) ** int(exponent or 1)


def scale(scene: Any) -> tuple[System, Scales]:
    """The scaled device, and the scales for converting back (Eq. 3; time is not scaled)."""
    surroundings = setting(scene)
    mass, length = surroundings.mass, surroundings.length
    if scene.excitation.prescribes_displacement:
        # The mass follows the prescribed η; only the transducer remains.
        parts: dict[str, Any] = {"spring": polynomial(()), "damper": damper(0.0), "contacts": ()}
    else:
        spring = restoring_spring(scene.oscillator, mass, length)
        parts = {
            "spring": spring,
            "damper": damper(
                scene.oscillator.damping / mass, scene.oscillator.quadratic_damping * length / mass
            ),
            "contacts": tuple(
                _contact(stopper, side, mass, length)
                for stopper, side in acting_stoppers(scene, spring)
            ),
        }
    transducer = scene.transducer.equations(surroundings)
    volts = scene.transducer.voltage_unit(surroundings)
    system = System(**parts, transducer=transducer, noise=Noise(math.nan, math.inf))
    if not math.isinf(system.spring.range[0]) and not timescales.wells(system):
        raise SceneError(
            f"{scene.name}: oscillator.restoring_force_range = "
            f"{list(scene.oscillator.restoring_force_range or ())}: the mass has no stable rest "
            "position in this range: extend the range"
        )
    scales = Scales(displacement=length, voltage=volts, power=mass * length**2)
    # The excitation's noise if it is white or coloured, else the equivalent noise on the mass.
    intensity, time = scene.excitation.equivalent_noise(
        timescales.relaxation_time(system), longest_spacing(system)
    )
    noise = Noise(intensity / excitation_unit(scene, length) ** 2, time)
    return system._replace(noise=noise), scales


def excitation_unit(scene: Any, length: float) -> float:
    """Base acceleration for one unit of η: l/μ, with the base factor μ of a beam's mode."""
    return length / scene.oscillator.base_factor


def restoring_spring(oscillator: Any, mass: float = 1.0, length: float = 1.0) -> Spring:
    """The spring of a scene per mass and length unit; by default in the scene's units."""
    spring: Any
    if oscillator.force_table is not None:
        points = [(x / length, force / (mass * length)) for x, force in oscillator.force_table]
        spring = force_table(points, oscillator.force_interpolation)
    else:
        powers = enumerate(oscillator.coefficients)
        spring = polynomial([k * length ** (n - 1) / mass for n, k in powers])
    if oscillator.restoring_force_range is not None:
        low, high = oscillator.restoring_force_range
        spring = ranged(spring, low / length, high / length)
    return spring


def rest_stiffness(oscillator: Any) -> float:
    """F' at the stiffest rest position of the spring, in the scene's units; 0 if there is none."""
    spring = restoring_spring(oscillator)
    return max([float(spring.slope(float(x))) for x in spring.roots()], default=0.0)


def acting_stoppers(scene: Any, spring: Spring) -> Iterator[tuple[Any, str]]:
    """(stopper, side) of each contact of the scaled device, in the order of its contacts."""
    for stopper in scene.stoppers:
        if stopper.stiffness > 0.0:
            # If the spring is symmetric, a pair is one contact, else one on each side.
            split = stopper.side == "both" and not spring.symmetric
            for side in ("right", "left") if split else (stopper.side,):
                yield stopper, side


def _contact(stopper, side, mass, length):
    exponent = stopper.exponent
    factor = math.sqrt(length) if exponent == HERTZ_EXPONENT else length ** (exponent - 1.0)
    law = LAWS[stopper.law](
        stopper.stiffness * factor / mass,
        stopper.restitution,
        exponent,
        stopper.impact_velocity == "event",
    )
    return Contact(SIDES[side], stopper.gap / length, law)


def longest_spacing(system: System) -> float:
    """Longest knot spacing (s) that resolves small oscillations; infinite if there are none."""
    frequency = timescales.angular_frequency(system)
    return 2.0 * math.pi / frequency / KNOTS_PER_PERIOD if frequency > 0.0 else math.inf


def load_resistance(scene: Any) -> float | None:
    """Resistance of a resistive load (Ω), else None."""
    load = scene.load
    return load.circuit.resistance if load.circuit else load.resistance


def setting(scene: Any) -> Setting:
    """The surroundings of a scene's transducer: `harvester.device.terminals.Setting`."""
    scaled = scene.units != "SI"
    mass = 1.0 if scaled else scene.oscillator.mass
    length = 1.0 if scaled else length_scale(scene)
    rests = scene.excitation.prescribes_displacement
    return Setting(
        scene.units,
        mass,
        length,
        load_resistance(scene),
        scene.load.decay_rate,
        scene.name,
        0.0 if rests else excitation_unit(scene, length),
    )


def require_resistor(scene: Any, method: str) -> None:
    """Raise LoadError unless the load is a resistor, which λ describes."""
    if not scene.load.is_resistor:
        raise LoadError(
            f"{scene.name}: {method} takes only a resistor as load, and load.netlist is "
            f"{scene.load.netlist!r}; use the method circuit"
        )
    require_mass(scene, method)


def require_mass(scene: Any, method: str) -> None:
    """Raise LoadError if the excitation prescribes the displacement of the mass."""
    if scene.excitation.prescribes_displacement:
        raise LoadError(
            f"{scene.name}: {method} needs a mass that moves by forces, and excitation.kind is "
            f"{scene.excitation.kind!r}; use the method circuit"
        )


def length_scale(scene: Any) -> float:
    """The scene's length unit l in metres.

    It is the given value, else the distance of the farthest well, else a gap, else the rms
    displacement under white noise of the same intensity.
    """
    if scene.length_scale is not None:
        return scene.length_scale
    if scene.excitation.prescribes_displacement:
        return scene.excitation.amplitude
    farthest = _farthest_well(scene.oscillator)
    if farthest > 0.0:
        return farthest
    if scene.stoppers:
        return min(stopper.gap for stopper in scene.stoppers)
    damping, mass = scene.oscillator.damping, scene.oscillator.mass
    stiffness = abs(restoring_spring(scene.oscillator, mass).linear)
    longest = 2.0 * math.pi / math.sqrt(stiffness) / KNOTS_PER_PERIOD if stiffness else math.inf
    relaxation_time = mass / damping if damping else 1.0
    intensity, time = scene.excitation.equivalent_noise(relaxation_time, longest)
    rate = damping / mass or 1.0 / time
    factor = scene.oscillator.base_factor
    return factor * math.sqrt(intensity / (rate * (stiffness or rate**2)))


def _farthest_well(oscillator):
    """Distance of the farthest rest position from x = 0, for the spring alone (m)."""
    if oscillator.is_short_form:
        linear, cubic = oscillator.linear_stiffness, oscillator.cubic_stiffness
        return math.sqrt(-linear / cubic) if linear < 0.0 < cubic else 0.0
    bare = restoring_spring(oscillator)
    distances = [abs(float(x)) for x in bare.roots() if bare.slope(float(x)) > 0.0]
    return max(distances, default=0.0)
