"""The record that every engine hands to the same estimators, in chunks."""

from typing import NamedTuple

import numpy as np

from harvester.compilation import compiled


class Record(NamedTuple):
    """A chunk of consecutive accepted time points, scaled units; arrays of one shape (n,).

    Attributes
    ----------
    time : s, increasing; the spacing may vary.
    displacement, velocity, voltage : X, X', V of Eq. 4.
    load_power : power leaving the piezo, β λ V² for a resistor (Eq. 30).
    input_power : η X', what the base puts in (Eq. 33).
    loss_power : what damper, contacts and the transducer's own resistance take, for a piezo
        without leak [c + contact damping] X'² (Eq. 36).
    transducer_loss : the part of it in leak or winding.
    """

    time: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    voltage: np.ndarray
    load_power: np.ndarray
    input_power: np.ndarray
    loss_power: np.ndarray
    transducer_loss: np.ndarray


def empty_record(count):
    """A record of `count` points to be filled."""
    return Record(*(np.empty(count) for _ in Record._fields))


def part(record, start, stop):
    """Points start … stop − 1 of a record, as views."""
    return Record(*(column[start:stop] for column in record))


@compiled
def fill(record, index, time, x, v, voltage, load_power, input_power, loss, own_loss):
    """Write one point; `loss` is that of damper and contacts, `own_loss` the transducer's."""
    record.time[index] = time
    record.displacement[index] = x
    record.velocity[index] = v
    record.voltage[index] = voltage
    record.load_power[index] = load_power
    record.input_power[index] = input_power
    record.loss_power[index] = loss + own_loss
    record.transducer_loss[index] = own_loss
