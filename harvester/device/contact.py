"""Contacts: positions of the stoppers, active stoppers, and sums over their forces.

A contact on the side s = ±1 acts while its depth d = s x − gap is positive; a pair of stoppers at
±gap is one contact with side 0. A zone is an interval of x in which the same contacts are active.
Integrators step from zone to zone, so that every force is smooth within a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from harvester.base import compilation
from harvester.base.compilation import overload, register_jitable
from harvester.base.registry import Registry
from harvester.device import spring as springs
from harvester.device.dispatch import equation
from harvester.device.hertz import hertz_damp

if TYPE_CHECKING:
    from harvester.device.dispatch import Values
    from harvester.device.spring import Spring

# Constructors of contact laws, by the values of a scene's `law`; their arguments are scaled.
LAWS: Registry[Callable] = Registry("harvester.contact_laws", {"hertz-damp": hertz_damp})
SIDES = {"left": -1.0, "right": 1.0, "both": 0.0}

elastic_force = equation("elastic_force")
elastic_energy = equation("elastic_energy")
damping = equation("damping")
shortened = equation("shortened")


class Contact(NamedTuple):
    """One stopper, or a pair of equal ones at ±gap.

    Attributes
    ----------
    side
        1 right, −1 left, 0 both.
    gap
        Distance of the stopper from x = 0, scaled.
    law
        A law's named tuple, such as `harvester.device.hertz.HertzDamp`.
    """

    side: float
    gap: float
    law: Any


@register_jitable
def direction(contact: Contact, x: Values) -> Values:
    """The side s = ±1 on which contact is possible at x."""
    return contact.side if contact.side != 0.0 else np.copysign(1.0, x)


@register_jitable
def one_reaction(
    contact: Contact, spring: Spring, x: float, v: float, held_speed: float, low: float, high: float
) -> tuple[float, float]:
    """Elastic force and damping (1/s) of one contact; see `reaction`."""
    s = contact.side
    if s == 0.0:
        s = 1.0 if low >= contact.gap else -1.0
    acts = low >= contact.gap if s > 0.0 else high <= -contact.gap
    if not acts:
        return 0.0, 0.0
    # Rounding may put the start of a step just outside the zone; depth 0 keeps a dashpot active
    # there.
    depth = max(s * x - contact.gap, 0.0)
    gain = springs.energy(spring, x) - springs.energy(spring, s * contact.gap)
    push = s * elastic_force(contact.law, depth)
    return push, damping(contact.law, depth, v, gain, held_speed)


def _of_one_sort(contacts):
    """Whether all contacts have one type: one compiled loop then serves any number of contacts."""
    return isinstance(contacts, compilation.types.UniTuple) and len(contacts) > 2


def reaction(
    contacts: tuple[Contact, ...],
    spring: Spring,
    x: float,
    v: float,
    held_speed: float,
    low: float,
    high: float,
) -> tuple[float, float]:
    """Elastic force and damping (1/s) of the contacts that act in the zone from `low` to `high`.

    For the stoppers that are active at a displacement x, give the zone from x to x.
    """
    reactions = [one_reaction(one, spring, x, v, held_speed, low, high) for one in contacts]
    return sum(push for push, _ in reactions), sum(rate for _, rate in reactions)


@overload(reaction)
def _reaction(contacts, spring, x, v, held_speed, low, high):
    if len(contacts) == 0:
        return lambda contacts, spring, x, v, held_speed, low, high: (0.0, 0.0)

    def in_turn(contacts, spring, x, v, held_speed, low, high):
        push, rate = 0.0, 0.0
        for contact in contacts:
            extra_push, extra_rate = one_reaction(contact, spring, x, v, held_speed, low, high)
            push, rate = push + extra_push, rate + extra_rate
        return push, rate

    def add(contacts, spring, x, v, held_speed, low, high):
        push, rate = one_reaction(contacts[0], spring, x, v, held_speed, low, high)
        extra_push, extra_rate = reaction(contacts[1:], spring, x, v, held_speed, low, high)
        return push + extra_push, rate + extra_rate

    return in_turn if _of_one_sort(contacts) else add


@register_jitable
def force(
    contacts: tuple[Contact, ...],
    spring: Spring,
    x: float,
    v: float,
    held_speed: float,
    low: float,
    high: float,
) -> float:
    """Force against X' of the contacts that act in the zone from `low` to `high`."""
    push, rate = reaction(contacts, spring, x, v, held_speed, low, high)
    return push + rate * v


@register_jitable
def loss_rate(
    contacts: tuple[Contact, ...], spring: Spring, x: float, v: float, held_speed: float
) -> float:
    """Damping force over velocity of the contacts that act at a displacement (1/s)."""
    return reaction(contacts, spring, x, v, held_speed, x, x)[1]


@register_jitable
def one_energy(contact: Contact, x: Values) -> Values:
    """Elastic energy in one contact; `x` a float or an array of any shape."""
    depth = np.maximum(direction(contact, x) * x - contact.gap, 0.0)
    return elastic_energy(contact.law, depth)


def energy(contacts: tuple[Contact, ...], x: Values) -> Values:
    """Elastic energy in all contacts; `x` a float or an array of any shape."""
    return sum((one_energy(contact, x) for contact in contacts), 0.0 * x)


@overload(energy)
def _energy(contacts, x):
    if len(contacts) == 0:
        return lambda contacts, x: 0.0

    def in_turn(contacts, x):
        total = 0.0
        for contact in contacts:
            total += one_energy(contact, x)
        return total

    def add(contacts, x):
        return one_energy(contacts[0], x) + energy(contacts[1:], x)

    return in_turn if _of_one_sort(contacts) else add


@register_jitable
def one_step(contact: Contact, x: float, square_speed: float, longest: float, steps: int) -> float:
    """Step (s), at most `longest`, that resolves a contact with this squared speed at its gap."""
    depth = np.maximum(direction(contact, x) * x - contact.gap, 0.0)
    square = square_speed + 2.0 * elastic_energy(contact.law, depth)
    return shortened(contact.law, square, steps, longest)


def step(
    contacts: tuple[Contact, ...], x: float, square_speed: float, longest: float, steps: int
) -> float:
    """The shortest of `one_step` over all contacts (s)."""
    return min(
        (one_step(contact, x, square_speed, longest, steps) for contact in contacts),
        default=longest,
    )


@overload(step)
def _step(contacts, x, square_speed, longest, steps):
    if len(contacts) == 0:
        return lambda contacts, x, square_speed, longest, steps: longest

    def in_turn(contacts, x, square_speed, longest, steps):
        least = longest
        for contact in contacts:
            least = min(least, one_step(contact, x, square_speed, longest, steps))
        return least

    def shortest(contacts, x, square_speed, longest, steps):
        first = one_step(contacts[0], x, square_speed, longest, steps)
        return min(first, step(contacts[1:], x, square_speed, longest, steps))

    return in_turn if _of_one_sort(contacts) else shortest


def elastic_push(contacts: tuple[Contact, ...], x: Values) -> Values:
    """Elastic force of all contacts at x, for calls from Python: float or array of any shape."""
    total = 0.0 * np.asarray(x, dtype=float)
    for contact in contacts:
        s = np.sign(x) if contact.side == 0.0 else contact.side
        depth = np.maximum(s * x - contact.gap, 0.0)
        total = total + s * contact.law.elastic_force(depth)
    return total


def edges(contacts: tuple[Contact, ...]) -> tuple[float, ...]:
    """Displacements at which a contact begins, ascending, between −inf and inf: tuple of float."""
    places = set()
    for contact in contacts:
        if contact.side >= 0.0:
            places.add(contact.gap)
        if contact.side <= 0.0:
            places.add(-contact.gap)
    return (-math.inf, *sorted(places), math.inf)


def pulled_back(contact: Contact, spring: Spring) -> bool:
    """Whether the spring pushes the mass away from this contact at every depth.

    Then the spring energy U(x) − U(gap) is never negative in contact, and the impact speed v0 needs
    no bound.
    """
    sides = (1.0, -1.0) if contact.side == 0.0 else (contact.side,)
    for s in sides:
        beyond = [root for root in spring.roots() if s * root > contact.gap]
        if beyond or s * spring.force(s * contact.gap) < 0.0:
            return False
    return True


def arrival_formula(
    contact: Contact, s: float, spring: Spring, x: str, rate: float, number: Callable
) -> str:
    """Expression of 2 [U(x) − U(s gap)]/rate², the squared speed at which a stopper is reached."""
    return spring.gain_formula(x, s * contact.gap, rate, number)


def formulas(
    contact: Contact,
    spring: Spring,
    x: str,
    u: str,
    rate: float,
    number: Callable,
    held: str = "",
    bounded: bool = False,
) -> tuple[str, str]:
    """(condition, force over rate²) of one contact as expressions of circuits and Verilog-A.

    The force applies if the condition is true. See `HertzDamp.force_formula` for the arguments; a
    pair of stoppers needs a symmetric spring. `bounded` bounds U(x) − U(gap) by 0 even if this
    spring does not need it: its numbers may be varied.
    """
    gap = number("gap", contact.gap, "displacement at which it begins", "(0:inf)")
    sides = {
        1.0: (f"{x}>{gap}", f"{x}-{gap}", "1.0"),
        -1.0: (f"{x}<-{gap}", f"-{x}-{gap}", "-1.0"),
        0.0: (f"abs({x})>{gap}", f"abs({x})-{gap}", f"sgn({x})"),
    }
    condition, depth, sign = sides[contact.side]
    gain = arrival_formula(contact, contact.side or 1.0, spring, x, rate, number)
    if bounded or not (pulled_back(contact, spring) and spring.gain_is_product):
        gain = f"((({gain})>0) ? ({gain}) : 0)"
    return condition, contact.law.force_formula(depth, sign, u, gain, number, held, rate)
