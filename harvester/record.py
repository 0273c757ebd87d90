"""The record that every engine hands to the same estimators, in chunks."""

from typing import NamedTuple

import numpy as np

from harvester import forces
from harvester.compilation import compiled


class Record(NamedTuple):
    """A chunk of consecutive accepted time points, scaled units; arrays of one shape (n,).

    Attributes
    ----------
    time : s, increasing; the spacing may vary.
    displacement, velocity, voltage : X, X', V of Eq. 4.
    load_power : power leaving the piezo, β λ V² for a resistor (Eq. 30).
    input_power : η X', what the base puts in (Eq. 33).
    loss_power : [c + contact damping] X'² (Eq. 36).
    """

    time: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    voltage: np.ndarray
    load_power: np.ndarray
    input_power: np.ndarray
    loss_power: np.ndarray


def empty_record(count):
    """A record of `count` points to be filled."""
    return Record(*(np.empty(count) for _ in Record._fields))


def part(record, start, stop):
    """Points start … stop − 1 of a record, as views."""
    return Record(*(column[start:stop] for column in record))


@compiled
def fill(p, record, index, time, x, v, voltage, noise, held_speed):
    """Write one point: the state, and the powers that follow from it.

    `held_speed` is the impact velocity v0 at contact (`event`); not read in `energy` mode.
    """
    loss = p.damping
    if abs(x) > p.gap:
        loss += forces.contact_damping(p, x, v, held_speed)
    record.time[index] = time
    record.displacement[index] = x
    record.velocity[index] = v
    record.voltage[index] = voltage
    record.load_power[index] = p.coupling * p.decay_rate * voltage * voltage
    record.input_power[index] = noise * v
    record.loss_power[index] = loss * v * v
