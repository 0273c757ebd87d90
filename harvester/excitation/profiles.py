"""Spectra of published standards by name, each checked against the rms value printed in its source.

One-sided densities, straight between breakpoints on log–log axes, for components up to 22.7 kg.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from harvester.base.errors import SceneError
from harvester.base.plain_text import nearest, shown

_GEVS = "NASA GSFC-STD-7000A (GEVS, 22 April 2013), table 2.4-3"


class Profile(NamedTuple):
    """Frequency (Hz) and density (g²/Hz) of each breakpoint, rms as printed (g), and the source."""

    breakpoints: tuple[tuple[float, float], ...]
    rms: float
    source: str


PROFILES = {
    "gevs-qualification": Profile(
        ((20.0, 0.026), (50.0, 0.16), (800.0, 0.16), (2000.0, 0.026)),
        14.1,
        f"{_GEVS}, qualification",
    ),
    "gevs-acceptance": Profile(
        ((20.0, 0.013), (50.0, 0.08), (800.0, 0.08), (2000.0, 0.013)), 10.0, f"{_GEVS}, acceptance"
    ),
}


def write_out_profile(table: dict[str, Any], where: str) -> None:
    """Replace a profile's name in an excitation's table by the profile's values.

    Raises SceneError if there is no such profile, or the table also gives values.
    """
    if "profile" not in table or table.get("kind") != "spectrum":
        return
    name = table["profile"]
    profile = PROFILES.get(name) if isinstance(name, str) else None
    if profile is None:
        raise SceneError(
            f"{where}.profile = {shown(name)}: must be one of "
            f"{', '.join(PROFILES)}{nearest(name, PROFILES)}; for others set excitation.breakpoints"
        )
    values = {
        "unit": "g^2/Hz",
        "breakpoints": [list(point) for point in profile.breakpoints],
        "source": profile.source,
    }
    for key in values:
        if key in table:
            raise SceneError(f"{where}.{key}: the profile {name} sets it: remove one of them")
    del table["profile"]
    table |= values
