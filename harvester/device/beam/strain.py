"""Strain and stress of layers and substrate as functions of displacement, voltage and acceleration.

The first mode's curvature is proportional to the displacement. The residual modes are static: a
voltage gives the curvature EI w'' = −ϑ V, and the base's acceleration the curvature of its bending
moment; the first mode's share of both is subtracted. A layer on one side also stretches the beam.
"""

from __future__ import annotations

from typing import NamedTuple

from harvester.device.beam.lumped import Beam, lumped, pieces_of, section, spans, tip_of
from harvester.device.beam.modes import rest


class FibreStrain(NamedTuple):
    """Coefficients of the strain (1) and the stress (Pa) of a fibre.

    Attributes
    ----------
    position
        Distance from the clamp (m).
    per_displacement : strain per displacement of the tip (1/m).
    per_volt : strain of the residual modes per volt (1/V).
    per_acceleration
        Strain of the residual modes per acceleration of the base (s²/m).
    modulus : stress per strain, electrodes short-circuited (Pa).
    stress_per_volt
        Stress by a layer's field per volt (Pa/V).
    """

    position: float
    per_displacement: float
    per_volt: float
    per_acceleration: float
    modulus: float
    stress_per_volt: float


def strain_of_layers(beam: Beam) -> FibreStrain:
    """Strain of the active layers' outer fibre, where the first mode's strain is largest."""
    height = beam.thickness / 2.0 + beam.piezo_thickness
    modulus, _, d31, _ = beam.active
    # Share of the terminal voltage across one layer.
    share = 0.5 if beam.layers == 2 and beam.connection == "series" else 1.0
    stress = abs(d31) * modulus * share / (beam.electrode_spacing or beam.piezo_thickness)
    return _most_strained(beam, (height,), modulus, stress, (True,))


def strain_of_substrate(beam: Beam) -> FibreStrain:
    """Strain of the substrate's surface, where the first mode's strain is largest."""
    half = beam.thickness / 2.0
    return _most_strained(beam, (half, -half), beam.substrate[0], 0.0, (True, False))


def _most_strained(beam, heights, modulus, stress_per_volt, covers):
    """The fibre with the largest strain, at `heights` above the substrate's middle.

    The first mode's moment is monotone along a piece, so only the ends of pieces are examined.
    """
    values, pieces = lumped(beam), pieces_of(beam)
    moments, fibres = rest(pieces, tip_of(beam)).moments, []
    for n, (low, top, covered) in enumerate(spans(beam)):
        if covered not in covers:
            continue
        cut, piece = section(beam, covered), pieces[n]
        for position, curvature, moment in zip(
            (low, top), values.curvatures[n], moments[n], strict=True
        ):
            by_volt = piece.moment_per_volt / piece.rigidity
            by_volt -= curvature * values.coupling / values.stiffness
            by_base = curvature * values.base_factor * values.mass / values.stiffness
            fibres += [
                FibreStrain(
                    position=position,
                    per_displacement=(height - cut.axis) * curvature,
                    per_volt=-(height - cut.axis) * by_volt - cut.stretch_per_volt,
                    per_acceleration=-(height - cut.axis) * (moment / piece.rigidity - by_base),
                    modulus=modulus,
                    stress_per_volt=stress_per_volt,
                )
                for height in heights
            ]
    return max(fibres, key=lambda fibre: abs(fibre.per_displacement))
