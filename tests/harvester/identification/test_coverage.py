"""Intervals hold the truth as often as they say, over devices drawn at random."""

from dataclasses import replace

import measured_records
import numpy as np
import pytest
from measured_records import band_noise, measured, off, scene_of

from harvester.identification.identify import identify
from harvester.scene.numbers import numbers

DEVICES, PERIODS, PER_PERIOD = 8, 100, 40
MASS = 0.01


def drawn(rng, number):
    """A device and the frequency and length of its motion: hardening, bistable, uneven, in turn."""
    frequency, length = rng.uniform(8.0, 40.0), rng.uniform(1e-3, 4e-3)
    stiffness = MASS * (2.0 * np.pi * frequency) ** 2
    shape = [
        (1.0, 0.0, rng.uniform(0.3, 1.0)),
        (-0.5, 0.0, 0.5),
        (1.0, rng.uniform(0.2, 0.4), rng.uniform(0.4, 1.0)),
        (-0.5, 0.1, 0.5),
    ][number % 4]
    force = [0.0, *(k * stiffness / length**n for n, k in enumerate(shape))]
    rate = 2.0 * np.pi * frequency
    damping = 2.0 * rng.uniform(0.01, 0.03) * MASS * rate
    if number % 8 < 4:
        capacitance = 4e-8
        coupling = np.sqrt(rng.uniform(0.03, 0.15) * stiffness * capacitance)
        transducer = {"piezo": {"coupling": coupling, "capacitance": capacitance}}
        return (
            scene_of(MASS, damping, force, transducer, 1.0 / (rate * capacitance)),
            frequency,
            length,
        )
    coupling = np.sqrt(2.0 * rng.uniform(0.01, 0.03) * MASS * rate * 900.0)
    transducer = {"coil": {"coupling": coupling, "resistance": 300.0}}
    return scene_of(MASS, damping, force, transducer, 600.0), frequency, length


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("numbers_of_devices", "shaken"),
    [(range(DEVICES), 0.0), (range(1, DEVICES, 2), 0.004)],
    ids=["all", "between wells, noisy base"],
)
def test_intervals_hold_the_truth_at_nine_values_in_ten(monkeypatch, numbers_of_devices, shaken):
    if shaken:
        monkeypatch.setattr(measured_records, "NOISE", shaken)
    inside = []
    for number in numbers_of_devices:
        rng = np.random.default_rng([7, number])
        truth, frequency, length = drawn(rng, number)
        rate = PER_PERIOD * frequency
        rms = rng.uniform(0.2, 0.5) * length * (2.0 * np.pi * frequency) ** 2
        base = band_noise(rng, PERIODS * PER_PERIOD, rate, 0.2 * frequency, 3.0 * frequency, rms)
        record = measured(truth, base, rate, rng)
        noise = shaken * base.std() * rng.standard_normal(base.size)
        record = replace(record, acceleration=base + noise)
        keys = [key for key in numbers(truth) if key.endswith(("damping", "coupling"))]
        found = identify(off(truth, keys, rng), record, compare=False)
        for key, (low, high) in found.intervals.items():
            true = numbers(truth)[key][0]
            inside.append(low <= true <= high)
            assert high - low < 2.0 * (0.15 if key.endswith("damping") else 0.05) * abs(true), key
    # 95 % each: of some forty values a fifth outside is a chance of one in a thousand, of some
    # twenty one of one in two hundred.
    assert np.mean(inside) >= 0.8, inside
    assert len(inside) >= 4 * len(numbers_of_devices)
