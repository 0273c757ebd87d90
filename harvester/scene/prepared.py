"""A prepared scene: the scaled device and all else that engines and studies derive from a
scene, computed once."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from harvester.device import timescales
from harvester.scene.units import Scales, excitation_unit, scale, setting

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.device.terminals import Network, Setting
    from harvester.scene.model import Scene

# Number of prepared scenes in the cache: a study's workers alternate between its points.
KEPT = 64


@dataclass(frozen=True)
class Prepared:
    """A scene together with its scaled device and scales.

    Attributes
    ----------
    scene
        The scene as the caller gave it.
    system
        The device in scaled form (Eqs. 3–6).
    scales
        Factors from scaled values to the scene's units.
    setting
        Mass, length unit and load, which the transducer's equations need.
    excitation_unit
        The base's acceleration for one unit of η, in the scene's units.
    """

    scene: Scene
    system: System = field(compare=False)
    scales: Scales = field(compare=False)
    setting: Setting = field(compare=False)
    excitation_unit: float = field(compare=False)

    @cached_property
    def network(self) -> Network:
        """The transducer as elements, from its terminal to the mass."""
        rate = timescales.angular_frequency(self.system)
        return self.scene.transducer.network(self.setting, self.system.transducer, rate)

    def replace(self, changes: dict[str, Any] | None = None, /, **parts: Any) -> Prepared:
        """Return a prepared scene with changed values, as `Scene.replace` does."""
        scene = self.scene.replace(changes) if changes else self.scene
        return prepared(replace(scene, **parts))

    def with_run(self, **changes: Any) -> Prepared:
        """Return a copy with changed values of [run], on which only `scene` depends."""
        return replace(self, scene=replace(self.scene, run=replace(self.scene.run, **changes)))


@functools.lru_cache(maxsize=KEPT)
def prepared(scene: Scene) -> Prepared:
    """Return the prepared scene, from a cache if it was prepared before."""
    system, scales = scale(scene)
    unit = excitation_unit(scene, scales.displacement)
    return Prepared(scene, system, scales, setting(scene), unit)
