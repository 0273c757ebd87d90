"""A diode's parameters at its temperature, by ngspice's model."""

from __future__ import annotations

import math
from collections.abc import Mapping

from circuits.netlist.part_models import TEMPERATURE

# ngspice's constants: 0 °C and its reference temperature, both in K, and k/q in V/K.
FREEZING, REFERENCE = 273.15, 300.15
VOLT_PER_KELVIN = 1.38064852e-23 / 1.6021766208e-19
# Largest grading coefficient of the depletion capacitance.
LARGEST_GRADING = 0.9


def at_temperature(model: Mapping[str, float], celsius: float) -> dict[str, float]:
    """The parameters of a diode's model at a temperature, including "vt" (V).

    Parameters
    ----------
    model : mapping of str to float
        Parameters by ngspice's names, valid at `tnom` °C.
    celsius : float
    """
    parameters = {"is": 1e-14, "n": 1.0, "m": 0.5, "vj": 1.0, "fc": 0.5, "eg": 1.11, "xti": 3.0,
            "nr": 2.0, **model}  # fmt: skip
    parameters["cjo"] = parameters.get("cjo", 0.0)
    nominal, kelvin = parameters.get("tnom", TEMPERATURE) + FREEZING, celsius + FREEZING
    parameters["vt"], warmer = VOLT_PER_KELVIN * kelvin, kelvin - nominal
    for current, swings in (("is", parameters["n"]), ("isr", parameters["nr"])):
        energy = (kelvin / nominal - 1.0) * parameters["eg"] / parameters["vt"]
        growth = math.exp((energy + parameters["xti"] * math.log(kelvin / nominal)) / swings)
        parameters[current] = parameters.get(current, 0.0) * growth
    grading = parameters["m"] * _polynomial(parameters, warmer, "tm1", "tm2")
    parameters["m"] = min(grading, LARGEST_GRADING)
    parameters["rs"] = parameters.get("rs", 0.0) * _polynomial(parameters, warmer, "trs1", "trs2")
    parameters["tt"] = parameters.get("tt", 0.0) * _polynomial(parameters, warmer, "ttt1", "ttt2")
    if "bv" in parameters:
        share = parameters["bv"] if parameters.get("tlev", 0.0) else 1.0
        parameters["bv"] -= parameters.get("tcv", 0.0) * warmer * share
    _depletion(parameters, nominal, kelvin)
    parameters["vj"] = (
        min(parameters["vj"], 1.0 / parameters["fc"]) if parameters["fc"] else parameters["vj"]
    )
    return parameters


def _polynomial(said, warmer, first, second):
    return 1.0 + said.get(first, 0.0) * warmer + said.get(second, 0.0) * warmer**2


def _depletion(said, nominal, kelvin):
    """The potential and the zero-bias capacitance."""
    if said.get("tlevc", 0.0):
        beyond = kelvin - REFERENCE
        said["vj"] -= said.get("tpb", 0.0) * beyond
        said["cjo"] *= 1.0 + said.get("cta", 0.0) * beyond
        return
    shift, before = _potential_shift(kelvin), _potential_shift(nominal)
    at_reference = (said["vj"] - before) * REFERENCE / nominal
    old = said["vj"] / at_reference - 1.0
    said["vj"] = shift + kelvin / REFERENCE * at_reference
    new = said["vj"] / at_reference - 1.0
    said["cjo"] *= (1.0 + said["m"] * (4e-4 * (kelvin - REFERENCE) - new)) / (
        1.0 + said["m"] * (4e-4 * (nominal - REFERENCE) - old)
    )


def _potential_shift(kelvin):
    """Change of a junction's potential (V) by silicon's band gap and intrinsic carrier density."""
    gap = 1.16 - 7.02e-4 * kelvin**2 / (kelvin + 1108.0)
    volts = VOLT_PER_KELVIN * kelvin
    half = (1.1150877 / REFERENCE - gap / kelvin) / (2.0 * VOLT_PER_KELVIN)
    return -2.0 * volts * (1.5 * math.log(kelvin / REFERENCE) + half)
