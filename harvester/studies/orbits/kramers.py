"""Kramers' rate out of a well under weak white noise, at any damping, and where it holds."""

import math

import numpy as np

from harvester.device import timescales
from harvester.device.system import potential
from harvester.prepared.prepared import Prepared

# Lowest barrier, in temperatures (units of kT), at which the formula is used: at three it is some
# 15 % off.
FEWEST_TEMPERATURES = 3.0
# Most by which the noise's colour may change the rate's exponent: the share by which the noise's
# density at the well's frequency lies below that at zero, times the barrier in temperatures.
MOST_COLOUR = 0.1
# Largest share of the well's stiffness, and of the damping, that the transducer may add.
MOST_TRANSDUCER = 0.01
NODES = 400


def kramers_time(ready: Prepared, well: float) -> tuple[float | None, str]:
    """Mean time until the other of two wells (s), or None and why the formula does not hold.

    Kramers' rate for moderate to strong damping (Physica 7, 284, 1940) times the depopulation
    factors of both wells, which hold for any damping (V. I. Mel'nikov and S. V. Meshkov, J. Chem.
    Phys. 85, 1018, 1986; P. Hänggi, P. Talkner and M. Borkovec, Rev. Mod. Phys. 62, 251, 1990).

    `well`: displacement of the well, scaled.
    """
    system = ready.system
    why = _refusal(ready, well)
    if why:
        return None, why
    (saddle,) = timescales.saddles(system)
    damping = system.damper.damping
    temperature = system.noise.intensity / damping
    barrier = timescales.barrier(system, well) / temperature
    omega = math.sqrt(timescales.stiffness(system, well))
    over = math.sqrt(-timescales.stiffness(system, saddle))
    slowing = (math.sqrt(damping**2 / 4.0 + over**2) - damping / 2.0) / over
    losses = [
        damping * _action(system, side, saddle) / temperature for side in timescales.wells(system)
    ]
    factor = math.prod(_depopulation(loss) for loss in losses) / _depopulation(sum(losses))
    return 2.0 * math.pi / (omega * slowing * factor) * math.exp(barrier), ""


def _refusal(ready, well):
    """Why Kramers' formula does not hold; empty where it does."""
    system, excitation = ready.system, ready.scene.excitation
    if len(timescales.wells(system)) != 2:
        return "it is for two wells"
    if excitation.kind not in ("white", "ornstein-uhlenbeck"):
        return f'it is for white noise, and excitation.kind = "{excitation.kind}"'
    drag = ready.scene.oscillator.quadratic_damping
    if not system.damper.damping > 0.0 or drag > 0.0:
        return "it is for a linear damper"
    if any(stopper.restitution < 1.0 for stopper in ready.scene.stoppers):
        return "stoppers take energy"
    omega = math.sqrt(max(timescales.stiffness(system, well), 0.0))
    added = system.transducer.loss_rate(omega)
    stiffer = system.transducer.stiffness(omega**2)
    if added > MOST_TRANSDUCER * system.damper.damping or stiffer > MOST_TRANSDUCER * omega**2:
        return "the transducer takes energy and stiffens the wells"
    barrier = timescales.barrier(system, well) * system.damper.damping / system.noise.intensity
    # Rounded as printed: an intensity of few digits makes 2.9999994 of three.
    if round(barrier, 2) < FEWEST_TEMPERATURES:
        return f"the barrier is {barrier:.2f} temperatures and not {FEWEST_TEMPERATURES:g} or more"
    colour = (omega * system.noise.correlation_time) ** 2
    if colour * barrier > MOST_COLOUR:
        return "the noise is coloured"
    return ""


def _action(system, well, saddle):
    """∮ X' dX of one round in a well at the saddle's energy."""
    from scipy.optimize import brentq

    top = float(potential(system, saddle))
    away = well - saddle
    while float(potential(system, well + away)) < top:
        away *= 1.5
    end = brentq(lambda x: float(potential(system, x)) - top, well, well + away)
    # The substitution x = middle − half · cos(angle) removes the root singularities at both ends.
    angle = (np.arange(NODES) + 0.5) * math.pi / NODES
    middle, half = 0.5 * (saddle + end), 0.5 * abs(end - saddle)
    x = middle - half * np.cos(angle)
    speed = np.sqrt(np.maximum(2.0 * (top - np.asarray(potential(system, x))), 0.0))
    return float(2.0 * np.sum(speed * half * np.sin(angle)) * math.pi / NODES)


def _depopulation(loss):
    """A(δ) of Mel'nikov and Meshkov, δ the energy lost in a round in temperatures."""
    from scipy.integrate import quad

    total = quad(
        lambda y: math.log(-math.expm1(-loss * (y * y + 0.25))) / (y * y + 0.25),
        0.0, math.inf, limit=200,
    )[0]  # fmt: skip
    return math.exp(total / math.pi)
