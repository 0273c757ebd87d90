"""Quantities of measured columns and their units, also from a column's heading."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from typing import NamedTuple

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest

SAMPLES = "samples"
# Factors to SI by the unit's usual spelling; `unit_named` converts other spellings.
ACCELERATION = {
    "m/s^2": 1.0,
    "cm/s^2": 1e-2,
    "gal": 1e-2,
    "mm/s^2": 1e-3,
    "g": 9.80665,
    "mg": 9.80665e-3,
    "ug": 9.80665e-6,
    "ft/s^2": 0.3048,
    "in/s^2": 0.0254,
}
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
QUANTITIES: dict[str, dict[str, float]] = {
    # A column of sample numbers needs a sampling rate and has no factor.
    "time": TIME | {SAMPLES: 0.0},
    "acceleration": ACCELERATION,
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    # Volts are the output of a laser vibrometer, with an unknown or a given scale.
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "in/s": 0.0254, "V": 1.0, "mV": 1e-3},
    "frequency": {"Hz": 1.0, "kHz": 1e3, "rad/s": 0.5 / math.pi},
    "phase": {"rad": 1.0, "deg": math.pi / 180.0},
}
# Quantities of tables of points, which do not occur in records.
POINTS: dict[str, dict[str, float]] = {
    "force": {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "kN": 1e3, "lbf": 4.4482216152605},
    "density": {
        f"({unit})^2/Hz" if "/" in unit else f"{unit}^2/Hz": factor**2
        for unit, factor in ACCELERATION.items()
    },
}
RESPONSE = {
    f"{volts}/{bracketed}": volt / factor
    for volts, volt in QUANTITIES["voltage"].items()
    for unit, factor in ACCELERATION.items()
    for bracketed in (f"({unit})" if "/" in unit else unit,)
}
QUANTITIES |= dict.fromkeys(("amplitude", "real", "imaginary", "response"), RESPONSE)
# Quantities that an impedance analyser measures.
IMPEDANCES = ("impedance", "resistance", "reactance")
QUANTITIES |= {name: {"ohm": 1.0, "kohm": 1e3, "Mohm": 1e6} for name in IMPEDANCES}
QUANTITIES |= POINTS
# Quantities that a column of complex numbers may contain.
COMPLEX_QUANTITIES = ("response", "impedance")

OHM_WORDS = {"ohm": "ohms ω", "kohm": "kohms kω", "Mohm": "megohm megohms mω"}
# Other spellings of units, such as "volts" for V, in lower case without blanks.
WORDS: dict[str, dict[str, str]] = {
    "time": {
        "s": "sec secs second seconds",
        "ms": "msec msecs millis millisec millisecond milliseconds",
        "us": "usec usecs micros microsec microsecond microseconds",
        "ns": "nsec nanos nanosecond nanoseconds",
        "min": "mins minute minutes",
        "h": "hr hrs hour hours",
        SAMPLES: "sample # index idx row point record samplenumber sampleno sampleindex sample#",
    },
    "acceleration": {
        "g": "gn g0 gee gs g's",
        "mg": "milli-g millig mgn",
        "ug": "micro-g microg",
        "gal": "gals",
    },
    "voltage": {"V": "volt volts", "mV": "millivolt millivolts", "uV": "microvolt microvolts"},
    "displacement": {"m": "meter meters metre metres", "um": "micron microns"},
    "phase": {"deg": "degree degrees °", "rad": "radian radians"},
    "force": {"N": "newton newtons", "lbf": "lb lbs"},
    "density": {
        "(m/s^2)^2/Hz": "(m/s2)^2/hz m^2/s^4/hz m2/s4/hz m^2/s^3 m^2s^-3 m2/s3",
        "g^2/Hz": "g2/hz g**2/hz gn^2/hz grms^2/hz g^2hz^-1",
        "mg^2/Hz": "mg2/hz mgn^2/hz",
    },
    **dict.fromkeys(IMPEDANCES, OHM_WORDS),
}
LENGTHS = ("m", "cm", "mm", "ft", "in")
# Spellings of "per second squared" and "per second" after a length, the usual spelling first.
PER_TIME = {
    "acceleration": "/s^2 /s2 /s/s /(s^2) /sec^2 /sec2 /sec/sec s^-2 s-2 s^(-2) /s**2 "
    "_s2 _s^2 _s-2 s2 ps2 ps^2 pers2 _per_s2 _per_s^2",
    "velocity": "/s /sec s^-1 s-1 _s ps",
}
# Ambiguous units are rejected with a message that names both meanings.
MEGA_OR_MILLI = "megaohms (Mohm) or milliohms (1e-3 ohm)"
AMBIGUOUS = {
    "time": {"m": "minutes (min) or milliseconds (ms)"},
    "voltage": {"MV": "millivolts (mV) or megavolts (1e3 kV)"},
    "force": {"MN": "millinewtons (mN) or meganewtons (1e3 kN)"},
    **dict.fromkeys(
        IMPEDANCES, dict.fromkeys(("mohm", "mohms", "mOhm", "mΩ", "mΩ"), MEGA_OR_MILLI)
    ),
}


def _spellings(quantity: str) -> dict[str, str]:
    """Usual spellings of a quantity's units, by all spellings in lower case."""
    spellings = {unit.lower(): unit for unit in QUANTITIES[quantity]}
    for unit, words in WORDS.get(quantity, {}).items():
        spellings |= dict.fromkeys(words.split(), unit)
    usual, *variants = PER_TIME.get(quantity, "none").split()
    for length in LENGTHS:
        if f"{length}{usual}" in QUANTITIES[quantity]:
            spellings |= dict.fromkeys((f"{length}{end}" for end in variants), f"{length}{usual}")
    return spellings


SPELLINGS = {quantity: _spellings(quantity) for quantity in QUANTITIES}
SIGNS = str.maketrans(
    {"²": "^2", "³": "^3", "⁴": "^4", "⁻": "^-", "¹": "1", "µ": "u", "μ": "u", "·": "", "⋅": ""}
)


def unit_named(quantity: str, text: str) -> str | None:
    """Usual spelling of a quantity's unit; None if the text is not such a unit.

    Examples
    --------
    >>> unit_named("acceleration", "m s⁻²"), unit_named("time", "µsec"), unit_named("time", "V")
    ('m/s^2', 'us', None)
    """
    plain = "".join(text.translate(SIGNS).split()).replace("^-^2", "^-2")
    if plain in QUANTITIES[quantity] or plain in AMBIGUOUS.get(quantity, ()):
        return plain if plain in QUANTITIES[quantity] else None
    return SPELLINGS[quantity].get(plain.lower())


def usual_unit(quantity: str, unit: str, where: str, cure: str) -> str:
    """Usual spelling of a unit of a quantity in `QUANTITIES`.

    `where`, `cure`: file and column, and remedy, for messages. Raises SceneError if the quantity
    has no such unit, or the unit is ambiguous.
    """
    usual = unit_named(quantity, unit)
    if usual is None:
        both = AMBIGUOUS.get(quantity, {}).get(unit.strip())
        units = QUANTITIES[quantity]
        raise SceneError(
            f"{where}: {named(unit)} is ambiguous: {both}? {cure}"
            if both
            else f"{where}: unknown unit {named(unit)}{nearest(unit, units)}; units of {quantity} "
            f"are {', '.join(units)}: {cure}"
        )
    return usual


class Heading(NamedTuple):
    """Title, unit and quantity in a column's name.

    Attributes
    ----------
    title
        The name without its unit.
    Unit in the file's spelling; empty if there is none.
        Unit as it is written; empty if there is none.
    quantity
        A name in `QUANTITIES`; empty if the title names none.
    """

    title: str
    unit: str
    quantity: str


TITLES = {
    "time": re.compile(
        r"(elapsed |relative |rel )?time( ?stamps?)?|t|timestamps?|elapsed|x value|"
        r"date( ?time)?|date and time|clock|zeit"
    ),
    "acceleration": re.compile(
        r"((base|ground|table|shaker|input|linear|vertical|horizontal|[xyz]( axis)?) )?"
        r"(acceleration|accel|acc|accelerometer|beschleunigung)( ?[xyz123]( axis)?)?"
    ),
    "voltage": re.compile(r"voltage"),
    "displacement": re.compile(r"displacement"),
    "velocity": re.compile(r"velocity"),
    "frequency": re.compile(r"freq(uency)?|f"),
    "amplitude": re.compile(r"(voltage )?amplitude"),
    "phase": re.compile(r"(voltage |impedance |z )?phase( angle)?( z)?"),
    "force": re.compile(r"(restoring |spring )?force"),
    "density": re.compile(
        r"(acceleration )?(psd|asd|((power |acceleration )?spectral )?density)( level)?"
    ),
    "real": re.compile(r"re(al)?( part)?"),
    "imaginary": re.compile(r"im(ag(inary)?)?( part)?"),
    "response": re.compile(r"(frequency )?response( function)?|frf|transfer function"),
    "impedance": re.compile(
        r"(complex )?impedance( (magnitude|modulus|z))?|\|z\||z (abs|mag(nitude)?)|(abs|mag) z"
    ),
    "resistance": re.compile(r"(series )?resistance|(z re(al)?|re(al)? z)( part)?|z'"),
    "reactance": re.compile(r"(series )?reactance|(z im(ag(inary)?)?|im(ag(inary)?)? z)|z''|z\""),
}
# Letters that name a quantity only if a unit of it follows.
LETTERS = {
    "acceleration": re.compile(r"a( ?[xyz])?|ag|[xyz]|[xyz] axis"),
    "impedance": re.compile(r"z|mag(nitude)?|modulus"),
    "resistance": re.compile(r"rs?"),
    "reactance": re.compile(r"xs?"),
}
# A name followed by a text in brackets.
BRACKET = re.compile(r"(.*?)(?:\[([^\[\]]*)\]|\{([^{}]*)\}|\(((?:[^()]|\([^()]*\))*)\))\s*")
# A text in brackets after a name that denotes a position or a channel.
LABEL = re.compile(
    r"[xyznew]|[+-]?[xyz][ -]?axis|[+-]?\d+([ ,;:]+\d+)*|"
    r"north|east|south|west|up|down|vertical|horizontal|"
    r"(ch|chan|channel|sensor|node|station)[ ._#-]*\w*|base|table|ground|shaker|mass|tip",
    re.IGNORECASE,
)
LEVEL = re.compile(r"(?i)db\b.*|.*(√|sqrt|rt|/)\W*hz\W*(\^?(0\.5|1/2))?")
SEPARATOR = re.compile(r"\s+in\s+|[\s_,:/-]+")


def heading(text: str, expected: str = "") -> Heading:
    """Title, unit and quantity of a column's name.

    `expected`: quantity of the column if its title names none; empty: any.

    Examples
    --------
    >>> heading("Acceleration (m/s²)")
    Heading(title='Acceleration', unit='m/s²', quantity='acceleration')
    >>> heading("t_ms")
    Heading(title='t', unit='ms', quantity='time')
    >>> heading("F_mN", "force")
    Heading(title='F', unit='mN', quantity='force')
    """
    text = text.strip()
    title, within = _bracketed(text)
    if within is not None and not LABEL.fullmatch(within):
        return Heading(title, within, expected or quantity_of(title, within))
    quantity = quantity_of(text, "")
    if quantity and not expected:
        return Heading(text, SAMPLES if unit_named("time", text) == SAMPLES else "", quantity)
    for mark in SEPARATOR.finditer(text):
        title, unit = text[: mark.start()], text[mark.end() :]
        quantity = expected or quantity_of(title, unit)
        # Names of spectral levels that are not known units are kept here and rejected later.
        if quantity and (unit_named(quantity, unit) or (expected and LEVEL.fullmatch(unit))):
            return Heading(title, unit, quantity)
    for quantity in (expected,) if expected else ("time", "acceleration"):
        # A column may be named by its unit alone, such as "ms", "samples" or "m/s^2".
        unit_alone = unit_named(quantity, text)
        if unit_alone and unit_alone not in ("min", "h"):
            return Heading(text, text, quantity)
    return Heading(text, "", expected)


def _bracketed(text):
    """Text before a final bracket, and text in it (None without a bracket)."""
    match = BRACKET.fullmatch(text.strip())
    return (match[1].strip(), match[match.lastindex or 0].strip()) if match else (text, None)


def quantity_of(title: str, unit: str) -> str:
    """The quantity that a title names; empty if it names none.

    Letters such as "a" name an acceleration only with an acceleration's unit.
    """
    # A position or a channel in brackets after the title is ignored.
    before, within = _bracketed(title)
    bare = before if LABEL.fullmatch(within or "") else title
    # The names of groups and structures may precede the quantity: "data.time", "run
    # 1/acceleration".
    for name in (bare, re.split(r"[./](?=\w)", bare)[-1]):
        words = " ".join(re.sub(r"[_.-]", " ", name).lower().split())
        for quantity, titles in TITLES.items():
            if titles.fullmatch(words):
                return quantity
        for quantity, letters in LETTERS.items():
            if letters.fullmatch(words) and unit_named(quantity, unit):
                return quantity
    return "time" if not unit and unit_named("time", words) == SAMPLES else ""


def is_unit(text: str) -> bool:
    """Whether a text, with or without brackets, is a unit of any quantity."""
    bare = text.strip().strip("[](){}").strip()
    return any(unit_named(quantity, bare) for quantity in QUANTITIES)


def column_named(column: str, names: Collection[str], quantity: str = "") -> int | None:
    """Index of a column by its full name, or by its title if that is unique.

    `quantity`: quantity of the column. Returns None if there is no such column.
    """
    listed = list(names)
    if column and column in listed:
        return listed.index(column)
    for expected in ("", quantity):
        titles = [heading(name, expected).title for name in listed]
        if column and titles.count(column) == 1:
            return titles.index(column)
    return None
