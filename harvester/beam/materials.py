"""Materials by name, each with the source of its values.

Values of a batch differ from these by several per cents: a scene may give its own.
"""

from __future__ import annotations

from typing import NamedTuple

VACUUM_PERMITTIVITY = 8.8541878128e-12
_BOOK = "Erturk and Inman, Piezoelectric Energy Harvesting (Wiley 2011), appendix E"
_PAPER = "Erturk and Inman, Smart Mater. Struct. 18, 025009 (2009), table 1"
_PROCEEDINGS = "Erturk and Inman, Proc. IMechE I 225, 485 (2011), table 2"
_TYPICAL = "typical value of handbooks; that of a batch differs by some per cents"


class Material(NamedTuple):
    """What a layer without electrodes is made of: Pa, kg/m³."""

    modulus: float
    density: float
    source: str


class Piezoceramic(NamedTuple):
    """What an active layer is made of.

    Attributes
    ----------
    modulus : 1/s11 at constant field (Pa).
    density : kg/m³
    d31 : m/V; of layers with the field along the beam d33 in its place.
    permittivity : over that of vacuum, at constant strain along the beam.
    source : where the values stand.
    """

    modulus: float
    density: float
    d31: float
    permittivity: float
    source: str


def clamped(free: float, d31: float, modulus: float) -> float:
    """Relative permittivity at constant strain of that at constant stress, ε_T − d31² c11."""
    return free - d31**2 * modulus / VACUUM_PERMITTIVITY


def _ceramic(s11, density, d31, free, source):
    """A ceramic of its data sheet's compliance and free permittivity."""
    return Piezoceramic(1.0 / s11, density, d31, clamped(free, d31, 1.0 / s11), source)


PASSIVE = {
    "brass": Material(105e9, 9000.0, f"{_PAPER}: the shim of a bimorph"),
    "steel": Material(200e9, 7850.0, _TYPICAL),
    "stainless steel": Material(193e9, 8000.0, _TYPICAL),
    "aluminium": Material(70e9, 2700.0, _TYPICAL),
    "copper": Material(117e9, 8930.0, _TYPICAL),
    "FR4": Material(22e9, 1850.0, f"{_TYPICAL}, lengthwise"),
    "PET": Material(3.5e9, 1380.0, _TYPICAL),
}
ACTIVE = {
    "PZT-5A": _ceramic(16.4e-12, 7750.0, -171e-12, 1700.0, _BOOK),
    "PZT-5H": _ceramic(16.5e-12, 7500.0, -274e-12, 3400.0, _BOOK),
    "PSI-5A4E": Piezoceramic(66e9, 7800.0, -190e-12, 1500.0, _PAPER),
    "PSI-5H4E": Piezoceramic(
        60.6e9, 7500.0, -16.6 / 60.6e9, 25.55e-9 / VACUUM_PERMITTIVITY, _PROCEEDINGS
    ),
    "PVDF": Piezoceramic(
        3e9, 1780.0, 23e-12, clamped(12.0, 23e-12, 3e9), "TE Connectivity, Piezo Film Sensors "
        "Technical Manual, table 1: modulus 2 to 4 GPa, its middle here"
    ),
}  # fmt: skip
