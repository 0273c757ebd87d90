"""Strain and stress of the layers and the substrate, of the displacement and the voltage.

The first mode's curvature follows the displacement. The modes left out are taken as static: under
a voltage the beam bends as a short piece, EI w'' = −ϑ V, and under an acceleration of the base by
its bending moment; the first mode's part of both is subtracted. A layer on one side also stretches
the beam.
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
    per_displacement : strain for each metre of the tip (1/m).
    per_volt : strain of the modes left out for each volt (1/V).
    per_acceleration
        Strain per m/s² of the base's acceleration (s²/m).
    modulus : stress for each strain, electrodes short-circuited (Pa).
    stress_per_volt
        Stress per voltage by a layer's field (Pa/V).
    """

    position: float
    per_displacement: float
    per_volt: float
    per_acceleration: float
    modulus: float
    stress_per_volt: float


def strain_of_layers(beam: Beam) -> FibreStrain:
    """Strain of the active layers' outer fibre, where the first mode strains it most."""
    height = beam.thickness / 2.0 + beam.piezo_thickness
    modulus, _, d31, _ = beam.active
    # |e31| times the field of a layer for each volt at the terminals.
    share = 0.5 if beam.layers == 2 and beam.connection == "series" else 1.0
    stress = abs(d31) * modulus * share / (beam.electrode_spacing or beam.piezo_thickness)
    return _most_strained(beam, (height,), modulus, stress, (True,))


def strain_of_substrate(beam: Beam) -> FibreStrain:
    """Strain of the substrate's surface, where the first mode strains it most."""
    half = beam.thickness / 2.0
    return _most_strained(beam, (half, -half), beam.substrate[0], 0.0, (True, False))


def _most_strained(beam, heights, modulus, stress_per_volt, covers):
    """The fibre of most strain, at `heights` above the substrate's middle.

    The first mode's moment falls steadily along a piece, so that only the ends of pieces count.
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
