"""What the equations of a device take and give: a float, or an array of any shape."""

from typing import Any, TypeAlias

# The same of both, which no type checker can say of compiled functions.
Values: TypeAlias = Any
