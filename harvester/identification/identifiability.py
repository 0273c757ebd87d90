"""Identifiability: values that keep the scene's values, and effects of assumed values.

A sensor's gain, a load's resistance and the mass are assumed exact.
Adding the column of such an assumed value shows whether its error changes the residuals, and which
fitted values compensate for it. One error at a time is examined.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.intervals import (
    HALF_INTERVAL,
    Undetermined,
    normal_equations,
    undetermined,
    units_of,
)
from harvester.identification.measured_response import MeasuredImpedance
from harvester.identification.unknowns import BASE_FACTOR, BASE_SCALE, LOAD, MASS, factor_key
from harvester.scene.numbers import numbers

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted

# The data reveal an error of an assumed value if its relative standard error in a joint fit is
# below this: an error of 3 % is then three standard errors.
SEPARABLE = 0.01
# A fitted value depends on an assumed value if a relative change of 1 of the assumed value changes
# the fitted value by more than this share.
DEPENDENT = 0.05
# If a combination of values is undetermined, its first member in this list keeps the scene's value;
# if it has none of them, the value with the largest component does.
KEPT_FIRST = ("mass", "capacitance", "restitution", "stiffness", "quadratic_damping")


@dataclass(frozen=True)
class Assumption:
    """A value that the fit assumes, and the effect of its error.

    Attributes
    ----------
    key : str
        `sensor.voltage_scale`, `load.resistance`, `oscillator.mass`, …
    records : tuple of str
        Names of the records with this value.
    change : float
        Relative change that the data imply, to first order, with the fitted values refitted.
    error : float
        Standard error of the change.
    moves : dict of str to float
        d ln(fitted value) / d ln(this value), by the fitted values' keys.
    """

    key: str
    records: tuple[str, ...]
    change: float
    error: float
    moves: dict[str, float]

    @property
    def is_separable(self) -> bool:
        """Whether the data would reveal an error of this value."""
        return self.error < SEPARABLE

    @property
    def significance(self) -> float:
        """The change in standard errors."""
        return self.change / self.error

    @property
    def dependent(self) -> dict[str, float]:
        """Fitted values that compensate for an error of this value, with their relative changes."""
        return {key: move for key, move in self.moves.items() if abs(move) > DEPENDENT}

    def __str__(self) -> str:
        moved = ", ".join(
            f"{key.rpartition('.')[2]} by {move:+.2g} %" for key, move in self.dependent.items()
        )
        change = f"these data imply {self.change:+.2%} ± {HALF_INTERVAL * self.error:.2%}"
        if not self.is_separable:
            change = "these data do not reveal its error"
        return f"{self.key} is assumed exact: +1 % changes {moved or 'no value'}; {change}"


def to_keep(fitted: Fitted) -> list[tuple[str, Undetermined]]:
    """Keys to keep at the scene's values so that the records determine the others, with reasons.

    Keys are fixed one after another; the covariance of the others is then conditional on them.
    """
    unknowns, values, matrix = list(fitted.shooting.unknowns), fitted.values, fitted.covariance
    fixed: list[tuple[str, Undetermined]] = []
    while len(unknowns) > 1 and (directions := undetermined(unknowns, values, matrix)):
        keys = directions[0].keys
        first = next((key for name in KEPT_FIRST for key in keys if key.endswith(name)), keys[0])
        fixed.append((first, directions[0]))
        n = [unknown.key for unknown in unknowns].index(first)
        del unknowns[n]
        matrix = matrix - np.outer(matrix[n], matrix[n]) / matrix[n, n]
        values, matrix = np.delete(values, n), np.delete(np.delete(matrix, n, 0), n, 1)
    return fixed


def assumptions(fitted: Fitted) -> list[Assumption]:
    """Assumed values (sensors' gains, loads' resistances, the mass) and effects of their errors."""
    assumed = _assumed_keys(fitted.shooting)
    if not assumed:
        return []
    problem, fit, _ = fitted.extended([factor_key(key, records) for key, records in assumed])
    equations = normal_equations(problem, fit, at_minimum=False)
    p = len(fitted.keys)
    units = units_of(fitted.shooting.unknowns, fitted.values) / problem.sizes[:p]
    result = []
    for index, (key, records) in enumerate(assumed):
        alone = equations.of([*range(p), p + index])
        moves = -np.linalg.lstsq(alone.normal[:p, :p], alone.normal[:p, p], rcond=1e-13)[0]
        error = float(np.sqrt(max(alone.covariance[p, p], 0.0)))
        by_key = fitted.shooting.known(moves / units)
        names = tuple(problem.experiments[n].measurement.name for n in records)
        result.append(Assumption(key, names, float(alone.step[p]), error, by_key))
    return result


def _assumed_keys(shooting):
    """Keys of assumed values, with the numbers of the records that share an error."""
    shared: dict[tuple[str, float], list[int]] = {}
    for number, experiment in enumerate(shooting.experiments):
        # An impedance has no moving base and no load, and its analyser is assumed exact.
        keys = [MASS]
        if not isinstance(experiment.measurement, MeasuredImpedance):
            gains = [f"sensor.{name}_scale" for name in experiment.measurement.sensed]
            keys = [*gains, *[BASE_SCALE] * (BASE_FACTOR not in shooting.keys), MASS, LOAD]
        values = numbers(experiment.scene)
        for key in keys:
            if key not in shooting.keys and (key in values or key.startswith("sensor.")):
                # Resistors may differ between records; a sensor is the same in all records.
                of = values[key][0] if key == LOAD else 0.0
                shared.setdefault((key, of), []).append(number)
    return [(key, records) for (key, _), records in shared.items()]
