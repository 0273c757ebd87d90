"""From an impedance to a scene's numbers.

Y = iω Cp + 1/R_leak + iω θ²/(k − M ω² + iω C): the base clamped, small motion about the place where
the device rests. An impedance has one number less than the scene: fs, Q, θ²/M and Cp are known, and
stiffness, damping and coupling² are in proportion to the mass, which is that of the scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import IdentificationError, SceneError
from harvester.device import timescales
from harvester.device.piezo import PiezoTable
from harvester.identification.butterworth_van_dyke import (
    NUMBERS,
    SYMBOLS,
    ButterworthVanDyke,
    check_width,
    fitted_circuit,
    jacobian,
)
from harvester.identification.fitted_model import Fitted
from harvester.identification.intervals import HALF_INTERVAL, interval
from harvester.identification.measured_impedance import MeasuredImpedance
from harvester.identification.proof import predicted_lines
from harvester.identification.shooting import Shooting, ShootingFit
from harvester.identification.steady_response import NO_STATES, SteadyExperiment, SteadyResponses
from harvester.identification.unknowns import unknowns
from harvester.scene.numbers import numbers
from harvester.scene.prepared import prepared

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# A unit is taken to be wrong if the scene's capacitance differs from the measured one by this
# factor.
WRONG_UNIT = 100.0
# The scene gets a leakage resistance if tan δ exceeds this many of its standard errors.
SURE_OF_LOSS = 3.0
SPRING_KEYS = ("oscillator.restoring_force[1]", "oscillator.linear_stiffness")
# Most secant steps of k1 to reach the wanted stiffness at rest.
SECANTS = 30


@dataclass(frozen=True)
class FromImpedance:
    """A scene with the values that an impedance determines.

    Attributes
    ----------
    mode : int
        Index of the circuit's mode that is the scene's.
    measured : MeasuredImpedance
        The impedance, with the background of the other modes and of the loss.
    scene : Scene
        The scene with the fitted values.
    values : ndarray, shape (keys,)
    covariance : ndarray, shape (keys, keys)
        The mass being known.
    """

    circuit: ButterworthVanDyke
    mode: int
    measured: MeasuredImpedance
    scene: Scene
    keys: list[str]
    values: np.ndarray
    covariance: np.ndarray

    def parameters(self) -> dict[str, dict[str, Any]]:
        """fs, fp, Cp, k², Q and tan δ, each with its 95 % interval."""
        branch = self.circuit.numbers(self.mode)
        errors = self.circuit.standard_errors(self.mode)
        return {
            name: {
                "value": value,
                "standard_error": errors[name],
                "interval": interval(value, errors[name]),
                "unit": NUMBERS[name],
            }
            for name, value in branch.items()
        }

    def findings(self, mass_is_free: bool) -> list[str]:
        """The circuit's numbers, its other modes, and what the impedance leaves open."""
        lines = [f"{self.measured.name}: {_in_words(self.parameters())}"]
        for mode in range(self.circuit.modes):
            if mode != self.mode:
                other = self.circuit.numbers(mode)
                lines.append(
                    f"{self.measured.name}: another mode at {other['series_resonance']:.5g} Hz, Q "
                    f"{other['quality']:.3g}, k² {other['coupling_factor']:.3g}, is left out of "
                    "the scene; the capacitance of modes above is part of Cp"
                )
        if not mass_is_free:
            lines.append(
                "an impedance determines θ²/M, k/M and C/M, not the mass: for another mass, "
                "stiffness and damping are in proportion to it and coupling to its square root; "
                "weigh it, or give a record of voltage under a measured acceleration (--record)"
            )
        return lines


def _in_words(table):
    return ", ".join(
        f"{SYMBOLS[name]} {entry['value']:.5g} ± {HALF_INTERVAL * entry['standard_error']:.1g}"
        f"{' ' if entry['unit'] else ''}{entry['unit']}"
        for name, entry in table.items()
    )


def from_impedance(scene: Scene, measured: MeasuredImpedance) -> FromImpedance:
    """The scene with the values that an impedance determines.

    Raises
    ------
    SceneError
        The scene is scaled, or has no piezo.
    IdentificationError
        The impedance has no resonance, or is not that of the scene's device.
    """
    transducer = scene.transducer
    if scene.units != "SI" or not isinstance(transducer, PiezoTable):
        raise SceneError(
            f"{scene.name}: an impedance is that of a piezo in SI units: give the scene units = "
            '"SI" and a table [piezo]'
        )
    measured.check()
    lines = ~measured.aside
    circuit = fitted_circuit(measured.frequency[lines], measured.response[lines], measured.name)
    system = prepared(scene).system
    resting = float(system.spring.slope(timescales.rest(system)))
    # The circuit's mode whose frequency is nearest to the scene's, by their ratio, is the scene's.
    frequency = math.sqrt(max(resting, 1e-300)) / (2.0 * math.pi)
    mode = int(np.argmin(np.abs(np.log(circuit.resonances / frequency))))
    branch, errors = circuit.numbers(mode), circuit.standard_errors(mode)
    _check_capacitance(scene, branch["capacitance"], measured.name)
    check_width(measured.frequency[lines], circuit, mode, measured.name)
    leaks = branch["loss_tangent"] > SURE_OF_LOSS * errors["loss_tangent"]
    mass, spring_key = numbers(scene)["oscillator.mass"][0], _spring_key(scene)
    stiffness = mass * (2.0 * math.pi * branch["series_resonance"]) ** 2
    first, slope = _linear_term(scene, spring_key, stiffness)
    keys = [spring_key, "oscillator.damping", "piezo.coupling", "piezo.capacitance"]
    keys += ["piezo.leakage_resistance"] if leaks else []

    def values(parameters: np.ndarray) -> np.ndarray:
        branch = replace(circuit, parameters=parameters).numbers(mode)
        rate = 2.0 * math.pi * branch["series_resonance"]
        share = branch["coupling_factor"]
        motional = branch["capacitance"] * share / (1.0 - share)
        converted = [
            first + slope * (mass * rate**2 - stiffness),
            mass * rate / branch["quality"],
            rate * math.sqrt(mass * motional),
            branch["capacitance"],
        ]
        if leaks:
            converted.append(1.0 / (rate * branch["capacitance"] * branch["loss_tangent"]))
        return np.array(converted)

    slopes = jacobian(values, circuit.parameters)
    estimates = values(circuit.parameters)
    fitted_scene = scene.replace(dict(zip(keys, map(float, estimates), strict=True)))
    part = _own_admittance(fitted_scene, circuit, mode, measured.frequency)
    measured = replace(measured, background=circuit.admittance(measured.frequency) - part)
    covariance = slopes @ circuit.covariance @ slopes.T
    return FromImpedance(circuit, mode, measured, fitted_scene, keys, estimates, covariance)


def _own_admittance(scene, circuit, mode, frequency):
    """Admittance of the scene's own part of the circuit: one mode, its capacitance, its leak."""
    branch = circuit.numbers(mode)
    rate, ratio = 2j * math.pi * frequency, frequency / branch["series_resonance"]
    motional = branch["capacitance"] * branch["coupling_factor"] / (1.0 - branch["coupling_factor"])
    leak = scene.transducer.leakage_resistance
    admittance = rate * branch["capacitance"] + (1.0 / leak if leak else 0.0)
    return admittance + rate * motional / (1.0 - ratio**2 + 1j * ratio / branch["quality"])


def _spring_key(scene):
    for key in SPRING_KEYS:
        if key in numbers(scene):
            return key
    raise IdentificationError(
        f"{scene.name}: an impedance determines the stiffness at rest, and this spring has no "
        "linear term of its own: give it as restoring_force"
    )


def _linear_term(scene, key, stiffness):
    """(k1, ∂k1/∂stiffness) with which the device has this stiffness where it rests (N/m)."""
    mass, begun = (numbers(scene)[name][0] for name in ("oscillator.mass", key))

    def off(k1):
        try:
            system = prepared(scene.replace({key: float(k1)})).system
        except SceneError:
            return math.nan
        return mass * float(system.spring.slope(timescales.rest(system))) / stiffness - 1.0

    one = begun or stiffness
    other = one / (1.0 + off(one)) if off(one) > -1.0 else stiffness
    before, now = off(one), off(other)
    for _ in range(SECANTS):
        if abs(now) < 1e-12 or now == before:
            break
        one, other, before = other, other - now * (other - one) / (now - before), now
        now = off(other)
    if not abs(now) < 1e-9:
        raise IdentificationError(
            f"{scene.name}: no linear stiffness gives the device {stiffness:.4g} N/m where it "
            "rests: begin from a scene whose spring is nearer to that"
        )
    step = 1e-5 * abs(other)
    return other, 2.0 * step / (stiffness * (off(other + step) - off(other - step)))


def _check_capacitance(scene, capacitance, where):
    """Refuse a capacitance that only a wrong unit explains."""
    ratio = capacitance / scene.transducer.capacitance
    if 1.0 / WRONG_UNIT < ratio < WRONG_UNIT:
        return
    raise IdentificationError(
        f"{where}: the capacitance comes out at {capacitance:.3g} F, and the scene has "
        f"{scene.transducer.capacitance:.3g} F, a factor of {ratio:.3g}: check the units (ohm or "
        "kohm, Hz or kHz), or correct the scene"
    )


def fitted_impedance(found: FromImpedance) -> Fitted:
    """The model fitted to an impedance alone, with its predictions of the lines kept aside."""
    aside, keys = found.measured.aside, found.keys
    length = prepared(found.scene).scales.displacement
    free = unknowns(found.scene, found.keys, {})
    responses, validation = (
        SteadyResponses([SteadyExperiment(found.measured.part(lines), found.scene)], keys, length)
        for lines in (~aside, aside)
    )
    shooting = Shooting(responses, free, [np.zeros(3)])
    edges = np.array([0, int(np.count_nonzero(~aside))])
    noise = np.array(found.circuit.noise)
    fit = ShootingFit(found.values, [edges], [NO_STATES], [noise])
    shooting.linearized(fit)
    stretch = predicted_lines(validation, found.values, 0)
    return Fitted.concluded(found.scene, shooting, fit, found.covariance, [stretch])
