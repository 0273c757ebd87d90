"""`harvester optimum`: where one parameter, or several, make power or efficiency largest."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from harvester.errors import HarvesterError
from harvester.files.plain_text import named
from harvester.signatures import Kind, RunnerOptions, Share

if TYPE_CHECKING:
    from harvester.calling import SceneOrName

Range = tuple[float | None, float | None]


def ranges_of(texts: list[str], option: str) -> dict[str, Range]:
    """Keys to ranges, from TABLE.KEY or TABLE.KEY=LOW:HIGH; ends that were not given are None."""
    over: dict[str, Range] = {}
    for text in texts:
        key, separator, ends = (part.strip() for part in text.partition("="))
        if key in over:
            raise HarvesterError(f"{option} {named(key)}: is there twice")
        over[key] = _ends(text, ends, option) if separator else (None, None)
    return over


def _ends(text, ends, option):
    try:
        low, high = (float(number) for number in ends.split(":"))
    except ValueError:
        raise HarvesterError(
            f"{option} {named(text)}: write it as TABLE.KEY=LOW:HIGH, such as "
            "load.resistance=1e4:1e7"
        ) from None
    return low, high


Ranges = Annotated[dict[str, Range], Kind("TABLE.KEY[=LOW:HIGH]", read=ranges_of, again=True)]


def optimum(
    scene: SceneOrName,
    over: Ranges,
    *,
    low: Annotated[float, Kind("A", option="from")] | None = None,
    high: Annotated[float, Kind("B", option="to")] | None = None,
    maximise: Annotated[str, Kind("QUANTITY")] = "power_conversion_efficiency",
    method: str | None = None,
    closure: str | None = None,
    evaluations: int | None = None,
    precision: Share | None = None,
    progress: Callable[[float, str], object] | None = None,
    **running: Unpack[RunnerOptions],
) -> Any:
    """Where one parameter, or several, make the efficiency or the power largest (Eq. 37).

    Parameters
    ----------
    scene : Scene, str or Path
    over : dict of str to (float, float)
        A number of the scene and its range (default: a tenth to ten times its value); may be given
        again.
    low : float or None
        Range of a single --over.
    high : float or None
        Its upper end.
    maximise : str
        power_conversion_efficiency, mean_power or mean_square_voltage; of a load with an output
        also mean_output_power and the like; over several parameters any.
    method : str or None
        monte-carlo or circuit, over several parameters also a closure (default: monte-carlo, or
        circuit where the load needs it).
    closure : str or None
        That stands beside simulation, over one parameter (default: the most accurate).
    evaluations : int or None
        Places proposed, over several parameters (default: 60 for each).
    precision : float or None
        Relative standard error of the value at the optimum of several parameters.
    """
    over = _with_ends(over, low, high)
    if len(over) > 1:
        from harvester.studies.optimum_of_several import optimum_of_several

        if closure is not None:
            raise HarvesterError("--closure: is for one parameter; over several use --method")
        return optimum_of_several(
            scene,
            over,
            maximise=maximise,
            method=method,
            evaluations=evaluations,
            precision=precision,
            progress=progress,
            **running,
        )
    from harvester.studies.optimum import optimum

    for option, value in (("evaluations", evaluations), ("precision", precision)):
        if value is not None:
            raise HarvesterError(f"--{option}: is for several parameters, a second --over")
    ((key, (lowest, highest)),) = over.items()
    return optimum(
        scene,
        key,
        low=lowest,
        high=highest,
        maximise=maximise,
        method=method or "monte-carlo",
        closure=closure,
        progress=progress,
        **running,
    )


def title_of(found: Any) -> str:
    """What stands over the table: the parameters."""
    axes = [each.axis for each in found.ranges] if hasattr(found, "ranges") else [found.axis]
    return f"optimum over {', '.join(axis.key for axis in axes)}"


def _with_ends(over, low, high):
    """The ranges with --from and --to, which are those of a single parameter."""
    if low is None and high is None:
        return over
    ((key, ends),) = list(over.items())[:1]
    if len(over) > 1 or ends != (None, None):
        raise HarvesterError(
            "--from and --to: are the range of a single --over TABLE.KEY; else write "
            "--over TABLE.KEY=LOW:HIGH"
        )
    return {key: (low, high)}
