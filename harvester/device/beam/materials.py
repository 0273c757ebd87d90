"""Materials by name, each with its source.

The values of a batch may differ by several percent: a scene can give its own.
"""

from __future__ import annotations

from typing import NamedTuple

VACUUM_PERMITTIVITY = 8.8541878128e-12
_BOOK = (
    "Erturk and Inman, Piezoelectric Energy Harvesting (Wiley 2011), appendix E, p. 373, table E.1"
)
_PAPER = "Erturk and Inman, Smart Mater. Struct. 18, 025009 (2009), table 1"
_PROCEEDINGS = "Erturk and Inman, Proc. IMechE I 225, 485 (2011), table 2"
_APC = (
    "APC International, Physical and Piezoelectric Properties of APC Materials (rev. 3, 2017), p. 1"
)
# Dynamic tensile strength (Pa) of ceramics, 4000 psi for PZT-5A and PZT-5H.
_DYNAMIC_STRENGTH = 27.6e6
_STRENGTH = (
    "Berlincourt, Krueger and Near, Properties of Piezoelectricity Ceramics, TP-226 (Morgan "
    "Electro Ceramics): rated dynamic tensile strength of PZT-5A and PZT-5H, 27.6 MPa"
)
_FILM = "Measurement Specialties, Piezo Film Sensors Technical Manual, p. 3, table 1"
_MFC = (
    "Smart Material, MFC Engineering Properties (smart-material.com/MFC-product-propertiesV2.html)"
)


class Material(NamedTuple):
    """A passive material: modulus (Pa) and density (kg/m³)."""

    modulus: float
    density: float
    source: str


class Piezoceramic(NamedTuple):
    """The material of an active layer.

    Attributes
    ----------
    modulus
        1/s11 at constant field (Pa).
    density
        kg/m³
    d31
        m/V; for layers with the field along the beam it is d33.
    permittivity
        Relative to vacuum, at constant strain along the beam.
    source
        Source of the values.
    strain_limit, limit_source
        Greatest permissible strain in vibration, and its source.
    thickness
        Thickness (m) of a packaged layer, for which the values hold.
    """

    modulus: float
    density: float
    d31: float
    permittivity: float
    source: str
    strain_limit: float
    limit_source: str
    thickness: float | None = None


def clamped(free: float, d31: float, modulus: float) -> float:
    """Relative permittivity at constant strain, ε_T − d31² c11, from that at constant stress."""
    return free - d31**2 * modulus / VACUUM_PERMITTIVITY


def _ceramic(modulus, density, d31, free, source):
    """A ceramic from its data sheet's modulus and free permittivity."""
    permittivity = clamped(free, d31, modulus)
    return Piezoceramic(
        modulus, density, d31, permittivity, source, _DYNAMIC_STRENGTH / modulus, _STRENGTH
    )


def _macro_fibre(strain_per_volt, farad_per_area, thickness, source):
    """A fibre-epoxy layer, taken as uniform, from its data sheet's free strain and capacitance."""
    modulus, density = 30.336e9, 5440.0
    d31 = -strain_per_volt * thickness
    free = farad_per_area * thickness / VACUUM_PERMITTIVITY
    return Piezoceramic(
        modulus, density, d31, clamped(free, d31, modulus), source, 6e-4,
        f"{_MFC}: recommended tensile strain for energy harvesting", thickness,
    )  # fmt: skip


PASSIVE = {
    "brass": Material(105e9, 9000.0, f"{_PAPER}: the shim of its bimorph"),
    "brass C26000": Material(112e9, 8530.0, "Olin Brass, C26000 (ASTM B36) Cartridge Brass, Alloy "
        "Data Specifications, physical properties"),
    "steel": Material(200e9, 7870.0, "mem50212.com, Materials: ferrous metals, CS1020 (AS 1442)"),
    "stainless steel": Material(193e9, 8000.0, "APAC Infrastructure, Material Specifications: 304 "
        "Stainless Steel"),
    "aluminium": Material(68.9e9, 2700.0, "Glemco, Aluminum 6061-T6 Material Information, typical "
        "values of the Aluminum Association"),
    "copper": Material(117e9, 8940.0, "Lion Metal, C11000 Copper Alloy Technical Data Sheet, "
        "version 2.0 (2025), physical properties"),
    "FR4": Material(24.3e9, 1800.0, "Hirosugi-Keiki, Glass epoxy FR4, bending modulus lengthwise "
        "(ASTM D790) and specific gravity (D792)"),
    "PET": Material(4.805e9, 1390.0, "DuPont Teijin Films, Mylar polyester film: Physical-Thermal "
        "Properties (H-37232-3), table 1: 490 kg/mm² in machine direction"),
}  # fmt: skip
ACTIVE = {
    "PZT-5A": _ceramic(1.0 / 16.4e-12, 7750.0, -171e-12, 1700.0, _BOOK),
    "PZT-5H": _ceramic(1.0 / 16.5e-12, 7500.0, -274e-12, 3400.0, _BOOK),
    "APC 850": _ceramic(63e9, 7600.0, -175e-12, 1900.0, _APC),
    "APC 855": _ceramic(59e9, 7600.0, -276e-12, 3300.0, _APC),
    "PSI-5A4E": Piezoceramic(66e9, 7800.0, -190e-12, 1500.0, f"{_PAPER}; modulus, d31 and density "
        "as in Piezo Systems, Piezoceramic Materials and Properties, p. 1 (permittivity there: "
        "1800 free, 1531 at constant strain)", _DYNAMIC_STRENGTH / 66e9, _STRENGTH),
    "PSI-5H4E": Piezoceramic(
        60.6e9, 7500.0, -16.6 / 60.6e9, 25.55e-9 / VACUUM_PERMITTIVITY, f"{_PROCEEDINGS}, which "
        "are values of PZT-5H; the maker's data sheet, Piezo Systems, Piezoceramic Materials and "
        "Properties, p. 1, has 62 GPa, 7800 kg/m³, −320 pm/V, 3800 free",
        _DYNAMIC_STRENGTH / 60.6e9, _STRENGTH),
    "PVDF": _ceramic(3e9, 1780.0, 23e-12, 12.5, f"{_FILM}: modulus 2 to 4 GPa, permittivity 12 to "
        "13, the middles here")._replace(
            strain_limit=0.015, limit_source=f"{_FILM}: yield strength 45 to 55 MPa, over 3 GPa"),
    "MFC-P2": _macro_fibre(1.1e-6, 7.8e-5, 0.3e-3, f"{_MFC}: modulus, 1.1 ppm/V, 7.8 nF/cm²; "
        "Smart Material, FAQ: 5.44 g/cm³, 0.16 g/cm² and so 0.3 mm. Assumed here: fibres and "
        "epoxy as one uniform layer"),
}  # fmt: skip
