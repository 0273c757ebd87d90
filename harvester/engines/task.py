"""Tasks: function calls whose answers are stored under a hash of all inputs."""

import dataclasses
import hashlib
import json
import time
import traceback
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from harvester.base.errors import (
    CompiledDeviceUnavailable,
    EngineNotFound,
    HarvesterError,
    MissingLibrary,
    SimulationError,
)
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.version import __version__

# Version of the stored answers. Raising it makes all older ones invalid.
FORMAT = 5
# These errors would recur in every task, so they end the study.
OF_THE_MACHINE = (EngineNotFound, CompiledDeviceUnavailable, MissingLibrary)


@dataclasses.dataclass(frozen=True)
class Task:
    """A call whose answer depends only on its arguments.

    Attributes
    ----------
    function
        Function of a module; called in a worker process as function(report=…, **arguments); it
        reports a share of 0 … 1 or the moments of its realizations so far; returns
        values that `harvester.engines.codec` supports, and raises a HarvesterError if it fails.
    arguments
        Scenes, numbers, strings, None, and lists, tuples and dictionaries of these. The function's
        parameter for `scene` is `prepared_scene`, since the worker prepares it.
    version
        Version of the computing program, besides this package.
    label
        Tasks of one label take about equal times: for the estimate of the remaining time.
    time_limits
        Wall-clock limit, in multiples of the runner's limit.
    misfit
        Function of a stored answer; returns why it does not fit this task, "" if it does.
    """

    function: Callable
    arguments: dict[str, Any]
    version: str = ""
    label: str = ""
    time_limits: int = 1
    misfit: Callable[[Any], str] | None = None

    @cached_property
    def key(self) -> str:
        """SHA-256 of all inputs of the answer: equal tasks are computed once."""
        content = [
            FORMAT,
            f"{self.function.__module__}.{self.function.__qualname__}",
            _plain(self.arguments),
            f"harvester {__version__}, {self.version}",
        ]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


class Wanted(NamedTuple):
    """Tasks whose answers a plan needs: the plan yields this and is sent the answers.

    `ahead` is the approximate number of further tasks: for the estimate of the remaining time.
    """

    tasks: Sequence[Task]
    ahead: float = 0.0


def compute(function: Callable, arguments: dict[str, Any], report: Callable) -> tuple[Any, float]:
    """Compute a task in a worker process: (its answer or its error, seconds)."""
    clock = time.perf_counter()
    try:
        if "scene" in arguments:
            arguments = {**arguments, "prepared_scene": prepared(arguments["scene"])}
            del arguments["scene"]
        answer = function(report=lambda latest: report(_share(latest)), **arguments)
    except OF_THE_MACHINE:
        raise
    except HarvesterError as error:
        answer = error
        if isinstance(error, SimulationError):
            error.partial = None
    except Exception as error:
        if not isinstance(error, (MemoryError, OSError)):
            traceback.print_exception(error)
        answer = SimulationError(f"{type(error).__name__}: {error}")
    return answer, time.perf_counter() - clock


def _share(latest):
    """Finished share of a task, from its latest report: moments of realizations, or the share."""
    if not isinstance(latest, list):
        return float(latest)
    shares = [m.time_reached / (m.start + m.batch_length * len(m.integrals)) for m in latest]
    return float(np.nan_to_num(shares).mean()) if shares else 0.0


def _plain(value):
    """A task's argument as JSON; different arguments give different JSON."""
    if isinstance(value, Scene):
        return {"scene": value.digest()}
    if isinstance(value, dict):
        return {"dict": sorted([str(key), _plain(item)] for key, item in value.items())}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{type(value).__name__} cannot be an argument of a task")
