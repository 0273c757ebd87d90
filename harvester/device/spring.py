"""Springs: a restoring force F(x) and its energy U = ∫F, scaled: per mass and length unit.

A spring is a named tuple of numbers: `harvester.device.polynomial.Polynomial`,
`harvester.device.force_table.ForceTable`, or one of these within a range,
`harvester.device.ranged.Ranged`. Each has the same methods and properties. Compiled code calls
`force`, `energy` and `greatest_stiffness` by the functions of this module; formulas are expressions
of circuits and Verilog-A, whose argument `number` turns (name, value, meaning, range of Verilog-A)
into the text of a number.
"""

from __future__ import annotations

from harvester.device.dispatch import equation
from harvester.device.force_table import ForceTable
from harvester.device.polynomial import Polynomial
from harvester.device.ranged import Ranged

Spring = Polynomial | ForceTable | Ranged

# Functions of (spring, x): the force F(x), the energy U(x) = ∫F dx from 0, and a bound of |F'| at
# all displacements up to |x|. x is a float or, if called by Python, an array of any shape.
force = equation("force")
energy = equation("energy")
greatest_stiffness = equation("greatest_stiffness")
