"""Lumped values of a beam's drawing, as rows with their equations and as a figure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device.beam.lumped import Beam, frequencies, lumped, notes, pieces_of, tip_of
from harvester.device.beam.magnets import Magnets, magnet_notes, polynomial_fit, spring_points
from harvester.device.beam.materials import ACTIVE, PASSIVE
from harvester.device.beam.modes import shape
from harvester.device.beam.strain import strain_of_layers, strain_of_substrate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUBSTRATE, LAYER, TIP, LINE = "0.6", "#d98c3f", "0.25", "#3b6ea5"


def rows(beam: Beam) -> list[tuple[str, str, float, str]]:
    """(name, equation, value, unit) of every lumped value.

    Equation numbers refer to docs/explanation/beams.md.
    """
    values = lumped(beam)
    several, strain = frequencies(beam), strain_of_layers(beam)
    substrate = strain_of_substrate(beam)
    table = [
        ("mass M", "1/φ(L)² (B4)", values.mass, "kg"),
        ("stiffness K", "ω² M (B4)", values.stiffness, "N/m"),
        ("damping C", "2 ζ ω M (B4)", values.damping, "N s/m"),
        ("base factor μ", "φ(L) γ (B5)", values.base_factor, "1"),
        ("coupling θ", "χ/φ(L) (B6)", values.coupling, "N/V"),
        ("capacitance of the layers Cp", "(B7)", values.material_capacitance, "F"),
        ("capacitance of the residual modes", "Σ χr²/ωr² (B8)", values.rest_capacitance, "F"),
        ("charge of the residual modes", "Σ χr γr/ωr² (B8)", values.rest_charge, "C s²/m"),
        ("coupling squared k²", "θ²/(K Cp)", values.coupling_squared, "1"),
        ("short-circuit frequency", "(B3)", values.short_frequency, "Hz"),
        ("open-circuit frequency", "with the residual modes", values.open_frequency, "Hz"),
        ("open-circuit frequency", "of one mode alone", values.one_mode_open_frequency, "Hz"),
        ("second frequency", "(B3)", several[1], "Hz"),
        ("third frequency", "(B3)", several[2], "Hz"),
        ("strain of the layers per displacement", "(B9)", strain.per_displacement, "1/m"),
        ("distance of this strain from the clamp", "(B9)", strain.position, "m"),
        ("strain of the residual modes per volt", "(B9)", strain.per_volt, "1/V"),
        ("strain of the residual modes per acceleration", "(B9)", strain.per_acceleration, "s²/m"),
        ("strain of the substrate per displacement", "(B9)", substrate.per_displacement, "1/m"),
        ("distance of the substrate's strain from the clamp", "(B9)", substrate.position, "m"),
    ]
    if beam.measured_frequency is not None:
        compliance = values.clamp_compliance
        table.append(("clamp's compliance", "from measured_frequency", compliance, "rad/(N m)"))
    if beam.measured_capacitance is not None:
        factor = values.permittivity_factor
        table.append(("factor on the permittivity", "from measured_capacitance", factor, "1"))
    return table


def remarks(beam: Beam, magnets: Magnets | None = None) -> list[str]:
    """Remarks: limits of the theory, sources of material data, the magnets as a polynomial."""
    lines = notes(beam)
    if beam.tip_material and beam.tip_offset == 0.0:
        flush = replace(beam, tip_offset=-(beam.tip_length or 0.0) / 2.0, measured_frequency=None)
        lines.append(
            "tip_offset = 0: the block's middle is over the beam's end; if the block is flush with "
            f"the end, set tip_offset = {flush.tip_offset:g}: the frequency is then "
            f"{lumped(flush).short_frequency:.4g} Hz with a rigid clamp"
        )
    for name, materials in ((beam.material, PASSIVE), (beam.piezo, ACTIVE)):
        lines.append(f"{name}: {materials[name].source}")
    limit, named = beam.limit
    lines.append(f"greatest strain of the layers: {limit:.3g}, {named}")
    if magnets is not None:
        lines += magnet_notes(magnets)
        coefficients, error = polynomial_fit(magnets, beam)
        listed = ", ".join(f"{coefficient:.5g}" for coefficient in coefficients)
        lines.append(
            f"as a polynomial of the seventh degree within ±{magnets.reach:g} m: "
            f"restoring_force = [{listed}], wrong by up to {error:.2g} N"
        )
    return lines


def draw(beam: Beam, magnets: Magnets | None = None) -> Figure:
    """Side view, first mode, and with magnets the spring."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0 if magnets is None else 7.0), layout="constrained")
    panels = figure.subplots(2 if magnets is None else 3, 1)
    _draw_side(panels[0], beam)
    lumped_values = lumped(beam)
    places, values = shape(pieces_of(beam), tip_of(beam), lumped_values.clamp_compliance)
    panels[1].plot(1e3 * places, values, color=LINE)
    frequency = lumped_values.short_frequency
    panels[1].set(
        xlabel="from the clamp [mm]", ylabel="φ/φ(L)", title=f"mode at {frequency:.4g} Hz"
    )
    if magnets is not None:
        x, force = np.array(spring_points(magnets, beam)).T
        panels[2].plot(1e3 * x, force, color=LINE)
        panels[2].axhline(0.0, color="0.7", linewidth=0.8)
        panels[2].set(xlabel="displacement of the tip [mm]", ylabel="force [N]", title="spring")
    return figure


def _draw_side(axes: Any, beam: Beam) -> None:
    """Side view of the beam; thicknesses are not to scale."""
    from matplotlib.patches import Rectangle

    half, height = 500.0 * beam.thickness, 1e3 * beam.piezo_thickness
    begin, end = (1e3 * edge for edge in beam.patch)
    length = 1e3 * beam.length

    def block(x, y, width, tall, colour, label=None):
        axes.add_patch(Rectangle((x, y), width, tall, facecolor=colour, label=label))

    block(0.0, -half, length, 2.0 * half, SUBSTRATE, beam.material)
    block(begin, half, end - begin, height, LAYER, beam.piezo)
    if beam.layers == 2:
        block(begin, -half - height, end - begin, height, LAYER)
    tip, reach = tip_of(beam), half + height
    if tip.mass:
        size = 1e3 * (beam.tip_length or 0.06 * beam.length)
        centre = length + 1e3 * beam.tip_offset
        block(centre - size / 2.0, reach, size, 2.0 * reach, TIP, f"tip, {1e3 * tip.mass:.3g} g")
    axes.axvline(0.0, color="black", linewidth=3.0)
    axes.set(xlim=(-0.03 * length, 1.15 * length), ylim=(-2.0 * reach, 4.0 * reach))
    axes.set(xlabel="from the clamp [mm]", ylabel="[mm], stretched", title="side view")
    # The legend is above the drawing, which fills its axes.
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
