"""Voltage of a beam for each m/s² of its base: by a sum of finite elements' modes, and lumped."""

import numpy as np
from finite_elements_of_beams import matrices, modes_of

from harvester.device.beam.lumped import lumped, pieces_of, tip_of


def discrete(beam):
    """Ends of the pieces, the pieces, and what `matrices` gives of them."""
    pieces, tip = pieces_of(beam), tip_of(beam)
    ends = np.cumsum([0.0, *(each.length for each in pieces)])
    rigid, heavy = [each.rigidity for each in pieces], [each.mass for each in pieces]
    return ends, pieces, matrices(ends, rigid, heavy, tuple(tip))


def sum_of_modes(beam, frequencies, resistance, count=25):
    """V/a (V s²/m) on a resistor by so many modes, each of the beam's damping ratio; complex.

    With several resistances a row for each.
    """
    ends, pieces, (k, m, load, free, slopes) = discrete(beam)
    omega, phi = modes_of(k, m, free, count)
    coupling = sum(
        piece.moment_per_volt * (phi[slopes[float(b)]] - (phi[slopes[float(a)]] if a else 0.0))
        for piece, a, b in zip(pieces, ends[:-1], ends[1:], strict=True)
    )
    rate = 2j * np.pi * np.asarray(frequencies)[:, None]
    response = 1.0 / (omega**2 + rate**2 + 2.0 * beam.ratio * omega * rate)
    rate, capacitance = rate[:, 0], lumped(beam).material_capacitance
    admittance = rate * (capacitance + response @ coupling**2)
    return (
        -rate
        * (response @ (coupling * (load @ phi)))
        / (1.0 / np.asarray(resistance)[..., None] + admittance)
    )


def of_lumped_values(found, frequencies, admittance):
    """V/a (V s²/m) on an admittance (S) by one mode with the others static; complex.

    `found` is a `harvester.device.beam.lumped.LumpedBeam`, `admittance` a number or one for each
    frequency.
    """
    rate = 2j * np.pi * np.asarray(frequencies)
    compliance = 1.0 / (found.stiffness + found.mass * rate**2 + rate * found.damping)
    charge = found.coupling * found.base_factor * found.mass * compliance + found.rest_charge
    load = admittance + rate * (found.capacitance + found.coupling**2 * compliance)
    return -rate * charge / load
