"""Forces and energies of Eqs. 4a and 5 in scaled form.

Pure functions of `ScaledParameters` p, displacement x and velocity v; they take floats (also in
compiled code) or arrays of any one shape and return the same.
"""

import numpy as np

from harvester.compilation import register_jitable

# Hertz contact of a unit mass with K s^1.5 from approach speed v: the greatest compression is
# (5 v²/4K)^(2/5) and the contact lasts 2.9433 times that over v (elastic).
HERTZ_DURATION = 2.9432752
# Share of the earliest way to a contact that one step takes: the approach then ends in a few ever
# shorter steps, none of which jumps into the stopper.
APPROACH_SHARE = 0.8


@register_jitable
def bare_potential(p, x):
    """Spring energy without stoppers, ½ (−ω0²) x² + ¼ κ x⁴."""
    square = x * x
    return (0.5 * p.linear_stiffness + 0.25 * p.cubic_stiffness * square) * square


@register_jitable
def compression(p, x):
    """Depth of the contact, max(|x| − δ, 0)."""
    return np.maximum(np.abs(x) - p.gap, 0.0)


@register_jitable
def contact_energy(p, x):
    """Elastic energy of the stopper, ⅖ K (|x| − δ)^2.5 (Eq. 15)."""
    depth = compression(p, x)
    return 0.4 * p.contact_stiffness * depth * depth * np.sqrt(depth)


@register_jitable
def potential(p, x):
    """Spring and stopper energy, without the piezo."""
    return bare_potential(p, x) + contact_energy(p, x)


@register_jitable
def restoring_force(p, x):
    """dU/dx: −ω0² x + κ x³ + sgn(x) K (|x| − δ)^1.5."""
    depth = compression(p, x)
    spring = (p.linear_stiffness + p.cubic_stiffness * x * x) * x
    return spring + np.sign(x) * p.contact_stiffness * depth * np.sqrt(depth)


@register_jitable
def impact_speed(p, x, v):
    """Speed v0 at the start of the contact, read from the state during it (`energy`).

    v0² = v² + 2 max(U(x) − U(δ), ⅖ K (|x| − δ)^2.5). The second form acts where the stopper
    holds the mass short of the well's bottom and the first would turn imaginary: |v|/v0 ≤ 1
    always. Not meaningful out of contact.
    """
    spring = bare_potential(p, x) - bare_potential(p, p.gap)
    return np.sqrt(v * v + 2.0 * (contact_energy(p, x) + np.maximum(spring, 0.0)))


def speed_held_at_rest(p):
    """Speed v0 that `event` holds at the start, where the mass rests at `p.rest`.

    In contact it has not arrived: it takes the speed that stands for its compression. With none
    the damping were dry friction, which holds the mass and which no implicit step gets through.
    """
    return impact_speed(p, p.rest, 0.0) if p.rest > p.gap else 0.0


@register_jitable
def contact_damping(p, x, v, held_speed):
    """Damping force of the contact over velocity, K (|x| − δ)^1.5 · ¾ (1 − e²)/v0 (Eq. 5).

    `held_speed` is v0 in `event` mode, raised to |v| where it lies below, so that |v|/v0 ≤ 1
    always; it is not read in `energy` mode.
    """
    depth = compression(p, x)
    held = p.held_impact_velocity
    speed = np.maximum(held_speed, np.abs(v)) if held else impact_speed(p, x, v)
    factor = 0.75 * (1.0 - p.restitution * p.restitution)
    return factor * p.contact_stiffness * depth * np.sqrt(depth) / np.maximum(speed, 1e-300)


@register_jitable
def contact_force(p, x, v, held_speed):
    """f of Eq. 5, the spring part away from the stopper on either side; in contact only."""
    depth = compression(p, x)
    spring = np.sign(x) * p.contact_stiffness * depth * np.sqrt(depth)
    return spring + contact_damping(p, x, v, held_speed) * v


@register_jitable
def stored_energy(p, x, v, voltage):
    """½ v² + U(x) + ½ β V² (physics of Eq. 33)."""
    return 0.5 * v * v + potential(p, x) + 0.5 * p.coupling * voltage * voltage


@register_jitable
def contact_time(p, speed):
    """Duration of an elastic Hertz contact that starts with this speed (s)."""
    greatest = (1.25 * speed * speed / p.contact_stiffness) ** 0.4
    return HERTZ_DURATION * greatest / speed


@register_jitable
def contact_step(p, x, v, longest, steps):
    """Step that takes so many steps for the contact this state is in or about to enter.

    At most `longest` (s).
    """
    square = v * v + 2.0 * contact_energy(p, x)
    # The same comparison without a power, for the usual case of a soft contact.
    bound = HERTZ_DURATION / (steps * longest)
    bound = bound * bound * bound * bound * bound
    soft = 1.25 / p.contact_stiffness
    if square <= bound * bound * soft * soft * soft * soft:
        return longest
    return min(longest, contact_time(p, np.sqrt(square)) / steps)


@register_jitable
def push(p, x, v, voltage, noise):
    """Acceleration by all but the stoppers, η − c v + ω0² x − κ x³ − β V."""
    spring = (p.linear_stiffness + p.cubic_stiffness * x * x) * x
    return noise - p.damping * v - p.coupling * voltage - spring


@register_jitable
def earliest_contact(p, x, v, acceleration, margin):
    """Time before which a free mass cannot meet a stopper (s).

    Its acceleration towards either one is at most `acceleration` towards it plus `margin`.
    """
    earliest = np.inf
    for side in (1.0, -1.0):
        outward = side * v
        distance = p.gap - side * x
        gain = max(side * acceleration + margin, 0.0)
        closing = outward + np.sqrt(outward * outward + 2.0 * gain * distance)
        if closing > 0.0:
            earliest = min(earliest, 2.0 * distance / closing)
    return earliest


@register_jitable
def resolving_step(p, x, v, acceleration, margin, longest, steps):
    """Step that resolves a contact and, before it, ends short of it, ≤ `longest` (s).

    Parameters
    ----------
    p, x, v
        Parameters and state.
    acceleration : float
        From `push`.
    margin : float
        Greatest change of it within `longest`.
    longest : float
        Step away from the stoppers (s).
    steps : int
        Per contact.
    """
    if p.contact_stiffness == 0.0:
        return longest
    # A mass pressed or drawn onto the stopper meets it with what it gains on the way.
    speed = abs(v) + (abs(acceleration) + margin) * longest
    step = contact_step(p, x, speed, longest, steps)
    if step == longest or abs(x) > p.gap:
        return step
    free = APPROACH_SHARE * earliest_contact(p, x, v, acceleration, margin)
    return min(longest, max(step, free))
