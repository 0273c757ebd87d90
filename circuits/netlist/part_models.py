"""Values of R, C and L, diode parameters and switch laws, from their models."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from circuits.netlist.elements import Model
from circuits.netlist.expression import ZERO, ExpressionError, Tree
from harvester.base.plain_text import nearest

if TYPE_CHECKING:
    from collections.abc import Mapping

# Temperature of the circuit and reference temperature of values, in °C.
TEMPERATURE = 27.0
# ngspice's default length and width of a resistor or capacitor, in metres.
_EDGE = 10e-6
_TEMPERATURES = {"tc", "tc1", "tc1r", "tc2", "tc2r", "tce", "tnom"}
# Parameters of models of resistors, capacitors and coils. Noise and limits have no effect.
_NOISE = {"kf", "af", "lf", "wf", "ef", "bv_max"}
_DIODE = (
    "level is js isw jsw rs trs trs1 trs2 n ns tt ttt1 ttt2 cjo cj0 cj cjp cjsw vj pb php vjsw m "
    "mj mjsw ikf ik ikr ikp nbv area pj tlev tlevc eg xti cta ctc ctp tpb tvj tphp tcv tbv1 tm1 "
    "tm2 tnom tref fc fcs bv vb vrb ibv ib kf af fv_max bv_max id_max te_max pd_max rth0 cth0 "
    "jtun jtunsw ntun xtitun keg isr nr lm lp wm wp xom xoi xm xp xw vp gap1 gap2 rsw w l"
)
KNOWN = {
    "r": {"r", "res", "rsh", "narrow", "dw", "short", "dlr", "defw", "w", "l", *_TEMPERATURES,
          *_NOISE},
    "c": {"cap", "cj", "cjsw", "defw", "defl", "narrow", "short", "del",
          *_TEMPERATURES, "bv_max"},
    "l": {"ind", *_TEMPERATURES},
    "d": set(_DIODE.split()),
    "sw": {"vt", "vh", "ron", "roff"}, "csw": {"it", "ih", "ron", "roff"},
    "vswitch": {"von", "voff", "ron", "roff"}, "iswitch": {"ion", "ioff", "ron", "roff"},
}  # fmt: skip
# Switch parameters that other programs interpret differently.
ELSEWHERE = {
    "level": "level=2 is LTspice's switch with a current limit: write a B source",
    "ilimit": "it belongs to LTspice's switch: write a B source",
    "lser": "it belongs to LTspice's switch: write a separate element",
    "vser": "it belongs to LTspice's switch: write a separate element",
    "td": "it belongs to PSpice's switch: delay the control by R and C",
}
# Other names of diode parameters.
_SAME = {
    "js": "is", "trs": "trs1", "cj0": "cjo", "cj": "cjo", "pb": "vj", "mj": "m", "ik": "ikf",
    "vb": "bv", "vrb": "bv", "ib": "ibv", "tref": "tnom",
}  # fmt: skip
# Smallest resistance, in ohms: below, rounding of voltages hides a harvester's current.
LEAST_RESISTANCE = 1e-6
# ngspice's smallest saturation current, in amperes.
LEAST_SATURATION = 1e-28
# Threshold and half the hysteresis in a switch's model.
LEVELS = {"s": ("vt", "vh"), "w": ("it", "ih")}
# Controls at which PSpice's switches are on and off, and their defaults.
_ENDS = {"vswitch": (("von", 1.0), ("voff", 0.0)), "iswitch": (("ion", 1e-3), ("ioff", 0.0))}


def unknown_word(kind: str, name: str) -> str:
    """Why a model of this kind cannot have a parameter; empty if it can."""
    if name in KNOWN.get(kind, (name,)):
        return ""
    if (kind, name) == ("c", "c"):
        return "a model c has no parameter c in ngspice: write cap="
    if kind in ("sw", "csw", "vswitch", "iswitch") and name in ELSEWHERE:
        return f"{name}: {ELSEWHERE[name]}"
    return f"a model {kind} has no {name} in ngspice{nearest(name, KNOWN[kind])}; remove it"


def size(
    letter: str, nominal: float | None, model: Model | None, numbers: Mapping[str, float]
) -> float:
    """Value (Ω, F or H) of one R, C or L from its model, scale and temperature.

    Raises
    ------
    ExpressionError
        No value is given.
    """
    model = model or Model("", letter, ())
    if model.kind != letter:
        raise ExpressionError(
            f"the model {model.name} is of kind {model.kind}: name a model of kind {letter}"
        )
    if nominal is None:
        nominal = _by_model(letter, model, numbers)
    if nominal is None:
        raise ExpressionError("it has no value: write a value after the nodes, or name a model")
    temperature = numbers.get("temp", TEMPERATURE + numbers.get("dtemp", 0.0))
    warmer = temperature - model.get("tnom", TEMPERATURE)
    first = _first_of(numbers, model, "tc1", "tc", "tc1r")
    second = _first_of(numbers, model, "tc2", "tc2r")
    factor = 1.0 + first * warmer + second * warmer**2
    power = _first_of(numbers, model, "tce")
    if power:
        factor = math.pow(1.01, power * warmer)
    return nominal * factor * numbers.get("scale", 1.0)


def _first_of(numbers, model, *names):
    values = (table.get(name) for name in names for table in (numbers, dict(model.numbers)))
    return next((value for value in values if value is not None), 0.0)


def _by_model(letter, model, numbers):
    parameters: dict[str, Any] = dict(model.numbers)
    value_names = {"r": ("r", "res"), "c": ("cap",), "l": ("ind",)}[letter]
    value = next((parameters[name] for name in value_names if name in parameters), None)
    if value is not None or letter == "l":
        return value
    width = numbers.get("w", parameters.get("w", parameters.get("defw", _EDGE)))
    if letter == "r":
        length = numbers.get("l", parameters.get("l", _EDGE)) - 2.0 * parameters.get(
            "short", parameters.get("dlr", 0.0)
        )
        width -= 2.0 * parameters.get("narrow", parameters.get("dw", 0.0))
        return parameters["rsh"] * length / width if "rsh" in parameters and width > 0.0 else None
    # A capacitor model has no default length.
    if "cj" not in parameters or "l" not in numbers:
        return None
    length = numbers["l"] - parameters.get("short", 2.0 * parameters.get("del", 0.0))
    width -= parameters.get("narrow", 2.0 * parameters.get("del", 0.0))
    return parameters["cj"] * length * width + 2.0 * parameters.get("cjsw", 0.0) * (length + width)


def check_diode(line: Any, model: Model, numbers: Mapping[str, float]) -> Model:
    """Check a diode's model and return it with standard parameter names.

    Raises
    ------
    NetlistError
    """
    if model.kind != "d":
        line.refuse(f"a diode with a model of {model.kind}")
    parameters = {_SAME.get(key, key): value for key, value in model.numbers}
    # ngspice raises smaller values to LEAST_SATURATION.
    saturation = parameters.get("is", 1e-14)
    parameters["is"] = max(saturation, LEAST_SATURATION) if saturation > 0.0 else 0.0
    area = numbers.get("area", 1.0) * numbers.get("m", 1.0)
    if not (parameters["is"] > 0.0 and parameters.get("n", 1.0) > 0.0 and area > 0.0):
        line.refuse("is, n, area and m of a diode must be > 0")
    if not (0.0 <= parameters.get("m", 0.5) < 1.0 and 0.0 <= parameters.get("fc", 0.5) < 1.0):
        line.refuse("m and fc of a diode must be in [0, 1)")
    breakdown, potential = parameters.get("bv", 1.0), parameters.get("vj", 1.0)
    if parameters.get("rs", 0.0) < 0.0 or breakdown <= 0.0 or potential <= 0.0:
        line.refuse("a diode must have rs ≥ 0, bv > 0 and vj > 0")
    if parameters.get("level", 1.0) not in (1.0, 3.0):
        line.refuse("level= of a diode must be 1 or 3: give is, n, rs, cjo")
    return model._replace(numbers=tuple(parameters.items()))


def switch(line: Any, model: Model) -> Model:
    """A switch's model with all its numbers.

    Raises
    ------
    NetlistError
    """
    kind = "csw" if line.letter == "w" else "sw"
    if model.kind != kind:
        line.refuse(f"a switch with a model of {model.kind}: it needs {kind}")
    off, on = model.get("roff", 1e12), model.get("ron", 1.0)
    if min(off, on) < LEAST_RESISTANCE:
        line.refuse(
            f"ron={on:g} roff={off:g}: below {LEAST_RESISTANCE:g} Ω currents are lost by rounding; "
            "write 1m (1e-3 ohms)"
        )
    threshold, width = LEVELS[line.letter]
    numbers = {threshold: model.get(threshold), width: model.get(width), "ron": on, "roff": off}
    return model._replace(numbers=tuple(numbers.items()))


def smooth_switch(line: Any, model: Model, control: Tree) -> Tree | None:
    """Conductance of a smooth switch of LTspice or PSpice; None for ngspice's switches.

    Smooth switches are LTspice's with negative hysteresis, and PSpice's VSWITCH and ISWITCH. The
    logarithm of the conductance is a cubic between both ends.
    """
    if model.kind in _ENDS:
        high, low = (model.get(*names) for names in _ENDS[model.kind])
        if (model.kind == "vswitch") != (line.letter == "s"):
            line.refuse(f"a switch with a model of {model.kind}")
        off, on = model.get("roff", 1e6), model.get("ron", 1.0)
    else:
        threshold, width = LEVELS[line.letter]
        if model.get(width) >= 0.0:
            return None
        low, high = model.get(threshold) + model.get(width), model.get(threshold) - model.get(width)
        off, on = model.get("roff", 1e12), model.get("ron", 1.0)
    if high == low or min(off, on) <= 0.0:
        line.refuse("a smooth switch needs two controls that differ, and resistances above 0")
    share = ("/", ("-", control, ("number", low)), ("number", high - low))
    x = ("min", ("max", share, ZERO), ("number", 1.0))
    cubic = ("*", ("*", x, x), ("-", ("number", 3.0), ("*", ("number", 2.0), x)))
    return ("/", ("exp", ("*", ("number", math.log(off / on)), cubic)), ("number", off))


def hysteresis(letter: str, model: Model | None) -> tuple[float, float]:
    """Controls (V, for a W in A) below which a switch opens and above which it closes."""
    middle, half = (model.get(name) if model else 0.0 for name in LEVELS[letter])
    return middle - half, middle + half
