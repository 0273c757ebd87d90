"""A contact law of a test: a linear spring and a dashpot, K d + C d'."""

from typing import NamedTuple

import numpy as np

# 1/s of damping for each 1/s² of stiffness.
DASHPOT = 0.02


class SpringDashpot(NamedTuple):
    """K and C of one stopper, scaled."""

    stiffness: float
    dashpot: float

    def elastic_force(self, depth):
        return self.stiffness * depth

    def elastic_energy(self, depth):
        return 0.5 * self.stiffness * depth * depth

    def elastic_stiffness(self, depth):
        return self.stiffness

    def greatest_depth(self, energy):
        return (2.0 * energy / self.stiffness) ** 0.5

    def damping(self, depth, v, spring_energy, held_speed):
        return self.dashpot

    def force_formula(self, depth, sign, u, gain, number, held, rate):
        push = f"{number('stiffness', self.stiffness / rate**2)}*({depth})*{sign}"
        return f"({push}+{number('dashpot', self.dashpot / rate)}*{u})"

    def duration(self, speed):
        return np.pi / np.sqrt(self.stiffness)

    def shortened(self, square_speed, steps, longest):
        return min(longest, np.pi / np.sqrt(self.stiffness) / steps)


def spring_dashpot(stiffness, restitution, exponent, event):
    return SpringDashpot(float(stiffness), DASHPOT * stiffness)
