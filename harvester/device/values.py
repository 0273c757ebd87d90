"""Type of the numbers in a device's equations: a float, or an array of any shape."""

from typing import Any, TypeAlias

# A float or an array; the result is of the same kind. No type checker can express this for compiled
# functions.
Values: TypeAlias = Any
