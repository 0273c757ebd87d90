"""Base class of all methods (engines and stationary methods), whose fields are settings."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Self

from harvester.base.arguments import check_known
from harvester.base.errors import HarvesterError, UnknownOption
from harvester.base.plain_text import shown


@dataclass(frozen=True)
class Method(ABC):
    """A method of computing results: an engine (simulation) or a stationary method (without).

    Every field is a setting with a default. A name, such as "circuit", is short for the object with
    its defaults.
    """

    def __new__(cls, *settings: Any, **named: Any) -> Self:
        from harvester.base.signatures import check_options

        names = [field.name for field in fields(cls)]
        hint = f"{cls.__name__} (scene.replace sets run.seed, run.realizations and other keys)"
        check_known(hint, named, names)
        if len(settings) > len(names):
            raise UnknownOption(f"{cls.__name__}: has {len(names)} settings; name them")
        check_options(cls.__init__, {**dict(zip(names, settings, strict=False)), **named})
        return super().__new__(cls)

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the method in calls, results and files."""

    @property
    def settings(self) -> dict[str, Any]:
        """The fields that differ from their defaults."""
        values = {field.name: (getattr(self, field.name), field.default) for field in fields(self)}
        return {name: value for name, (value, default) in values.items() if value != default}

    @property
    def label(self) -> str:
        """The name of the method, with the settings that differ from their defaults."""
        settings = ", ".join(f"{name} {value}" for name, value in self.settings.items())
        return f"{self.name} ({settings})" if settings else self.name

    def __str__(self) -> str:
        return self.label

    def as_arguments(self, key: str) -> dict[str, Any]:
        """An engine as plain arguments of a task, which are part of the task's key.

        Parameters
        ----------
        key : str
            Key of the engine's name. `step` has a separate key; other settings
            are included if they differ from their defaults.
        """
        settings = self.settings
        step = settings.pop("step", "default")
        return {key: self.name, "step": step, **({"settings": settings} if settings else {})}

    def with_options(self, options: Mapping[str, Any]) -> Self:
        """This method with a call's options; options that it does not have are ignored.

        Parameters
        ----------
        options : mapping of str to object
            None means that the option is omitted.
        """
        names = {field.name for field in fields(self)}
        stated = {name: value for name, value in options.items() if value is not None}
        return replace(self, **{name: value for name, value in stated.items() if name in names})

    def check_options_agree(self, options: Mapping[str, Any], defaults: Mapping[str, Any]) -> Self:
        """Check that a call's options do not contradict this method object.

        Raises
        ------
        HarvesterError
            An option contradicts the object.
        """
        for name, value in options.items():
            if value is None or value == defaults.get(name):
                continue
            if not hasattr(self, name) or getattr(self, name) != value:
                raise HarvesterError(
                    f"{name} = {shown(value)}: not allowed with a method given as an object; "
                    f"write {type(self).__name__}({name}=…), if it has this setting"
                )
            message = f"{name}= is given twice, as an option and in {type(self).__name__}"
            warnings.warn(message, DeprecationWarning, stacklevel=5)
        return self
