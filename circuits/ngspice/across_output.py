"""What lies across a load's output, as ngspice evaluated it: conductance and capacitance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from PySpice.Spice.NgSpice.Shared import ffi

from harvester.errors import SimulatorAborted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from circuits.assembly import Netlist
    from harvester.record.output_side import OutputMoments


def measure_output(library: Any, netlist: Netlist, outputs: Sequence[OutputMoments]) -> None:
    """Set conductance and capacitance, scaled, of the output of each copy of a netlist.

    The conductance from each resistor's own current and power at the end of the run: they hold
    what its multiplier, scale, temperature and model make of its value.

    Parameters
    ----------
    library : cffi library
        ngspice, which has just run the netlist.
    netlist : circuits.assembly.Netlist
    outputs : sequence of harvester.record.output_side.OutputMoments
        One for each copy.

    Raises
    ------
    SimulatorAborted
        ngspice has no number for one of them.
    """
    scale = netlist.per_power * netlist.voltage_scale**2
    for prefix, output in zip(netlist.prefixes, outputs, strict=True):
        resistors = [_in_copy(name, prefix) for name in netlist.output_resistors]
        siemens = [_conductance(library, name, output) for name in resistors]
        capacitors = [_in_copy(name, prefix) for name in netlist.storage]
        farads = [_property(library, name, "capacitance") for name in capacitors]
        # What a negative one delivers is not used, it is what makes a load not passive.
        output.conductance = scale * sum(np.maximum(siemens, 0.0))
        output.capacitance = scale * sum(farads)
        if not np.isfinite(output.conductance + output.capacitance):
            names = ", ".join(netlist.output_resistors + netlist.storage)
            raise SimulatorAborted(
                f"ngspice gave no value of {names}: give what lies across out and ref a "
                "constant value"
            )


def _in_copy(device, prefix):
    """ngspice's name of an element of one copy of the device: its letter stays in front."""
    letter, path = device.split(".", 1)
    return f"{letter}.{prefix}{path}"


def _conductance(library, resistor, output):
    current, power = (_property(library, resistor, name) for name in ("i", "p"))
    if power:
        return current / (power / current)
    # It takes no part (m=0), or there never was a voltage; or just now there is none.
    return 0.0 if output.voltage or not output.has_started else np.nan


def _property(library, device, name):
    vector = library.ngGet_Vec_Info(f"@{device}[{name}]".encode())
    if vector == ffi.NULL or vector.v_realdata == ffi.NULL:
        return np.nan
    return float(vector.v_realdata[0])
