"""`[beam]`: a cantilever's drawing, and the lumped mass, spring and transducer computed from it.

Equations: A. Erturk and D. J. Inman, Smart Mater. Struct. 18, 025009 (2009), and
docs/explanation/beams.md.
"""

from __future__ import annotations

import functools
import math
from typing import ClassVar, NamedTuple

from harvester.base.errors import SceneError
from harvester.device.beam.materials import ACTIVE, PASSIVE, VACUUM_PERMITTIVITY, clamped
from harvester.device.beam.modes import Piece, Tip, clamp_compliance, modes, rest
from harvester.device.keys import SI, OneOf, Table, key, not_negative, positive, table, word

# Thickness over length above which a beam is rejected, and above which a note is given: shear,
# neglected here, lowers the frequency by 4 % at 0.2 (Timoshenko's first correction), 1 % at 0.1.
THICKEST, THICK = 0.2, 0.1
# Width over length above which a note is given: a plate is up to 1/(1 − ν²) = 10 % stiffer.
WIDE = 0.5
# A note is given if the variation of the field in a bent layer adds more than this share of the
# rigidity: 1 % of the frequency.
STIFFENED = 0.02
# A note is given if the scene's strain limit exceeds this multiple of the material's limit.
FAR_BEYOND = 10.0
# A patch shorter than SHORTEST_PATCH times its thickness is rejected, and below SHORT_PATCH times
# a note is given: the patch's ends do not follow the beam's strain.
SHORTEST_PATCH, SHORT_PATCH = 2.0, 10.0
# Tolerance (share) of the thickness of a layer that is sold in one thickness only.
PACKAGE = 0.1
# Limits of plausible measured values: the frequency is at least SOFTEST_CLAMP of the frequency with
# a rigid clamp; the ratio of the capacitances, measured and drawn, is at most OTHER_PERMITTIVITY,
# and at least its inverse.
SOFTEST_CLAMP, OTHER_PERMITTIVITY = 0.5, 3.0
GRAVITY = 9.81
# Share of the beam's length by which its tip may sag under its weight.
MOST_SAG = 0.5
# Usual sizes of parts, and the unit that is often mistaken for the key's.
LONG, THIN = (1e-7, 3.0, 1e-3, "mm"), (1e-9, 0.1, 1e-3, "mm")
MODULUS, DENSITY = (1e6, 2e12, 1e9, "GPa"), (10.0, 3e4, 1e3, "g/cm³")
PERMITTIVITY = (1.0, 1e5, 1.0 / VACUUM_PERMITTIVITY, "F/m")
STRAIN = (1e-7, 0.3, 1e-6, "ppm")
# Keys of Basquin's line: the life at the strain amplitude ε is N = cycles (strain/ε)^exponent.
FATIGUE = ("fatigue_strain", "fatigue_cycles", "fatigue_exponent")


@table
class Beam(Table):
    """A cantilever of a substrate with one or two piezoelectric layers and a tip mass, in SI."""

    length: float = positive(
        "length from the clamp", "m", required=True, likely=LONG, usual=(1e-4, 1.0)
    )
    width: float = positive("width", "m", required=True, likely=LONG, usual=(1e-5, 1.0))
    thickness: float = positive(
        "thickness of the substrate", "m", required=True, likely=THIN, usual=(1e-6, 0.02)
    )
    piezo_thickness: float = positive(
        "thickness of a piezo layer", "m", required=True, likely=THIN, usual=(1e-7, 0.01)
    )
    material: str = word("substrate", PASSIVE, default="brass", asked=True)
    modulus: float | None = positive("modulus of the substrate", "Pa", likely=MODULUS)
    density: float | None = positive("density of the substrate", "kg/m³", likely=DENSITY)
    piezo: str = word("piezo layers", ACTIVE, default="PZT-5A", asked=True)
    piezo_modulus: float | None = positive(
        "modulus of the layers: 1/s11 at constant field", "Pa", likely=MODULUS
    )
    piezo_density: float | None = positive("density of the layers", "kg/m³", likely=DENSITY)
    piezo_d31: float | None = key(
        "d31 of the layers: d33 with electrode_spacing", "m/V", likely=(1e-14, 1e-8, 1e-12, "pm/V")
    )
    piezo_permittivity: float | None = positive(
        "permittivity of the layers: relative, at constant strain", "1", likely=PERMITTIVITY
    )
    piezo_free_permittivity: float | None = positive(
        "free permittivity of the layers: relative, at constant stress", "1", likely=PERMITTIVITY
    )
    piezo_start: float = not_negative(
        "beginning of the patch: from the clamp", "m", likely=LONG, default=0.0
    )
    piezo_length: float | None = positive(
        "length of the patch: by default to the beam's end", "m", likely=LONG
    )
    electrode_spacing: float | None = positive(
        "spacing of electrode fingers: the field is then along the beam", "m", likely=THIN
    )
    layers: int = key("number of layers", kind=int, low=1, high=2, default=2)
    connection: str = word(
        "connection of two layers", ("series", "parallel"), default="series", asked=True
    )
    tip_mass: float = not_negative(
        "tip mass", "kg", likely=(1e-15, 10.0, 1e-3, "g"), usual=(0.0, 10.0), default=0.0
    )
    tip_inertia: float = not_negative(
        "inertia of the tip's body: about its own centre", "kg m²",
        likely=(1e-30, 1.0, 1e-9, "g mm²"), default=0.0,
    )  # fmt: skip
    tip_offset: float = key(
        "offset of the tip's centre: beyond the beam's end", "m", likely=LONG, default=0.0
    )
    tip_material: str | None = word("material of a block on the end", PASSIVE)
    tip_length: float | None = positive("length of the block", "m", likely=LONG)
    tip_height: float | None = positive("height of the block", "m", likely=LONG)
    tip_width: float | None = positive(
        "width of the block; default: the beam's width", "m", likely=LONG
    )
    damping_ratio: float | None = not_negative("damping ratio: ζ of the first mode", "1")
    quality_factor: float | None = positive("quality factor: Q = 1/(2ζ)", "1", usual=(1.0, 1e6))
    measured_frequency: float | None = positive(
        "measured frequency: short-circuited; the clamp is softened to agree", "Hz",
        likely=(1e-2, 1e7, 1e3, "kHz"),
    )  # fmt: skip
    measured_capacitance: float | None = positive(
        "measured capacitance: far below resonance; the permittivity is scaled to agree", "F",
        likely=(1e-15, 1e-3, 1e-9, "nF"),
    )  # fmt: skip
    strain_limit: float | None = positive(
        "strain limit; default: the limit of the layers' material", "1", likely=STRAIN
    )
    fatigue_strain: float | None = positive(
        "strain amplitude of a point on the Basquin (S-N) curve", "1", likely=STRAIN
    )
    fatigue_cycles: float | None = positive("cycles to failure at this amplitude", "1")
    fatigue_exponent: float | None = positive("exponent of the Basquin curve", "1")

    UNITS: ClassVar = (SI,)
    ALTERNATIVES: ClassVar = (
        OneOf(("damping_ratio", "quality_factor"), required=False),
        OneOf(("piezo_permittivity", "piezo_free_permittivity"), required=False),
    )

    @property
    def ratio(self) -> float:
        """Damping ratio ζ of the first mode."""
        if self.quality_factor is not None:
            return 0.5 / self.quality_factor
        return self.damping_ratio or 0.0

    @property
    def limit(self) -> tuple[float, str]:
        """Greatest strain of the layers, and its position along the beam."""
        named = ACTIVE[self.piezo]
        if self.strain_limit is None:
            return named.strain_limit, f"the limit of {self.piezo} ({named.limit_source})"
        return self.strain_limit, "beam.strain_limit"

    @property
    def fatigue_line(self) -> tuple[float, float, float] | None:
        """Strain, cycles and exponent of the Basquin curve, if given."""
        strain, cycles, exponent = (getattr(self, name) for name in FATIGUE)
        return None if strain is None else (strain, cycles, exponent)

    @property
    def patch(self) -> tuple[float, float]:
        """Beginning and end of the electrodes (m from the clamp)."""
        remaining = self.length - self.piezo_start
        length = remaining if self.piezo_length is None else self.piezo_length
        return self.piezo_start, self.piezo_start + length

    @property
    def substrate(self) -> tuple[float, float]:
        """Modulus and density of the substrate."""
        named = PASSIVE[self.material]
        return self.modulus or named.modulus, self.density or named.density

    @property
    def active(self) -> tuple[float, float, float, float]:
        """Modulus, density, d31 and relative permittivity at constant strain of the layers."""
        named = ACTIVE[self.piezo]
        modulus = self.piezo_modulus or named.modulus
        d31 = named.d31 if self.piezo_d31 is None else self.piezo_d31
        permittivity = self.piezo_permittivity or named.permittivity
        if self.piezo_free_permittivity is not None:
            permittivity = clamped(self.piezo_free_permittivity, d31, modulus)
        return modulus, self.piezo_density or named.density, d31, permittivity

    def default_values(self) -> dict[str, float]:
        """Values of omitted keys: the materials' values, and a patch that covers the beam."""
        names = "modulus", "density", "piezo_modulus", "piezo_density", "piezo_d31"
        values = dict(zip(names, (*self.substrate, *self.active[:3]), strict=True))
        return {**values, "piezo_length": self.patch[1] - self.patch[0]}


class LumpedBeam(NamedTuple):
    """Lumped values of a drawing at its tip (SI), electrodes short-circuited.

    Attributes
    ----------
    mass, stiffness, damping : M = 1/φ(L)², K = ω² M, C = 2 ζ ω M.
    base_factor
        μ = φ(L) γ.
    coupling
        θ = χ/φ(L).
    material_capacitance : Cp of the layers, with the beam free to stretch but not to bend.
    rest_capacitance, rest_charge
        Static contribution of the residual modes, Σ χr²/ωr² and
        Σ χr γr/ωr² over r > 1: a capacitance, and a charge per acceleration of the base.
    damping_ratio
        ζ
    tip_slope
        φ'(L)/φ(L), the tip's rotation per displacement (1/m).
    curvatures
        φ''/φ(L) at the beginning and the end of each piece (1/m²).
    clamp_compliance
        Rotation of the clamp per moment (rad/(N m)).
    permittivity_factor
        Factor by which a measured capacitance changes the layer's permittivity.
    """

    mass: float
    stiffness: float
    damping: float
    base_factor: float
    coupling: float
    material_capacitance: float
    rest_capacitance: float
    rest_charge: float
    damping_ratio: float
    tip_slope: float
    curvatures: tuple[tuple[float, float], ...]
    clamp_compliance: float
    permittivity_factor: float

    @property
    def capacitance(self) -> float:
        """Sum of the capacitances of the material and of the residual modes."""
        return self.material_capacitance + self.rest_capacitance

    @property
    def coupling_squared(self) -> float:
        """k² = θ²/(K Cp), with the capacitance Cp of the material."""
        return self.coupling**2 / (self.stiffness * self.material_capacitance)

    @property
    def short_frequency(self) -> float:
        """The short-circuit frequency √(K/M)/2π (Hz)."""
        return math.sqrt(self.stiffness / self.mass) / (2.0 * math.pi)

    @property
    def open_frequency(self) -> float:
        """The open-circuit frequency (Hz), √((K + θ²/C)/M)/2π. C includes the residual modes."""
        stiffness = self.stiffness + self.coupling**2 / self.capacitance
        return math.sqrt(stiffness / self.mass) / (2.0 * math.pi)

    @property
    def one_mode_open_frequency(self) -> float:
        """Open-circuit frequency (Hz) with Cp alone, as in published one-mode models."""
        return self.short_frequency * math.sqrt(1.0 + self.coupling_squared)


class Section(NamedTuple):
    """A cross-section about its neutral axis.

    Attributes
    ----------
    rigidity, mass : EI (N m²), and mass per length (kg/m).
    moment_per_volt : N m/V, of all layers.
    stretch_per_volt : strain of the neutral axis (1/V): a single layer also stretches the beam,
        while the forces of two layers cancel.
    axial_capacitance
        Charge by this stretch per volt and metre (F/m).
    axis
        Height of the neutral axis above the substrate's middle (m).
    """

    rigidity: float
    mass: float
    moment_per_volt: float
    stretch_per_volt: float
    axial_capacitance: float
    axis: float


def section(beam: Beam, covered: bool) -> Section:
    """The section of the beam about its neutral axis, with or without active layers."""
    modulus, density = beam.substrate
    half, height = beam.thickness / 2.0, beam.piezo_thickness
    stack = [(-half, half, modulus, density)]
    force = 0.0
    if covered:
        active, active_density, d31, _ = beam.active
        stack.append((half, half + height, active, active_density))
        if beam.layers == 2:
            stack.append((-half - height, -half, active, active_density))
        # Axial force of a layer, e31 b (N/V); the field is V/h_p, or V/spacing.
        field = 1.0 if beam.electrode_spacing is None else height / beam.electrode_spacing
        force = abs(d31) * active * beam.width * field
    stretch = sum(e * (top - low) for low, top, e, _ in stack)
    axis = sum(e * (top**2 - low**2) / 2.0 for low, top, e, _ in stack) / stretch
    rigidity = sum(e * ((top - axis) ** 3 - (low - axis) ** 3) / 3.0 for low, top, e, _ in stack)
    mass = sum(rho * (top - low) for low, top, _, rho in stack)
    number = 2.0 if beam.layers == 2 and beam.connection == "parallel" else 1.0
    moment = force * (half + height / 2.0 - axis) * number
    strain = force / (beam.width * stretch) if beam.layers == 1 else 0.0
    sizes = beam.width * rigidity, beam.width * mass
    return Section(*sizes, moment, strain, force * strain, axis)


def spans(beam: Beam) -> list[tuple[float, float, bool]]:
    """Beginning and end of each uniform piece (m), and whether the layers cover it."""
    begin, end = beam.patch
    every = ((0.0, begin, False), (begin, end, True), (end, beam.length, False))
    return [span for span in every if span[1] - span[0] > 1e-9 * beam.length]


def pieces_of(beam: Beam) -> list[Piece]:
    """The pieces from the clamp to the tip: bare, covered, bare."""
    return [Piece(top - low, *section(beam, covered)[:3]) for low, top, covered in spans(beam)]


def tip_of(beam: Beam) -> Tip:
    """The body at the tip, from its given values or as a block on the beam's end."""
    mass, inertia = beam.tip_mass, beam.tip_inertia
    if beam.tip_material is not None:
        length, height = beam.tip_length or 0.0, beam.tip_height or 0.0
        density = PASSIVE[beam.tip_material].density
        mass = density * length * height * (beam.tip_width or beam.width)
        rise = (height + beam.thickness) / 2.0
        inertia = mass * ((length**2 + height**2) / 12.0 + rise**2)
    return Tip(mass, beam.tip_offset, inertia + mass * beam.tip_offset**2)


def layer_capacitance(beam: Beam) -> float:
    """Capacitance of the connected layers at constant strain."""
    _, _, _, permittivity = beam.active
    begin, end = beam.patch
    one = permittivity * VACUUM_PERMITTIVITY * beam.width * (end - begin)
    if beam.electrode_spacing is None:
        one /= beam.piezo_thickness
    else:
        # Each pair of fingers forms a capacitor; all of them are in parallel.
        one *= beam.piezo_thickness / beam.electrode_spacing**2
    if beam.layers == 1:
        return one
    return one * (2.0 if beam.connection == "parallel" else 0.5)


@functools.lru_cache(maxsize=256)
def lumped(beam: Beam, origin: str = "beam") -> LumpedBeam:
    """Lumped values of the first mode at the tip; higher modes count statically.

    Raises SceneError if the beam is not a slender cantilever, or cannot have the measured values.
    """
    _check(beam, origin)
    pieces, tip = pieces_of(beam), tip_of(beam)
    compliance = 0.0
    if beam.measured_frequency is not None:
        compliance = _calibrated_clamp(beam, pieces, tip, origin)
    first = modes(pieces, tip, 1, compliance)[0]
    every = rest(pieces, tip)
    omega, mass = first.angular_frequency, 1.0 / first.tip**2
    if GRAVITY / omega**2 > MOST_SAG * beam.length:
        raise SceneError(
            f"{origin}: beam: at its {omega / (2.0 * math.pi):.3g} Hz the tip sags by "
            f"{GRAVITY / omega**2:.3g} m under its weight, more than {MOST_SAG:g} of the beam's "
            "length: check the units of sizes (m), masses (kg) and moduli (Pa)"
        )
    first_capacitance = (first.coupling / omega) ** 2
    capacitance, (begin, end) = layer_capacitance(beam), beam.patch
    stretch = section(beam, True).axial_capacitance * (end - begin)
    factor = 1.0
    if beam.measured_capacitance is not None:
        strained = every.capacitance + stretch
        factor = (beam.measured_capacitance - strained) / capacitance
        if factor <= 0.0:
            raise SceneError(
                f"{origin}: beam.measured_capacitance = {beam.measured_capacitance:.4g}: must be "
                f"greater than the {strained:.4g} F that the free beam's strain alone adds at low "
                "frequency"
            )
        if not 1.0 / OTHER_PERMITTIVITY <= factor <= OTHER_PERMITTIVITY:
            raise SceneError(
                f"{origin}: beam.measured_capacitance = {beam.measured_capacitance:g}: must be of "
                f"the order of the drawing's {capacitance + strained:.3g} F: check the unit (F), "
                "piezo_thickness and connection"
            )
    return LumpedBeam(
        mass=mass,
        stiffness=omega**2 * mass,
        damping=2.0 * beam.ratio * omega * mass,
        base_factor=first.tip * first.forcing,
        coupling=first.coupling / first.tip,
        material_capacitance=capacitance * factor + stretch,
        rest_capacitance=every.capacitance - first_capacitance,
        rest_charge=every.charge - first.coupling * first.forcing / omega**2,
        damping_ratio=beam.ratio,
        tip_slope=first.tip_slope / first.tip,
        curvatures=tuple((a / first.tip, b / first.tip) for a, b in first.curvatures),
        clamp_compliance=compliance,
        permittivity_factor=factor,
    )  # fmt: skip


def frequencies(beam: Beam) -> list[float]:
    """The first three short-circuit frequencies (Hz)."""
    compliance = lumped(beam).clamp_compliance
    lowest = modes(pieces_of(beam), tip_of(beam), 3, compliance)
    return [mode.angular_frequency / (2.0 * math.pi) for mode in lowest]


def _calibrated_clamp(beam, pieces, tip, origin):
    """Compliance of the clamp that gives the measured first short-circuit frequency."""
    rigid = modes(pieces, tip)[0].angular_frequency
    measured = 2.0 * math.pi * beam.measured_frequency
    if measured > rigid:
        raise SceneError(
            f"{origin}: beam.measured_frequency = {beam.measured_frequency:g}: must be at most the "
            f"{rigid / (2.0 * math.pi):.4g} Hz of a rigid clamp, since a clamp only softens: "
            "check thickness, modulus and tip mass"
        )
    if measured < SOFTEST_CLAMP * rigid:
        raise SceneError(
            f"{origin}: beam.measured_frequency = {beam.measured_frequency:g}: must be at least "
            f"{SOFTEST_CLAMP:g} of the {rigid / (2.0 * math.pi):.4g} Hz of a rigid clamp: below, "
            "the clamp would be softer than the beam: check the unit (Hz) and the drawing"
        )
    return clamp_compliance(pieces, tip, measured)


def notes(beam: Beam) -> list[str]:
    """Notes on the dimensions for which the theory of slender beams is only approximate."""
    remarks = []
    thickness = beam.thickness + beam.layers * beam.piezo_thickness
    if thickness > THICK * beam.length:
        remarks.append(
            f"thickness/length = {thickness / beam.length:.2g} > {THICK}: shear, neglected here, "
            "lowers the frequency by some per cents"
        )
    if beam.width > WIDE * beam.length:
        remarks.append(
            f"width/length = {beam.width / beam.length:.2g} > {WIDE}: the beam resembles a plate, "
            "whose stiffness is greater by up to 1/(1 − ν²), some 10 %"
        )
    begin, end = beam.patch
    if end - begin < SHORT_PATCH * beam.piezo_thickness:
        remarks.append(
            f"the patch is {(end - begin) / beam.piezo_thickness:.2g} thicknesses long, < "
            f"{SHORT_PATCH:g}: its ends do not follow the beam, so the coupling is weaker"
        )
    modulus, _, d31, permittivity = beam.active
    field = (modulus * d31) ** 2 / (permittivity * VACUUM_PERMITTIVITY)
    share = beam.layers * field * beam.width * beam.piezo_thickness**3 / 12.0
    share /= section(beam, True).rigidity
    if beam.electrode_spacing is None and share > STIFFENED:
        remarks.append(
            f"the field in a layer is assumed uniform; it varies with the strain, so the covered "
            f"beam is {share:.1%} stiffer; its frequency is up to {share / 2.0:.1%} higher, and k² "
            "{share:.1%} lower: if this matters, identify the lumped values"
        )
    limit, usual = beam.strain_limit or 0.0, ACTIVE[beam.piezo].strain_limit
    if limit > FAR_BEYOND * usual:
        remarks.append(
            f"strain_limit = {limit:g} is over {FAR_BEYOND:g} times the {usual:.3g} of "
            f"{beam.piezo}: {limit:g} % would be {0.01 * limit:g}"
        )
    if beam.ratio == 0.0:
        remarks.append("no damping_ratio or quality_factor is given: ζ = 0")
    return remarks


def _check(beam, origin):
    """Raise if the beam is not slender, or values are given twice or incompletely."""
    begin, end = beam.patch
    thickness = beam.thickness + beam.layers * beam.piezo_thickness
    if not begin < end <= beam.length * (1.0 + 1e-9):
        raise SceneError(
            f"{origin}: beam.piezo_start and piezo_length put the patch at {begin:g} to "
            f"{end:g} m: it must lie within the beam's {beam.length:g} m"
        )
    if thickness > THICKEST * beam.length:
        raise SceneError(
            f"{origin}: beam: thickness/length = {thickness / beam.length:.2g}: a slender beam "
            f"(Euler–Bernoulli) has at most {THICKEST}; check the units (m)"
        )
    if end - begin < SHORTEST_PATCH * beam.piezo_thickness:
        raise SceneError(
            f"{origin}: beam.piezo_length = {end - begin:g}: must be at least {SHORTEST_PATCH:g} "
            "times piezo_thickness"
        )
    sold = ACTIVE[beam.piezo].thickness
    if sold is not None and abs(beam.piezo_thickness / sold - 1.0) > PACKAGE:
        raise SceneError(
            f"{origin}: beam.piezo_thickness = {beam.piezo_thickness:g}: {beam.piezo} is sold "
            f"{sold:g} m thick; set this thickness, for which its values are valid"
        )
    keys = [name for name in FATIGUE if getattr(beam, name) is not None]
    if 0 < len(keys) < len(FATIGUE):
        missing = ", ".join(f"beam.{name}" for name in FATIGUE if name not in keys)
        raise SceneError(
            f"{origin}: beam.{keys[0]} is one of three values of Basquin's line: also give "
            f"{missing}"
        )
    if beam.active[3] <= 0.0:
        raise SceneError(
            f"{origin}: beam: d31² times the modulus exceeds the free permittivity: check "
            "piezo_d31, piezo_modulus and piezo_free_permittivity"
        )
    sizes = ("tip_length", "tip_height", "tip_width")
    keys = [name for name in sizes if getattr(beam, name) is not None]
    if keys and beam.tip_material is None:
        raise SceneError(
            f"{origin}: beam.{keys[0]} needs beam.tip_material; a block of known mass has "
            "beam.tip_mass, tip_inertia and tip_offset instead of sizes"
        )
    if beam.tip_material is None:
        return
    if not {"tip_length", "tip_height"} <= {*keys}:
        raise SceneError(f"{origin}: beam.tip_material needs beam.tip_length and beam.tip_height")
    if (beam.tip_length or 0.0) > beam.length:
        raise SceneError(
            f"{origin}: beam.tip_length = {beam.tip_length:g}: a block longer than the beam's "
            f"{beam.length:g} m: check the unit (m), or give tip_mass, tip_inertia and tip_offset"
        )
    if beam.tip_mass or beam.tip_inertia:
        raise SceneError(
            f"{origin}: beam.tip_mass and beam.tip_material exclude each other: keep one"
        )
