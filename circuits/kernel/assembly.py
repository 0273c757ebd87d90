"""Builds the tables of a scene: the transducer's network, the load, and indices for a record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from circuits.equivalent import elements as circuit_elements
from circuits.kernel.builder import Builder, tables_of
from circuits.kernel.linear import order_of
from circuits.kernel.memory import layout_of
from circuits.kernel.parts import add_load
from circuits.kernel.tables import Circuit, Probes
from circuits.netlist.measurement import measurement_of
from circuits.netlist.source_schedule import SourceSchedule
from harvester.device.terminals import GROUND, LOAD_AMMETER

if TYPE_CHECKING:
    from circuits.netlist.measurement import Measurement
    from harvester.scene.prepared import Prepared

# Prefix of the device's nodes and branches: names in a load contain no colon.
DEVICE = "device:"


def collect(ready: Prepared, whole: bool = True) -> tuple[Builder, Measurement, Probes, int]:
    """Elements of a scene's transducer and load, the measured quantities, and the index of X'.

    Parameters
    ----------
    ready : Prepared
        A scene whose load is a netlist.
    whole : bool
        Whether every element of the load is needed; otherwise unsupported elements are omitted.

    Raises
    ------
    LoadError
        The load has an element that the compiled engine does not support; the message names it.
    """
    scales, load, network = ready.scales, ready.scene.load.circuit, ready.network
    b = Builder()
    inside = b.node(DEVICE + network.terminal)
    pins = circuit_elements.load_pins(network)
    ammeter = b.through(DEVICE + LOAD_AMMETER, inside, b.node(pins["p"]))
    add_load(b, load, network, whole)
    # A load without an output has an output voltage of 0.
    ends = [b.node(pins[pin]) for pin in ("out", "ref") if load.has_output]
    places = ends or [inside, inside]
    row_unit = 1.0 / network.power_unit if network.power_unit > 0.0 else 1.0
    measurement = measurement_of(load, pins)
    places += [b.unknowns.get(name, -1) for name in measurement.watched]
    velocity = _add_transducer(b, network, scales, row_unit)
    state = _state(b, network, ammeter)
    b.initial = [entry for entry in b.initial if entry[3] != 0.0]
    units = (1.0 / scales.voltage, 1.0 / network.state_unit, network.current_per_ampere,
             network.power_unit)  # fmt: skip
    probes = Probes(
        np.array([inside, ammeter, state, *places]),
        np.array([*units, row_unit]),
        (network.reference_capacitance, scales.voltage),
    )
    return b, measurement, probes, velocity


def build(ready: Prepared) -> Circuit:
    """The tables of a scene's transducer with its load, and the code for them.

    Raises
    ------
    LoadError
        See `collect`.
    """
    from circuits.kernel.code import code_of

    load = ready.scene.load.circuit
    b, measurement, probes, velocity = collect(ready)
    tables = tables_of(b, velocity)
    if load.self_oscillation.oscillates:
        stray = circuit_elements.STRAY_SHARE * probes.energy[0]
        tables = tables._replace(own=_own(b, tables, 1.5 * stray))
    order = order_of(tables)
    return Circuit(
        tables,
        probes,
        order,
        layout_of(tables, order),
        code_of(tables, order),
        (*b.unknowns, "X'"),
        tuple(b.switch_names),
        tuple((element.name, element.where) for element, *_ in b.waiting),
        load,
        measurement,
        SourceSchedule(load.elements),
    )


def _own(b, tables, stray):
    """Indices of the load's unknowns that store more than a stray capacitance, and their kinds."""
    names = [*b.unknowns]
    stores = {
        int(row)
        for (row, column), size in zip(tables.entries, tables.capacity, strict=True)
        if row == column and row < len(names) and abs(size) > stray
    }
    storing = [(k, names[k].startswith("i(")) for k in sorted(stores) if DEVICE not in names[k]]
    return np.array(storing, dtype=np.int64).reshape(-1, 2)


def _state(b, network, ammeter):
    if network.state_current:
        return ammeter
    return b.node(DEVICE + network.state_voltage) if network.state_voltage else -1


def _add_transducer(b, network, scales, row_unit):
    """Elements of the transducer; returns the index of the velocity, the last unknown."""
    nodes = {name: b.node(DEVICE + name) for name in sorted(network.nodes)}
    nodes[GROUND] = -1
    b.branch(DEVICE + LOAD_AMMETER)
    for part in network.elements:
        if part.kind in ("inductor", "ammeter", "moving voltage", "base voltage"):
            b.branch(DEVICE + part.name)
    velocity = len(b.unknowns)
    for part in network.elements:
        _add_part(b, part, nodes, velocity, scales, row_unit)
    b.enter(velocity, velocity, capacity=row_unit)
    b.retimed.insert(0, (velocity, velocity))
    b.mark([velocity], [velocity])
    return velocity


def _add_part(b, each, nodes, velocity, scales, row_unit):
    a, z = nodes.get(each.plus, -1), nodes.get(each.minus, -1)
    if each.kind == "resistor":
        b.between(a, z, conductance=1.0 / each.value)
    elif each.kind == "capacitor":
        b.capacitor(a, z, each.value, "state" if each.holds_state else 0.0)
    elif each.kind == "inductor":
        b.inductor(DEVICE + each.name, a, z, each.value, "state" if each.holds_state else 0.0)
    elif each.kind == "ammeter":
        b.through(DEVICE + each.name, a, z)
    elif each.kind == "moving voltage":
        row = b.through(DEVICE + each.name, a, z)
        b.enter(row, velocity, conductance=each.value)
    elif each.kind == "base voltage":
        # The branch's row contains minus the voltage across it.
        b.driven.append((b.through(DEVICE + each.name, a, z), -each.value))
    elif each.kind == "moving current":
        b.enter(a, velocity, conductance=-each.value)
        b.enter(z, velocity, conductance=each.value)
        b.retimed += [(node, velocity) for node in (a, z) if node >= 0]
    elif each.kind == "force of voltage":
        gain = row_unit * each.value / scales.voltage
        b.enter(velocity, a, conductance=gain)
        b.enter(velocity, z, conductance=-gain)
    elif each.kind == "force of current":
        b.enter(velocity, b.branch(DEVICE + each.plus), conductance=row_unit * each.value)
    else:
        raise ValueError(f"{each.name}: unknown kind of element {each.kind!r}")
