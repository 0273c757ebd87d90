"""The circuit, as the rest of the program reaches it: the one door to the package `circuits`.

`circuits` is imported when something is asked of it, so that what needs no SPICE loads none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from circuits.assembly import Netlist
    from circuits.schematic.drawing import Schematic
    from harvester.calling import SceneOrName
    from harvester.scene.model import Scene


def prepare(scene: Scene) -> None:
    """Load ngspice and the compiled code that a scene needs."""
    from circuits.ngspice import engine

    engine.prepare(scene)


def run_realizations(*arguments: Any, **options: Any) -> dict[str, str]:
    """See `circuits.ngspice.engine.run_realizations`."""
    from circuits.ngspice import engine

    return engine.run_realizations(*arguments, **options)


def check_compiled(scene: Scene) -> None:
    """Refuse a load that holds what the compiled one does not take.

    Raises
    ------
    LoadError
    """
    from circuits.kernel import engine

    engine.circuit_of(scene)


def prepare_compiled(scene: Scene) -> None:
    """Load the compiled code that a scene with a netlist as load needs."""
    from circuits.kernel import engine

    engine.prepare(scene)


def run_compiled(*arguments: Any, **options: Any) -> dict[str, str | None]:
    """See `circuits.kernel.engine.run_realizations`."""
    from circuits.kernel import engine

    return engine.run_realizations(*arguments, **options)


def relaxation(scene: Scene, levels: dict[str, float]) -> Any:
    """See `circuits.kernel.slow_modes.relaxation`."""
    from circuits.kernel import slow_modes

    return slow_modes.relaxation(scene, levels)


def times_of(matrix: Any, held: Any) -> Any:
    """See `circuits.kernel.slow_modes.times_of`."""
    from circuits.kernel import slow_modes

    return slow_modes.times_of(matrix, held)


def weights(store: Any, levels: list[str]) -> Any:
    """See `circuits.kernel.slow_modes.weights`."""
    from circuits.kernel import slow_modes

    return slow_modes.weights(store, levels)


def slowest_time(scene: Scene) -> float:
    """See `circuits.kernel.slow_modes.slowest_time`."""
    from circuits.kernel import slow_modes

    return slow_modes.slowest_time(scene)


def device_used(scene: Scene, device: str, report: Callable) -> str:
    """What a device asked for comes to: "compiled" or "behavioural"; called in a worker."""
    from circuits.ngspice import engine

    return engine.device_used(scene, device, report)


def describe(report: Callable) -> dict[str, Any]:
    """What ngspice was found, as a dictionary; called in a worker."""
    from circuits.ngspice import engine

    return engine.describe(report)


def read_load(
    name: str, folders: Sequence[str], subcircuit: str | None, parameters: dict[str, Any] | None
) -> Any:
    """A load's netlist, vetted: `circuits.loads.subcircuits.LoadCircuit`.

    Parameters
    ----------
    name : str
        In netlists/, or a path.
    folders : sequence of str
        Where it is looked for, in order.
    subcircuit : str or None
        The one meant of its file.
    parameters : dict or None
        Its values.

    Raises
    ------
    NetlistError
    """
    from circuits.loads.subcircuits import find_netlist, read_load

    return read_load(find_netlist(name, folders), subcircuit, parameters)


def netlist_of(scene: Scene) -> Any:
    """The netlist that a scene builds, `circuits.assembly.Netlist`."""
    from circuits.assembly import assemble

    return assemble(scene)


def stand_alone(*arguments: Any, **options: Any) -> Netlist:
    """See `circuits.export.stand_alone`."""
    from circuits.export import stand_alone as write

    return write(*arguments, **options)


def for_ltspice(*arguments: Any, **options: Any) -> tuple[str, str]:
    """See `circuits.export.for_ltspice`."""
    from circuits.export import for_ltspice as write

    return write(*arguments, **options)


def schematic(scene: SceneOrName) -> Schematic:
    """The circuit that a scene builds, as a drawing.

    Parameters
    ----------
    scene : Scene, str or Path
        Itself, its file or its built-in name.

    Returns
    -------
    circuits.schematic.drawing.Schematic
        A notebook shows it; `save(path)` writes it as SVG or PNG.

    Raises
    ------
    MissingLibrary
        schemdraw, of the extra `schematic`.
    """
    from circuits.schematic.drawing import schematic as draw
    from harvester.calling import scene_of

    return draw(scene_of(scene))
