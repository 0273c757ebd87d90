"""The device as C code: equations generated from its parts' formulas, and a fixed integrator.

`sources/` contains the integrator, `harvester_device.c`, and the FMU's additions. It is compiled
with `equations.h`, which contains one device's values and forces in SI.
"""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from circuits.equivalent.elements import named_contacts, number
from harvester.base.errors import ExportError
from harvester.base.writing import LICENCE
from harvester.device import contact as contacts
from harvester.device import timescales
from harvester.device.coil import CoilTable
from harvester.device.damper import drag_formula
from harvester.device.piezo import PiezoTable
from harvester.interop.block import folder_of, write_files
from harvester.scene.paths import start_state

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.scene.model import Scene
    from harvester.scene.prepared import Prepared

HEAD = "/* " + "\n * ".join(LICENCE) + "\n */\n"
SIGN = "static double sgn(double value) { return (value > 0.0) - (value < 0.0); }\n"
STEPPER = ("harvester_device.h", "harvester_device.c")


def source(name: str) -> str:
    """Text of a file in `sources/`, preceded by the licence."""
    text = resources.files("harvester.interop").joinpath("sources", name).read_text("utf-8")
    return HEAD + text


def write_c(setup: Prepared, output: str | Path) -> list[Path]:
    """Write the device as C: integrator and equations.

    Parameters
    ----------
    output : str or Path
        Folder.

    Raises
    ------
    ExportError
        The device is not in SI, or has parts without C code.
    """
    return write_files(folder_of(output, "c"), device_files(setup))


def device_files(setup: Prepared) -> dict[str, str]:
    """Texts of the files of integrator and equations, by name."""
    files = {name: source(name) for name in STEPPER}
    files["equations.h"] = equations(setup)
    return files


def equations(setup: Prepared) -> str:
    """The text of `equations.h`: one device's values and forces.

    Raises
    ------
    ExportError
    """
    scene = setup.scene
    if scene.units != "SI":
        raise ExportError(
            f'{scene.name}: units = "{scene.units}": a block for other tools is in SI; give mass, '
            'stiffness and transducer in SI with units = "SI", as the scene paper_si does'
        )
    if scene.excitation.prescribes_displacement:
        raise ExportError(
            f"{scene.name}: excitation.kind = {scene.excitation.kind!r}: the displacement is given "
            "and no mass moves; use a kind that accelerates the base"
        )
    constants: dict[str, str] = {}

    def named(key: str, value: float, *meaning: str) -> str:
        # The circuit's formulas have the time unit 1/rate; here it is 1 s.
        comment = f" /* {meaning[0].replace('/rate^2', '')} */" if meaning and meaning[0] else ""
        constants[key] = f"static const double {key} = {number(value)};{comment}\n"
        return key

    functions = _forces(setup.system, named) + _contacts(setup.system, named)
    sign = SIGN if "sgn(" in functions else ""
    comment = (
        f"/* Of the scene {scene.name}. Lengths are over LENGTH, forces over MASS LENGTH. */\n"
    )
    return "\n".join(
        [HEAD + comment + _numbers(setup), "".join(constants.values()), sign + functions]
    )


def _numbers(ready: Prepared) -> str:
    """Scales, start and transducer as macros."""
    x, v, state = start_state(ready, 0)
    length, mass = ready.setting.length, ready.setting.mass
    state_unit = ready.scene.transducer.state_unit(ready.setting)
    rate = timescales.angular_frequency(ready.system)
    low, high = ready.system.spring.range
    values = {
        "LENGTH": (length, "m"),
        "MASS": (mass, "kg"),
        "RATE": (rate, "rad/s, of small oscillations"),
        "STATE_UNIT": (state_unit, "V or A"),
        # Sign: a base acceleration a acts on the mass as the force −m a.
        "EXCITATION_UNIT": (-ready.excitation_unit, "base acceleration for one unit of force"),
        "LOWEST": (low, "the spring's range"),
        "HIGHEST": (high, ""),
        "START_DISPLACEMENT": (x * length, "m"),
        "START_VELOCITY": (v * length, "m/s"),
        "START_STATE": (state * state_unit, "V or A"),
    }
    lines = [
        f"#define {key} ({c_number(value)}){f' /* {comment} */' if comment else ''}\n"
        for key, (value, comment) in values.items()
    ]
    return "".join(lines) + _transducer(ready.scene)


def _transducer(scene: Scene) -> str:
    table: Any = scene.transducer
    if isinstance(table, PiezoTable):
        leak = 1.0 / table.leakage_resistance if table.leakage_resistance else 0.0
        kind = "PIEZO"
        values = {
            "COUPLING": table.coupling, "CAPACITANCE": table.capacitance, "LEAK": leak,
            "BASE_CHARGE": getattr(table, "base_charge", 0.0),
        }  # fmt: skip
        energy = 0.5 * table.capacitance
    elif isinstance(table, CoilTable):
        kind = "COIL" if table.inductance > 0.0 else "RESISTIVE_COIL"
        values = {
            "COUPLING": table.coupling, "WINDING": table.resistance,
            "INDUCTANCE": table.inductance,
        }  # fmt: skip
        energy = 0.5 * table.inductance
    else:
        raise ExportError(
            f"{scene.name}: exported C has the transducers piezo and coil, not "
            f"{type(table).__name__}; export a subckt or a deck"
        )
    values["STATE_ENERGY"] = energy
    lines = "".join(f"#define {key} ({c_number(value)})\n" for key, value in values.items())
    return f"#define {kind}\n{lines}"


def _forces(s: System, named: Any) -> str:
    """Functions of the spring's force and energy and the damper's force."""
    tilt, linear = s.spring.line
    spring = [
        named("tilt", tilt, "F(0)") if tilt else "",
        f"{named('linear_stiffness', linear, 'k1')}*x" if linear else "",
        s.spring.nonlinear_formula("x", 1.0, named),
    ]
    damper = [f"{named('damping', s.damper.damping, 'c')}*u", drag_formula(s.damper, "u", named)]
    gain = s.spring.gain_formula("x", 0.0, 1.0, lambda key, value, *meaning: f"({number(value)})")
    energy = f"0.5*({gain})"
    return (
        _function("spring_force", "x", "+".join(filter(None, spring)) or "0.0*x")
        + _function("spring_energy", "x", energy)
        + _function("damper_force", "u", "+".join(filter(None, damper)))
    )


def _contacts(s: System, named: Any) -> str:
    """Positions at which contacts begin, and a function for their forces."""
    pairs = list(named_contacts(s))
    cases = ""
    for k, (name, contact) in enumerate(pairs):

        def own(key: str, value: float, *description: str, name: str = name) -> str:
            return named(f"{name}_{key}", value, *description)

        _, force = contacts.formulas(contact, s.spring, "x", "u", 1.0, own, "held")
        cases += f"    case {k}: return {c_text(force)};\n"
    sides = [contact.side for _, contact in pairs] or [0.0]
    gaps = [contact.gap for _, contact in pairs] or [0.0]
    rows = {"SIDES": sides, "GAPS": gaps, "EDGES": contacts.edges(s.contacts)}
    arrays = "".join(
        f"static const double {key}[] = {{{', '.join(map(c_number, row))}}};\n"
        for key, row in rows.items()
    )
    return (
        f"enum {{ CONTACTS = {len(pairs)} }};\n{arrays}"
        "static double contact_force(int contact, double x, double u, double held)\n{\n"
        "    (void)x, (void)u, (void)held;\n"
        f"    switch (contact) {{\n{cases}    default: return 0.0;\n    }}\n}}\n"
    )


def _function(name: str, argument: str, formula: str) -> str:
    return f"static double {name}(double {argument}) {{ return {c_text(formula)}; }}\n"


def c_text(formula: str) -> str:
    """Convert an expression of circuits and Verilog-A to C: abs becomes `fabs`."""
    return re.sub(r"\babs\(", "fabs(", formula)


def c_number(value: float) -> str:
    """Format a float so that C reads it back exactly."""
    return number(value).replace("inf", "HUGE_VAL")
