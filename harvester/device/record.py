"""The record that every engine passes to the estimators, in chunks."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from harvester.base.compilation import compiled, register_jitable


class Record(NamedTuple):
    """A chunk of consecutive accepted time points, in scaled units; all arrays have shape (n,).

    Attributes
    ----------
    time
        s, increasing; the spacing may vary.
    displacement, velocity, voltage : X, X' and V of Eq. 4, scaled.
    load_power
        Power leaving the transducer, β λ V² for a resistor (Eq. 30).
    input_power
        Power from the base: excitation times velocity, η X' (Eq. 33), plus −βκ η W' if the base
        moves charge in a piezo (see `harvester.device.piezo.BaseForcedPiezo`).
    loss_power
        Power lost in damper, contacts and the transducer's internal resistance, for a piezo
        without leak [c + contact damping] X'² (Eq. 36).
    transducer_loss
        The part of `loss_power` in leakage or winding.
    transducer_state
        State that determines the transducer's energy: in a piezo V or W.
    """

    time: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    voltage: np.ndarray
    load_power: np.ndarray
    input_power: np.ndarray
    loss_power: np.ndarray
    transducer_loss: np.ndarray
    transducer_state: np.ndarray


class Observer(Protocol):
    """Interface of objects that receive each chunk of a realization's record."""

    def add(self, record: Record) -> None:
        """Process the points; the next chunk overwrites them."""


def empty_record(count: int) -> Record:
    """A record of `count` points to be filled."""
    return Record(*(np.empty(count) for _ in Record._fields))


@register_jitable
def part(record: Record, start: int, stop: int) -> Record:
    """Points start … stop − 1 of a record, as views."""
    # Written out field by field: compiled code accepts no generator here.
    return Record(
        record.time[start:stop],
        record.displacement[start:stop],
        record.velocity[start:stop],
        record.voltage[start:stop],
        record.load_power[start:stop],
        record.input_power[start:stop],
        record.loss_power[start:stop],
        record.transducer_loss[start:stop],
        record.transducer_state[start:stop],
    )


@register_jitable
def copy_point(record: Record, index: int, point: np.ndarray) -> None:
    """Write one point of a record into an array of shape (9,)."""
    point[0], point[1] = record.time[index], record.displacement[index]
    point[2] = record.velocity[index]
    point[3], point[4] = record.voltage[index], record.load_power[index]
    point[5], point[6] = record.input_power[index], record.loss_power[index]
    point[7], point[8] = record.transducer_loss[index], record.transducer_state[index]


@compiled
def fill(
    record: Record,
    index: int,
    time: float,
    x: float,
    v: float,
    voltage: float,
    load_power: float,
    input_power: float,
    loss: float,
    own_loss: float,
    state: float,
) -> None:
    """Write one point; damper and contacts dissipate `loss`, the transducer `own_loss`."""
    record.time[index] = time
    record.displacement[index] = x
    record.velocity[index] = v
    record.voltage[index] = voltage
    record.load_power[index] = load_power
    record.input_power[index] = input_power
    record.loss_power[index] = loss + own_loss
    record.transducer_loss[index] = own_loss
    record.transducer_state[index] = state
