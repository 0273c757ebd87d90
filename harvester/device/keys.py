"""Keys of a scene, each declared once as a field of its table's class.

    @table
    class Start(Table):
        velocity: float = key("velocity at the beginning", "m/s", default=0.0)

The declaration defines the check of a scene, its TOML and JSON, `--set`, the file of `harvester
new`, the JSON Schema of `harvester schema` and the list of keys in the docs.
"""

from __future__ import annotations

import math
from abc import ABCMeta
from collections.abc import Collection, Mapping
from dataclasses import FrozenInstanceError, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar, dataclass_transform

from harvester.base.arguments import no_attribute
from harvester.base.errors import SceneError
from harvester.base.numbers import NotANumber, is_real, number, on_quotes
from harvester.base.plain_text import named, nearest, shown

Declared = TypeVar("Declared", bound="Table")

SCALED, SI = "scaled", "SI"
BOTH = (SCALED, SI)
NAMED_VALUES = "named values"
# Products of a few numbers beyond these limits overflow or vanish.
SMALLEST, LARGEST = 1e-30, 1e30
# These units are the same in scaled scenes.
ALWAYS = ("s", "1/s", "Hz", "1")
READ_OR_BUILD = 'a scene is Scene.read("file.toml") or Scene.from_tables({"oscillator": {…}, …})'


@dataclass(frozen=True)
class Key:
    """Accepted values of a key: a number in a range, a text, a choice of words, a list, named
    values.

    Attributes
    ----------
    text
        Description of the key: a short name, a colon, details.
    unit, scaled
        Unit in SI; unit in scaled scenes.
    kind
        float, int, str, (str, int), `NAMED_VALUES` for a table of numbers or texts, or dict for a
        table with a `kind`.
    element, count
        For a list: meaning of a value, and the smallest and largest number of values.
    likely
        Plausible sizes of a real part, and factor and name of the unit that is often confused with
        the unit of the key.
    usual, asked
        Range of common devices (SI). `harvester new` asks for keys with `usual` or `asked`.
    default
        Value of an omitted key.
    rare, written
        A scene's file omits `rare` keys at their default. Keys not `written` are only in memory and
        JSON, not in the file, the schema or the docs.
    drawn
        Whether the value can be computed from a drawing.
    file
        Whether the name of a file is accepted.
    """

    text: str = ""
    unit: str = ""
    scaled: str = ""
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
    usual: tuple = ()
    asked: bool = False
    default: Any = None
    rare: bool = False
    written: bool = True
    drawn: bool = False
    file: bool = False

    @property
    def name(self) -> str:
        """A short name of the quantity."""
        return self.text.partition(":")[0]

    @property
    def is_number(self) -> bool:
        """Whether it is one real number."""
        return self.kind is float and not self.element

    def unit_in(self, units: str) -> str:
        """The unit in a scene with these `units`; empty if it is scaled."""
        return self.unit if units == SI or self.unit in ALWAYS else ""

    def allowed(self, units: str = SCALED) -> str:
        """The accepted values, in words, with their unit."""
        unit = self.unit_in(units)
        return self._allowed() + (f" ({unit})" if unit not in ("", "1") else "")

    def _allowed(self):
        if self.element:
            few, many = self.count
            count = few if few == many else f"{few} to {many}"
            return f"a list of {count}, each {self.element.allowed()}"
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
NUMBER, POSITIVE = Key(), Key(low=0.0, low_allowed=False)


class OneOf(NamedTuple):
    """Alternative keys of one property: a scene contains one of them.

    Attributes
    ----------
    keys
        If another key is given, the first is computed from it.
    needs
        Further keys, each with the keys of the group that it requires.
    required
        Whether one must be given.
    hint
        Appended to the message if keys of the group exclude each other.
    """

    keys: tuple[str, ...]
    needs: Mapping[str, tuple[str, ...]] = {}
    required: bool = True
    hint: str = ""

    def replaced_by(self, name: str) -> set[str]:
        """Keys that are removed when this key is set."""
        others = {other for other, needed in self.needs.items() if name not in needed}
        return ({*self.keys} | others) - {name} if name in self.keys else set()


def key(text: str, unit: str = "", scaled: str = "", **more: Any) -> Any:
    """A field of a table: see `Key`. Without `default`, an omitted key is None."""
    declared = Key(text, unit, scaled, **more)
    return field(default=declared.default, metadata={"key": declared})


def positive(text: str, unit: str = "", scaled: str = "", **more: Any) -> Any:
    """A field for a number > 0."""
    return key(text, unit, scaled, low=0.0, low_allowed=False, **more)


def not_negative(text: str, unit: str = "", scaled: str = "", **more: Any) -> Any:
    """A field for a number ≥ 0."""
    return key(text, unit, scaled, low=0.0, **more)


def word(text: str, words: Collection[str], **more: Any) -> Any:
    """A field for a choice of words."""
    return key(text, kind=str, words=words, **more)


class TableType(ABCMeta):
    """Metaclass of tables: errors on a class name the two functions that create a scene."""

    if not TYPE_CHECKING:

        def __call__(cls, *values, **named_values):
            try:
                return super().__call__(*values, **named_values)
            except TypeError as error:
                raise SceneError(f"{cls.__name__}(…): {error}; {READ_OR_BUILD}") from None

        def __getattr__(cls, name):
            # The dataclass decorator looks up such names.
            private = name.startswith("_")
            hint = "" if private else nearest(name, [key for key in dir(cls) if key[0] != "_"])
            raise AttributeError(f"{cls.__name__} has no {name}{hint}; {READ_OR_BUILD}")


class Table(metaclass=TableType):
    """Base of the classes of tables; `table` fills `KEYS`.

    Attributes
    ----------
    NAME
        Name of the table in a scene; None: the class's name in lower case.
    KEYS
        Keys that the table may hold.
    UNITS
        Units of scenes that may have the table; empty: each key decides.
    ALTERNATIVES
        Groups of alternative keys.
    """

    NAME: ClassVar[str | None] = None
    KEYS: ClassVar[dict[str, Key]] = {}
    UNITS: ClassVar[tuple[str, ...]] = ()
    ALTERNATIVES: ClassVar[tuple[OneOf, ...]] = ()

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            raise no_attribute(f"{type(self).__name__}: no", name, self.__dataclass_fields__)


@dataclass_transform(frozen_default=True)
def table(cls: type[Declared]) -> type[Declared]:
    """Make a frozen dataclass of a table whose fields are declared by `key` and the like.

    An assignment raises an error that names `Scene.replace`.
    """
    table_name = cls.__name__.removesuffix("Table").lower() if cls.NAME is None else cls.NAME
    prefix = f"{table_name}." if table_name else ""

    def refuse(self: object, name: str, value: object) -> None:
        raise FrozenInstanceError(
            f"cannot assign to {name}: a scene is frozen; to copy it with another value, use "
            f'scene.replace({{"{prefix}{name}": {value!r}}})'
        )

    frozen: Any = dataclass(frozen=True)(cls)
    frozen.__setattr__ = refuse
    keys = {n: f.metadata["key"] for n, f in frozen.__dataclass_fields__.items() if f.metadata}
    frozen.KEYS = {n: replace(spec, units=cls.UNITS or spec.units) for n, spec in keys.items()}
    return frozen


def class_of(tables: Any, values: Mapping[str, Any]) -> Any:
    """The class of a table, by its `kind`; the first class is the default."""
    if not isinstance(tables, Mapping):
        return tables
    kind = values.get("kind", next(iter(tables)))
    return tables[kind] if is_word(kind, tables) else None


def every_key(tables: Any) -> dict[str, Key]:
    """Keys of a table's class, or of all its classes by `kind`."""
    if not isinstance(tables, Mapping):
        return tables.KEYS
    merged = {"kind": Key("kind", kind=str, words=tables)}
    for cls in tables.values():
        merged = cls.KEYS | merged
    return merged


def computed(part: Any) -> list[str]:
    """Names of a table's values that were computed from an alternative key."""
    groups = (group.keys for group in part.ALTERNATIVES)
    return [first for first, *others in groups if any(getattr(part, n) for n in others)]


def check_value(where: str, value: Any, spec: Key, origin: str, units: str = SCALED) -> Any:
    """The value of one key, numbers as float or int.

    Raises SceneError if the key does not accept it.
    """

    def refuse(reason=""):
        hint = nearest(value, spec.words) if isinstance(value, str) else ""
        raise SceneError(
            f"{origin}: {where} = {shown(value)}: must be {spec.allowed(units)}{hint}{reason}"
        ) from None

    if spec.element:
        few, many = spec.count
        if not isinstance(value, (list, tuple)) or not few <= len(value) <= many:
            refuse()
        return tuple(
            check_value(f"{where}[{index}]", part, spec.element, origin)
            for index, part in enumerate(value)
        )
    if spec.kind is NAMED_VALUES:
        return NamedValues(value) if isinstance(value, dict) and _named_values(value) else refuse()
    if spec.words:
        return value if is_word(value, spec.words) else refuse()
    if spec.kind in _NOUNS:
        fits = isinstance(value, spec.kind) and value is not True and value is not False
        return value if fits else refuse()
    # A quoted number must have a suffix; otherwise the quotes are a mistake.
    if (
        isinstance(value, str)
        and spec.kind is float
        and (value[-1:].isalpha() or value.endswith("%"))
    ):
        try:
            value = number(value, spec.unit)
        except NotANumber as reason:
            refuse(f": {reason}")
    if not is_real(value):
        refuse(on_quotes(value))
    if spec.kind is int and not isinstance(value, int):
        refuse()
    too_low = value < spec.low or (value == spec.low and not spec.low_allowed)
    if not value <= spec.high or too_low:
        refuse()
    if spec.kind is float and value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
        refuse(f", and within the range of computation, {SMALLEST:g} to {LARGEST:g}")
    if spec.likely and value and not spec.likely[0] <= abs(value) <= spec.likely[1]:
        least, most, factor, unit = spec.likely
        meant = value * factor
        reading = f"; {value:g} {unit} is {meant:g}" if least <= abs(meant) <= most else ""
        raise SceneError(
            f"{origin}: {where} = {shown(value)}: no real part has this size; sizes are {least:g} "
            f"to {most:g}{spec.unit and ' '}{spec.unit}{reading}"
        )
    return spec.kind(value)


def check_table(where: str, values: dict[str, Any], tables: Any, units: str, origin: str) -> Any:
    """Check each value of a scene's table by its key and return the table.

    `tables`: the table's class, or classes by the table's `kind`. Raises SceneError for an unknown,
    missing or misplaced key, a wrong type or a value out of range.
    """
    prefix = f"{where}." if where else ""
    keys = {}
    if isinstance(tables, Mapping):
        keys["kind"] = Key(kind=str, words=tables)
        kind = values.get("kind", next(iter(tables)))
        check_value(f"{prefix}kind", kind, keys["kind"], origin)
    cls = class_of(tables, values)
    keys |= cls.KEYS
    usable = {name: spec for name, spec in keys.items() if units in spec.units}
    checked = {}
    for name, value in values.items():
        if name not in keys:
            names = [key for key, spec in usable.items() if spec.written]
            hint = nearest(name, names) or f"; there are {', '.join(names)}"
            raise SceneError(f"{origin}: unknown key {prefix}{named(name)}{hint}")
        spec = keys[name]
        if name not in usable:
            raise SceneError(
                f'{origin}: {prefix}{name} belongs to scenes with units = "{spec.units[0]}", '
                f'and this one has "{units}": remove the key'
            )
        checked[name] = check_value(f"{prefix}{name}", value, spec, origin, units)
        if spec.element and spec.element.kind is dict:
            checked[name] = tuple(
                check_table(f"{prefix}{name}[{index}]", part, tables, units, origin)
                for index, part in enumerate(checked[name])
            )
    for name, spec in usable.items():
        if spec.required and name not in checked:
            raise SceneError(f"{origin}: {prefix}{name} is missing; it takes {spec.allowed(units)}")
    for group in cls.ALTERNATIVES:
        fitting = [name for name in group.keys if name in usable]
        present = [prefix + name for name in fitting if name in checked]
        if len(present) > 1:
            twice = " and ".join(present[:2])
            raise SceneError(f"{origin}: {twice} exclude each other; keep one{group.hint}")
        if group.required and not present:
            first, *others = (prefix + name for name in fitting)
            instead = f", or give {' or '.join(others)}" if others else ""
            takes = usable[fitting[0]].allowed(units)
            raise SceneError(f"{origin}: {first} is missing; it takes {takes}{instead}")
        for name, needed in group.needs.items():
            if name in checked and not {*needed} & {*checked}:
                listed = " or ".join(prefix + other for other in needed if other in usable)
                others = [other for other in present if other != prefix + name]
                but = "".join(f", and there is {other}: take one out" for other in others)
                raise SceneError(f"{origin}: {prefix}{name} needs {listed}{but}{group.hint}")
    return cls(**checked)


class NamedValues(dict):
    """An immutable, hashable dictionary, equal to any with the same names and values.

    >>> {NamedValues(resistance=1e5): "a load"}[NamedValues({"resistance": 1e5})]
    'a load'
    """

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return NamedValues, (dict(self),)

    def _refuse(self, *_, **__):
        raise TypeError("these values are fixed: make a changed copy, dict(values)")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse


def is_word(value: object, words: Collection[str]) -> bool:
    """Whether a value is one of the allowed words."""
    # A numpy array would be compared element by element.
    return isinstance(value, str) and value in words


def _named_values(values):
    """Whether all values are numbers of limited size, or texts."""
    return all(
        isinstance(v, str)
        or (isinstance(v, (int, float)) and not isinstance(v, bool) and not abs(v) > LARGEST)
        for v in values.values()
    )
