"""The lumped values of a beam drawing, as a result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from harvester.base.formatting import quantity, written
from harvester.device import timescales
from harvester.device.beam.lumped import Beam
from harvester.device.beam.summary import draw, remarks, rows
from harvester.device.system import potential
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.described import device_line
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

COLUMNS = ("quantity", "equation", "value", "unit")


@dataclass(frozen=True, repr=False)
class BeamValues(ResultBase):
    """The lumped values of a scene's beam, as a result that can be printed and written."""

    scene: Scene
    beam: Beam

    def view(self) -> View:
        """The lumped values, with pictures of the side view, the first mode and the magnets'
        spring.
        """
        return View(
            self._table(),
            self._findings(),
            pictures=[Picture(lambda beam: draw(beam, self.scene.magnets), self.beam)],
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        return [*COLUMNS], [
            [name, equation, written(value, ".5g", unit), unit]
            for name, equation, value, unit in rows(self.beam)
        ]

    def _findings(self) -> list[str]:
        """Sentences on the device with its magnets, and on limits of the theory's validity."""
        return [*self._with_magnets(), *remarks(self.beam, self.scene.magnets)]

    def _with_magnets(self):
        """Sentences on the device with magnets: rest positions, barriers and frequency."""
        if self.scene.magnets is None:
            return []
        model = prepared(self.scene)
        system, length = model.system, model.scales.displacement
        wells, saddles = timescales.wells(system), timescales.saddles(system)
        positions = ", ".join(quantity(length * well, "m") for well in sorted(wells))
        sentences = [
            "the table is of the beam without its magnets",
            *(line.replace("device:", "with magnets:", 1) for line in device_line(self.scene)),
            f"with magnets the tip rests at {positions}",
        ]
        if saddles:
            depths = [float(potential(system, well)) for well in wells]
            heights = [float(potential(system, saddle)) for saddle in saddles]
            mass: Any = self.scene.oscillator.mass
            barrier = quantity(mass * length**2 * (max(heights) - min(depths)), "J")
            sentences[-1] += f"; the highest barrier is {barrier} above the deepest well"
        return sentences

    def to_dict(self) -> dict[str, Any]:
        values = [dict(zip(COLUMNS, row, strict=True)) for row in rows(self.beam)]
        return {"scene": self.scene.to_dict(), "values": values, "notes": self._findings()}
