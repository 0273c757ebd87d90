"""Strain and stress of the outer fibre at the clamp, of the displacement and the voltage.

The first mode's curvature follows the displacement. The modes left out are taken as static: under
a voltage the beam bends as a short piece, EI w'' = −ϑ V, and under an acceleration of the base by
its bending moment; what the first mode has of both is taken off.
"""

from __future__ import annotations

from typing import NamedTuple

from harvester.beam.modes import rest
from harvester.beam.table import Beam, lumped, pieces_of, section, tip_of


class ClampStrain(NamedTuple):
    """Coefficients of the strain (1) and the stress (Pa) at the clamp.

    Attributes
    ----------
    per_displacement : strain for each metre of the tip (1/m).
    per_volt : strain of the modes left out for each volt (1/V).
    per_acceleration : the same for each m/s² of the base (s²/m).
    modulus : stress for each strain, electrodes short-circuited (Pa).
    stress_per_volt : what the field adds to the stress (Pa/V); 0 where no layer is at the clamp.
    """

    per_displacement: float
    per_volt: float
    per_acceleration: float
    modulus: float
    stress_per_volt: float


def clamp_strain(beam: Beam) -> ClampStrain:
    """Strain and stress of the layer's outer fibre at the clamp, else the substrate's."""
    made, pieces = lumped(beam), pieces_of(beam)
    covered = beam.piezo_start == 0.0
    outer, root = section(beam, covered).outer, pieces[0]
    every = rest(pieces, tip_of(beam))
    curvature = made.surface_strain / outer
    mode_per_volt = curvature * made.coupling / made.stiffness
    mode_per_acceleration = curvature * made.base_factor * made.mass / made.stiffness
    return ClampStrain(
        per_displacement=made.surface_strain,
        per_volt=-outer * (root.moment_per_volt / root.rigidity - mode_per_volt),
        per_acceleration=-outer * (every.root_moment / root.rigidity - mode_per_acceleration),
        modulus=beam.active[0] if covered else beam.substrate[0],
        stress_per_volt=_stress_per_volt(beam) if covered else 0.0,
    )


def _stress_per_volt(beam):
    """|e31| times the field of a layer for each volt at the terminals."""
    modulus, _, d31, _ = beam.active
    share = 0.5 if beam.layers == 2 and beam.connection == "series" else 1.0
    return abs(d31) * modulus * share / (beam.electrode_spacing or beam.piezo_thickness)
