"""Keys of a scene: the kind, range and units of the values that each accepts, and their check."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import FrozenInstanceError, dataclass
from typing import Any, TypeVar

from harvester.base.errors import SceneError
from harvester.base.numbers import NotANumber, number
from harvester.base.plain_text import nearest, shown

Table = TypeVar("Table")

SCALED, SI = "scaled", "SI"
BOTH = (SCALED, SI)
NAMED_VALUES = "named values"
# Products of a few numbers beyond these limits overflow or vanish.
SMALLEST, LARGEST = 1e-30, 1e30


def names_replace(table: type[Table]) -> type[Table]:
    """Let the refusal of an assignment to a frozen table name `Scene.replace`."""

    def refuse(self: object, name: str, value: object) -> None:
        raise FrozenInstanceError(
            f"cannot assign to {name}: a scene is frozen; its copy with another value is "
            f'scene.replace({{"TABLE.{name}": {value!r}}})'
        )

    table.__setattr__ = refuse  # type: ignore[method-assign]
    return table


@dataclass(frozen=True)
class Key:
    """Values that one key accepts: a number in a range, a text, one of a few words, a list, named
    values.

    `kind` is float, int, str, (str, int), `NAMED_VALUES` for a table of numbers or texts, or dict
    for a table with a `kind` of its own. With `element`, a list of `count` (fewest, most) values of
    that kind. `likely` is the range of sizes that a part can have, with the unit that is often
    given in place of the key's: its factor and name.
    """

    kind: Any = float
    low: float = -math.inf
    high: float = math.inf
    low_allowed: bool = True
    words: Collection[str] = ()
    units: tuple = BOTH
    required: bool = False
    element: Key | None = None
    count: tuple = (0, 0)
    likely: tuple[float, float, float, str] | None = None

    def allowed(self) -> str:
        """The accepted values, in words."""
        if self.element:
            few, many = self.count
            number = few if few == many else f"{few} to {many}"
            return f"a list of {number}, each {self.element.allowed()}"
        if self.words:
            return "one of " + ", ".join(f'"{word}"' for word in self.words)
        if self.kind in _NOUNS:
            return _NOUNS[self.kind]
        noun = "a whole number" if self.kind is int else "a number"
        if self.low == -math.inf:
            return noun
        if self.high == math.inf:
            return f"{noun} {'≥' if self.low_allowed else '>'} {self.low:g}"
        return f"{noun} in {'[' if self.low_allowed else '('}{self.low:g}, {self.high:g}]"


_NOUNS = {
    str: "a text",
    (str, int): "a name or a whole number ≥ 0",
    dict: "a table",
    NAMED_VALUES: 'a table of numbers, or of texts like "100k"',
}


def positive(**more: Any) -> Key:
    """A key for a number > 0."""
    return Key(low=0.0, low_allowed=False, **more)


def not_negative(**more: Any) -> Key:
    """A key for a number ≥ 0."""
    return Key(low=0.0, **more)


def check_value(where: str, value: Any, spec: Key, origin: str) -> Any:
    """The value of one key, numbers as float or int.

    Raises SceneError if it is not what the key accepts.
    """

    def refuse():
        hint = nearest(value, spec.words) if isinstance(value, str) else ""
        raise SceneError(f"{origin}: {where} = {shown(value)}: must be {spec.allowed()}{hint}")

    if spec.element:
        few, many = spec.count
        if not isinstance(value, (list, tuple)) or not few <= len(value) <= many:
            refuse()
        return tuple(
            check_value(f"{where}[{index}]", part, spec.element, origin)
            for index, part in enumerate(value)
        )
    if spec.kind is NAMED_VALUES:
        return dict(value) if isinstance(value, dict) and _named_values(value) else refuse()
    if spec.words:
        return value if is_word(value, spec.words) else refuse()
    if spec.kind in _NOUNS:
        fits = isinstance(value, spec.kind) and value is not True and value is not False
        return value if fits else refuse()
    # A number in quotes must have a suffix; without one the quotes are a mistake.
    if isinstance(value, str) and spec.kind is float and value[-1:].isalpha():
        try:
            value = number(value)
        except NotANumber as reason:
            raise SceneError(
                f"{origin}: {where} = {shown(value)}: must be {spec.allowed()}: {reason}"
            ) from None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        refuse()
    if spec.kind is int and not isinstance(value, int):
        refuse()
    too_low = value < spec.low or (value == spec.low and not spec.low_allowed)
    if not value <= spec.high or too_low:
        refuse()
    if spec.kind is float and value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
        raise SceneError(
            f"{origin}: {where} = {shown(value)}: must be {spec.allowed()}, and of a size that "
            f"can be computed with: {SMALLEST:g} to {LARGEST:g}"
        )
    if spec.likely and value and not spec.likely[0] <= abs(value) <= spec.likely[1]:
        least, most, factor, unit = spec.likely
        meant = value * factor
        reading = f"; {value:g} {unit} is {meant:g}" if least <= abs(meant) <= most else ""
        raise SceneError(
            f"{origin}: {where} = {shown(value)}: no part has such a size: {least:g} to "
            f"{most:g}{reading}"
        )
    return spec.kind(value)


def is_word(value: object, words: Collection[str]) -> bool:
    """Whether a value is one of the allowed words."""
    # An array of numpy is compared item by item.
    return isinstance(value, str) and value in words


def _named_values(table):
    """Whether all values are numbers of a sane size, or texts; the load refuses others of them."""
    return all(
        isinstance(v, str)
        or (isinstance(v, (int, float)) and not isinstance(v, bool) and not abs(v) > LARGEST)
        for v in table.values()
    )
