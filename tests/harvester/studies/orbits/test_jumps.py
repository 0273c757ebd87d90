"""Which changes of a branch over a key are jumps."""

import numpy as np

from harvester.studies.orbits.bifurcation import Branch, jumps_of


def branch_of(direction, displacement, power):
    count = len(power)
    section = np.repeat(np.array(displacement, dtype=float)[:, None], 8, axis=1)
    nothing = np.full(count, np.nan)
    return Branch(
        direction, section, 0.0 * section, np.ones(count, dtype=int), ["period 1"] * count,
        np.array(power, dtype=float), nothing, nothing, {},
    )  # fmt: skip


def test_a_jump_of_the_power_counts_where_the_section_hardly_moves():
    """A bistable device jumps within a well, while other values take it across both."""
    values = np.linspace(0.5, 1.0, 10)
    displacement = [1.00, 1.01, 1.02, 1.03, 1.10, 1.11, 1.12, 1.13, 4.0, 4.1]
    power = [1.0, 1.1, 1.2, 1.3, 9.0, 9.4, 9.8, 10.2, 200.0, 210.0]
    up, down = (
        jumps_of(values, branch_of(direction, displacement, power)) for direction in ("up", "down")
    )
    assert [(jump.before, jump.after) for jump in up] == [
        (values[3], values[4]), (values[7], values[8]),
    ]  # fmt: skip
    assert [(jump.before, jump.after) for jump in down] == [
        (values[4], values[3]), (values[8], values[7]),
    ]  # fmt: skip
    assert (down[0].power_before, down[0].power_after) == (9.0, 1.3)


def test_a_power_that_grows_with_the_square_of_the_amplitude_does_not_jump():
    values = np.linspace(0.1, 2.0, 20)
    assert jumps_of(values, branch_of("up", values, values**2)) == []
