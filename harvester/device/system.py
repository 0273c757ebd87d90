"""The sum of a device's parts: forces, losses and energies of Eqs. 4, 5 and 33 in scaled form.

Pure functions of a `System` s, displacement x and velocity v; they take floats, also in compiled
code. Only the parts of a system are compiled; missing parts cost no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from harvester.base.compilation import register_jitable
from harvester.device import contact as contacts
from harvester.device import spring as springs
from harvester.device.dispatch import equation

if TYPE_CHECKING:
    from harvester.device.contact import Contact
    from harvester.device.damper import Damper, QuadraticDamper
    from harvester.device.dispatch import Values
    from harvester.device.spring import Spring

# Largest step as a share of the shortest time to a contact. The approach then ends in a few
# decreasing steps, none of which enters the stopper.
APPROACH_SHARE = 0.8

part_force = equation("force")
damping_rate = equation("rate")
state_rate = equation("state_rate")
decay_rate = equation("decay_rate")
transducer_damping = equation("damping")
terminal_voltage = equation("voltage")
load_current = equation("current")
load_power = equation("load_power")
own_loss = equation("loss")
transducer_energy = equation("stored_energy")
transducer_stiffness = equation("stiffness")
base_rate = equation("base_rate")
base_speed = equation("base_speed")
kept_state = equation("kept_state")


class Noise(NamedTuple):
    """The Ornstein–Uhlenbeck noise of Eq. 6, or the noise equivalent to another excitation.

    Attributes
    ----------
    intensity : noise intensity D (scaled length² s⁻³).
    correlation_time
        Correlation time τ1 (s).
    """

    intensity: float
    correlation_time: float


class System(NamedTuple):
    """A device in scaled form with the noise that drives it; time in s, lengths in `Scales`.

    Attributes
    ----------
    spring : harvester.device.spring.Spring
    damper : harvester.device.damper.Damper or QuadraticDamper
    contacts : tuple of harvester.device.contact.Contact
    transducer
        The equations of a transducer, see harvester.device.terminals
    noise : Noise
    """

    spring: Spring
    damper: Damper | QuadraticDamper
    contacts: tuple[Contact, ...]
    transducer: Any
    noise: Noise

    @property
    def symmetric(self) -> bool:
        """Whether the device is symmetric under x → −x."""
        mirrored = sorted(contact._replace(side=0.0 - contact.side) for contact in self.contacts)
        return self.spring.symmetric and mirrored == sorted(self.contacts)

    @property
    def lossy_transducer(self) -> bool:
        """Whether the leak or the winding dissipates power."""
        return not self.transducer.lossless


@register_jitable
def push(s: System, x: float, v: float, state: float, noise: float) -> float:
    """Acceleration without contacts: excitation minus damper, transducer and spring forces."""
    damping = part_force(s.damper, v)
    return noise - damping - part_force(s.transducer, v, state) - springs.force(s.spring, x)


@register_jitable
def contact_force(
    s: System, x: float, v: float, held_speed: float, low: float, high: float
) -> float:
    """Force of the contacts that are active in the zone from `low` to `high`, f of Eq. 5."""
    return contacts.force(s.contacts, s.spring, x, v, held_speed, low, high)


@register_jitable
def loss_power(s: System, x: float, v: float, held_speed: float, touching: bool) -> float:
    """Power lost in damper and, if `touching`, contacts: [c + contact damping] X'² (Eq. 36)."""
    rate = damping_rate(s.damper, v)
    if touching:
        rate += contacts.loss_rate(s.contacts, s.spring, x, v, held_speed)
    return rate * v * v


@register_jitable
def potential(s: System, x: Values) -> Values:
    """Spring and contact energy, without the transducer's."""
    return springs.energy(s.spring, x) + contacts.energy(s.contacts, x)


@register_jitable
def stored_energy(s: System, x: float, v: float, state: float) -> float:
    """½ X'² + U(X) + the transducer's energy (physics of Eq. 33)."""
    mechanical = 0.5 * v * v + potential(s, x)
    return mechanical + transducer_energy(s.transducer, state)


def held_impact_speed(s: System, x: float, v: float) -> float:
    """Initial impact speed v0 of a run if v0 is held during contact (`event`).

    If the run starts in contact: the speed at which the mass would have entered the contact.
    """
    return float(np.sqrt(v * v + 2.0 * contacts.energy(s.contacts, x)))


def elastic_force(s: System, x: Values) -> Values:
    """dU/dx of spring and contacts; `x` a float or an array of any shape."""
    return springs.force(s.spring, x) + contacts.elastic_push(s.contacts, x)


@register_jitable
def earliest_contact(
    low: float, high: float, x: float, v: float, acceleration: float, margin: float
) -> float:
    """Time before which a free mass cannot reach `low` or `high` (s).

    The acceleration towards either end is at most `acceleration` (with its sign) plus `margin`.
    """
    earliest = np.inf
    for outward, distance, towards in ((v, high - x, acceleration), (-v, x - low, -acceleration)):
        gain = max(towards + margin, 0.0)
        closing = outward + np.sqrt(outward * outward + 2.0 * gain * distance)
        if closing > 0.0 and distance < np.inf:
            earliest = min(earliest, 2.0 * distance / closing)
    return earliest


@register_jitable
def resolving_step(
    s: System,
    low: float,
    high: float,
    x: float,
    v: float,
    acceleration: float,
    margin: float,
    longest: float,
    steps: int,
    landing: float = 1.0,
) -> float:
    """Step ≤ `longest` (s) that resolves a contact, or ends before the contact begins.

    Parameters
    ----------
    s : System
    low, high : float
        The free zone.
    x, v : float
    acceleration : float
        Acceleration by `push` (per length unit).
    margin : float
        Greatest change of the acceleration within `longest`.
    longest : float
        Step far from the contacts (s).
    steps : int
        Number of steps per contact.
    landing : float
        Share of a contact's step within which an unpredicted contact may begin.
    """
    # A mass pressed onto the stopper hits it with the speed gained within the step.
    speed = abs(v) + (abs(acceleration) + margin) * longest
    step = contacts.step(s.contacts, x, speed * speed, longest, steps)
    if x < low or x > high or (step == longest and landing == 1.0):
        return step
    free = APPROACH_SHARE * earliest_contact(low, high, x, v, acceleration, margin)
    return min(longest, max(landing * step, free))
