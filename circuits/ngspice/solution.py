"""Names of the vectors in ngspice's solution, and their conversion to a record."""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.equivalent import elements
from circuits.netlist.writer import current_name, node_name
from circuits.ngspice import callbacks
from harvester.base.compilation import compiled
from harvester.device import system as systems
from harvester.device.record import fill

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np

    from circuits.equivalent.assembly import Netlist
    from harvester.device.record import Record
    from harvester.device.system import System


def vectors(netlist: Netlist) -> Iterator[tuple[str, ...]]:
    """ngspice's names of the buffer's columns, for each copy of the device.

    Yields
    ------
    tuple of str
        Vectors in the order of `circuits.ngspice.callbacks`, without missing ones.
    """
    columns = (
        elements.DISPLACEMENT,
        elements.VELOCITY,
        netlist.terminal,
        elements.NOISE,
        elements.HELD,
        elements.LOAD_CURRENT,
        elements.OUTPUT,
        elements.REFERENCE,
        netlist.state,
        *(_watched(name, netlist.measurement.pins) for name in netlist.measurement.watched),
        *(_watched(name, netlist.watch.pins) for name in netlist.watch.unknowns),
    )
    for prefix in netlist.prefixes:
        # A branch's name begins with its element's letter, before the call's.
        yield tuple(
            f"{name[0]}.{prefix}{name}"
            if prefix and name.endswith("#branch")
            else f"{prefix}{name}"
            for name in columns
        )


def _watched(name, pins):
    """ngspice's name of an unknown in a load's measure."""
    if name in pins:
        return name.removeprefix(elements.PIN)
    if name.startswith("i("):
        branch = current_name(name[2:-1])
        return f"{branch[0]}.xload.{branch}#branch"
    return f"xload.{node_name(name)}"


def units_of(netlist: Netlist) -> tuple[float, float, float, float]:
    """Scaled values of 1 V, of the state's unit (1 V or 1 A), of 1 A and of 1 W."""
    return (
        1.0 / netlist.voltage_scale,
        1.0 / netlist.state_unit,
        netlist.current_per_ampere,
        netlist.per_power,
    )


@compiled
def convert(
    s: System,
    free: np.ndarray,
    times: np.ndarray,
    nodes: np.ndarray,
    record: Record,
    rate: float,
    units: tuple[float, float, float, float],
) -> None:
    """Convert times, shape (n,), and node values, shape (n, COLUMNS), to a scaled record.

    `free` are the displacements between which no contact is active. `units` come from `units_of`;
    the unit of power is 0 if no ammeter measures the load's current: a resistor's power then
    follows from the state.
    """
    per_volt, per_state, per_ampere, per_power = units
    for row in range(times.size):
        x, v = nodes[row, callbacks.DISPLACEMENT], nodes[row, callbacks.VELOCITY] * rate
        voltage, noise = nodes[row, callbacks.TERMINAL] * per_volt, nodes[row, callbacks.NOISE]
        held = nodes[row, callbacks.HELD_SPEED] * rate
        loss = systems.loss_power(s, x, v, held, x < free[0] or x > free[1])
        current = nodes[row, callbacks.LOAD_CURRENT]
        state = nodes[row, callbacks.TRANSDUCER] * per_state
        transducer_loss = systems.own_loss(s.transducer, v, state, current * per_ampere)
        if per_power > 0.0:
            power = nodes[row, callbacks.TERMINAL] * current * per_power
        else:
            power = systems.load_power(s.transducer, v, state)
        excitation = noise * (rate * rate)
        put_in = excitation * systems.base_speed(s.transducer, v, state, current * per_ampere)
        stored_state = systems.kept_state(s.transducer, state, excitation)
        fill(
            record, row, times[row], x, v, voltage, power, put_in, loss, transducer_loss,
            stored_state,
        )  # fmt: skip
