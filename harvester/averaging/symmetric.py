"""The device of the source paper: the one for which the averaging closures are written.

A symmetric spring −ω0² X + κ X³, equal Hertz-damp stoppers on both sides or none, a linear damper,
and a piezo without leak on a resistor.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from harvester.device import spring as springs
from harvester.device import system, timescales
from harvester.device.contact import Contact
from harvester.device.damper import Damper, damper
from harvester.device.hertz import HERTZ_EXPONENT, HertzDamp, hertz_damp
from harvester.device.piezo import Piezo, piezo
from harvester.device.spring import spring
from harvester.device.system import Noise, System
from harvester.device.values import Values
from harvester.errors import AveragingError


class SymmetricDevice(NamedTuple):
    """Coefficients of Eqs. 4–6 in scaled form, time in s.

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
        D and τ1 of Eq. 6.
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
    def system(self) -> System:
        """The same as a sum of parts, `harvester.device.system.System`."""
        law = hertz_damp(self.contact_stiffness, self.restitution, event=self.held_impact_velocity)
        return System(
            spring=spring((0.0, self.linear_stiffness, 0.0, self.cubic_stiffness)),
            damper=damper(self.damping),
            contacts=(Contact(0.0, self.gap, law),) if self.has_stoppers else (),
            transducer=piezo(self.coupling, self.decay_rate),
            noise=Noise(self.intensity, self.correlation_time),
        )

    @property
    def has_stoppers(self) -> bool:
        """Whether a contact force can ever act."""
        return math.isfinite(self.gap) and self.contact_stiffness > 0.0

    @property
    def damping_factor(self) -> float:
        """¾ (1 − e²): b·v0 of Eq. 5, without unit."""
        return 0.75 * (1.0 - self.restitution**2)

    @property
    def rest(self) -> float:
        """Stable rest position X ≥ 0 with the stoppers, without charge on the piezo."""
        if self.linear_stiffness < 0.0 and self.cubic_stiffness == 0.0 and not self.has_stoppers:
            return math.inf
        return timescales.rest(self.system)

    @property
    def preloaded(self) -> bool:
        """Whether the mass rests on the stopper, because the gap ends before the bare well."""
        return self.has_stoppers and self.rest > self.gap

    @property
    def angular_frequency(self) -> float:
        """Of small oscillations about `rest` with the piezo open (rad/s)."""
        return timescales.angular_frequency(self.system)

    @property
    def relaxation_time(self) -> float:
        """Time in which damper and load take the energy of small oscillations (s), Eq. 12."""
        return timescales.relaxation_time(self.system)


def potential(p: SymmetricDevice, x: Values) -> Values:
    """U(X) of spring and stoppers of a `SymmetricDevice`; `x` a float or an array of any shape."""
    return system.potential(p.system, x)


def restoring_force(p: SymmetricDevice, x: Values) -> Values:
    """dU/dX; `x` a float or an array of any shape."""
    return system.elastic_force(p.system, x)


def contact_damping(p: SymmetricDevice, x: Values, v: Values, held_speed: Values) -> Values:
    """Damping force of the stoppers over velocity (1/s); floats or arrays of any one shape.

    `held_speed` is v0 where it is held from the moment of contact.
    """
    s = p.system
    damping = 0.0 * np.asarray(x, dtype=float)
    for each in s.contacts:
        depth = np.maximum(np.abs(x) - each.gap, 0.0)
        gain = springs.energy(s.spring, x) - springs.energy(s.spring, each.gap)
        damping = damping + each.law.damping(depth, v, gain, held_speed)
    return damping


def contact_time(p: SymmetricDevice, speed: float) -> float:
    """Duration of an elastic contact that begins with this speed (s)."""
    (each,) = p.system.contacts
    return each.law.duration(speed)


def symmetric_device(whole: System) -> SymmetricDevice:
    """A system in the form that the closures take.

    Parameters
    ----------
    whole : harvester.device.system.System

    Returns
    -------
    SymmetricDevice

    Raises
    ------
    AveragingError
        It has a part that Eqs. 10–37 do not know.
    """
    spring_, contacts, transducer = whole.spring, whole.contacts, whole.transducer
    laws = [each.law for each in contacts]
    refusals = {
        "the spring is not symmetric": not spring_.symmetric,
        "the spring has powers above the third": len(spring_.odd) > 2,
        "the damper has a quadratic part": not isinstance(whole.damper, Damper),
        "the stoppers are not one pair of equal ones": len(contacts) > 1
        or any(each.side != 0.0 for each in contacts),
        "the contact law is not Hertz's": any(
            not isinstance(law, HertzDamp) or law.exponent != HERTZ_EXPONENT for law in laws
        ),
        "the transducer is not a piezo": not isinstance(transducer, Piezo),
        "the piezo leaks": isinstance(transducer, Piezo) and transducer.own_rate > 0.0,
    }
    for reason, holds in refusals.items():
        if holds:
            raise AveragingError(
                f"{reason}: averaging over orbits knows the source paper's symmetric device only; "
                "use the closure fokker_planck, or simulate"
            )
    linear, cubic = (*spring_.odd, 0.0, 0.0)[:2]
    law = laws[0] if laws else None
    return SymmetricDevice(
        damping=whole.damper.damping,
        linear_stiffness=linear,
        cubic_stiffness=cubic,
        gap=contacts[0].gap if law else math.inf,
        contact_stiffness=law.stiffness if law else 0.0,
        restitution=math.sqrt(1.0 - law.damping_factor / 0.75) if law else 1.0,
        held_impact_velocity=bool(law and law.holds),
        coupling=transducer.coupling,
        decay_rate=transducer.load_rate,
        intensity=whole.noise.intensity,
        correlation_time=whole.noise.correlation_time,
    )
