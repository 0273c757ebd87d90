"""A device's functions by their addresses against the device's own."""

import itertools

import numpy as np
import pytest
from device_scenes import device

from circuits.kernel.mechanics import device_of, evaluate
from harvester.base.compilation import compiled
from harvester.device import contact, system
from harvester.device.spring import force
from harvester.scene.prepared import prepared


@compiled
def by_address(address, numbers, values):
    return evaluate(address, numbers, values)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["uneven stoppers", "bias and quadratic term"])
def test_a_function_by_its_address_is_the_devices_own(name):
    s = prepared(device(name)).system
    addresses = device_of(s)
    edges = contact.edges(s.contacts)
    chance = np.random.default_rng(1)
    for low, high in itertools.pairwise(edges):
        place = np.clip(chance.normal(), max(low, -2.0), min(high, 2.0))
        v, noise, held = chance.normal(size=3)
        touching = not low < 0.0 < high
        acts = 1.0 if touching else 0.0
        resistance = force(s.spring, place) + system.part_force(s.damper, v)
        if touching:
            resistance += system.contact_force(s, place, v, abs(held), low, high)
        speed = abs(v) + abs(noise - system.part_force(s.damper, v)) * 0.1
        for address, values, expected in (
            (addresses.pull, (acts, low, high, abs(held), place, v), resistance),
            (
                addresses.contact_step,
                (place, v, noise, 0.1, 0.05, 20.0),
                contact.step(s.contacts, place, speed * speed, 0.05, 20),
            ),
            (
                addresses.loss_power,
                (place, v, abs(held), acts),
                system.loss_power(s, place, v, abs(held), touching),
            ),
        ):
            found = by_address(address, addresses.numbers, tuple(map(float, values)))
            assert found == pytest.approx(float(expected), rel=1e-12)
