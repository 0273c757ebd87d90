"""Writes points of a record at the end of steps, with the mean power into the load."""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.kernel.mechanics import Device, evaluate
from harvester.base.compilation import compiled, merged
from harvester.device import system as systems
from harvester.device.record import fill

if TYPE_CHECKING:
    import numpy as np

    from circuits.kernel.stage import State
    from circuits.kernel.tables import Probes
    from harvester.device.record import Record

# An extra point is recorded if the mean of the powers at a step's two ends differs from the step's
# mean power by more than this share. With five times this value 0.2 % of SECE's energy was missing.
POWER_DIFFERENCE = 0.002
# No extra point is recorded if the difference in energy is below this share of the transducer's
# energy.
LEAST_ENERGY = 1e-5


@merged
def load_power(probes: Probes, state: State) -> float:
    """Voltage times current at the terminals, scaled."""
    y = state.y
    return y[probes.places[0]] * y[probes.places[1]] * probes.units[3]


@merged
def stored_energy(device: Device, probes: Probes, state: State) -> float:
    """The transducer's energy, scaled; 0 if it stores none."""
    state_row = probes.places[2]
    if state_row < 0:
        return 0.0
    return systems.transducer_energy(device.transducer, state.y[state_row] * probes.units[1])


@merged
def given_power(device: Device, probes: Probes, state: State, slope: float, share: float) -> float:
    """Power (scaled) from mass and base to the transducer, less its loss, at a share of the step.

    `slope`: rate of change of the excitation.

    This power minus the growth of the transducer's energy is the load's power, even if a pulse
    discharges the transducer: the motion is then smooth, unlike voltage times current.
    """
    y, change, places, units = state.y, state.change, probes.places, probes.units
    branch, state_row = places[1], places[2]
    amperes = y[branch] + share * change[branch]
    if state_row < 0:
        return (y[places[0]] + share * change[places[0]]) * amperes * units[3]
    v = y[y.size - 1] + share * change[y.size - 1]
    electrical = (y[state_row] + share * change[state_row]) * units[1]
    transducer_loss = systems.own_loss(device.transducer, v, electrical, amperes * units[2])
    pace = state.scalars[0].pace
    force = systems.part_force(device.transducer, v, electrical)
    return force * v * pace + force * systems.base_rate(device.transducer, slope) - transducer_loss


@merged
def add_points(
    device: Device,
    probes: Probes,
    state: State,
    record: Record,
    output: np.ndarray,
    points: int,
    h: float,
    before: tuple[float, float],
    scale: float,
    time: float,
    noise: float,
    free: tuple[float, float],
) -> int:
    """Record the end of a step; if the power jumped at the step's beginning, repeat that point.

    `before` are the load's power and the transducer's energy at the step's beginning, `scale` is
    the transducer's reference energy, `free` the displacements between which no contact is active.
    Returns the number of points.
    """
    power, stored = before
    last = load_power(probes, state)
    mean = state.scalars[0].mean_power - (stored_energy(device, probes, state) - stored) / h
    missing = abs(2.0 * mean - power - last)
    counts = missing * h > LEAST_ENERGY * probes.units[3] * scale
    if points > 0 and counts and missing > POWER_DIFFERENCE * (abs(power) + abs(last)):
        # The point is repeated with a power that makes the mean of both ends equal to the step's
        # mean.
        _again(record, output, points, 2.0 * mean - last)
        points += 1
    _write(device, probes, state, record, output, points, time, noise, free)
    return points + 1


@compiled
def _again(record, output, point, power):
    """Repeat the last point of a record with another power into the load."""
    for column in record:
        column[point] = column[point - 1]
    record.load_power[point] = power
    for row in output:
        row[point] = row[point - 1]


@merged
def _write(device, probes, state, record, output, point, time, noise, free):
    """Write one point into the record."""
    scalars, y = state.scalars[0], state.y
    n = y.size
    places, units = probes.places, probes.units
    x, v = scalars.displacement, y[n - 1]
    volts, amperes = y[places[0]], y[places[1]]
    electrical = y[places[2]] * units[1] if places[2] >= 0 else 0.0
    touches = 1.0 if x < free[0] or x > free[1] else 0.0
    loss = evaluate(device.loss_power, device.numbers, (x, v, scalars.held_speed, touches))
    transducer_loss = systems.own_loss(device.transducer, v, electrical, amperes * units[2])
    power = volts * amperes * units[3]
    put_in = noise * systems.base_speed(device.transducer, v, electrical, amperes * units[2])
    stored_state = systems.kept_state(device.transducer, electrical, noise)
    fill(
        record, point, time, x, v, volts * units[0], power, put_in, loss, transducer_loss,
        stored_state,
    )  # fmt: skip
    output[0, point] = (y[places[3]] - y[places[4]]) * units[0]
    for k in range(1, output.shape[0]):
        output[k, point] = y[places[4 + k]]
