"""`harvester beam`: the lumped values of a drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harvester.base.errors import SceneError
from harvester.scene.calling import takes_scene

if TYPE_CHECKING:
    from harvester.results.beam_values import BeamValues
    from harvester.scene.model import Scene


@takes_scene
def beam(scene: Scene) -> BeamValues:
    """Show the lumped values of a scene's drawing: mass, spring, coupling, capacitance,
    frequencies.

    Parameters
    ----------
    scene : Scene
        A scene with the table [beam].

    Examples
    --------
    ::

        harvester beam bimorph --output results
    """
    if scene.beam is None:
        raise SceneError(
            f"{scene.name}: no table [beam]; add one as in docs/how-to/drawing.md, or try "
            "harvester beam bimorph"
        )
    from harvester.results.beam_values import BeamValues

    return BeamValues(scene, scene.beam)
