"""Named errors: each message is one line with the fault, its location and the remedy."""

from __future__ import annotations

from typing import Any


class HarvesterError(Exception):
    """Base of every error that a user can cause or should see.

    `exit_code` is the exit code of a command that the error ends.
    """

    exit_code = 2


class SceneError(HarvesterError):
    """A scene file or an override is not usable."""


class UnknownOption(HarvesterError, TypeError):
    """A function is called with an option that it does not have."""


class UnknownQuantity(HarvesterError, KeyError):
    """A result has no quantity of this name."""

    def __str__(self) -> str:
        return HarvesterError.__str__(self)


class EngineNotFound(HarvesterError):
    """The ngspice library is missing or cannot be loaded."""

    exit_code = 1


class CompiledDeviceUnavailable(HarvesterError):
    """The compiled device cannot be used here; everything works without it, more slowly."""


class NetlistError(HarvesterError):
    """A netlist or a behavioural expression was rejected before it reached ngspice."""


class LoadError(HarvesterError):
    """A method cannot simulate this load."""


class ExportError(HarvesterError):
    """A scene cannot be written in the requested format."""


class OutputError(HarvesterError):
    """A result cannot be written where the user asked for it."""


class FolderInUse(OutputError):
    """Another run uses the study's folder."""


class AveragingError(HarvesterError):
    """A stationary method is not valid for these parameters."""


class OptimumError(HarvesterError):
    """There is no maximum inside the range, or it does not exceed the noise."""


class IdentificationError(HarvesterError):
    """The measured records do not determine the requested values."""


class SimulationError(HarvesterError):
    """A simulation failed or was stopped before its end.

    Attributes
    ----------
    partial : harvester.results.result.Result or None
        The result of the run up to then; within a worker, its moments.
    """

    exit_code = 1

    def __init__(self, message: str, partial: Any = None) -> None:
        super().__init__(message)
        self.partial = partial

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.partial)


class SimulatorCrashed(SimulationError):
    """The simulator's process crashed or was killed."""


class SimulatorTimeout(SimulationError):
    """The wall-clock limit was reached."""


class SimulatorAborted(SimulationError):
    """The simulator stopped with an error message."""


class NotConverged(SimulatorAborted):
    """Newton's iterations failed at the shortest step; other ngspice options may help."""


class LoadChatters(SimulatorAborted):
    """A part of the load toggles endlessly; the load's file must be changed."""

    exit_code = 2


class SolutionDiverged(SimulationError):
    """The solution contains values that are not finite, or ends before the end time."""


class SpringRangeLeft(SimulationError):
    """The mass left the range of the scene's spring."""


class EnergyNotBalanced(SimulationError):
    """The energy balance does not close: the step is too long for this scene."""


class OutOfTime(SimulationError):
    """The time budget was spent before there was a result; finished answers are stored."""


class MissingLibrary(HarvesterError):
    """A required optional library is not installed."""


class ProgramNotFound(HarvesterError):
    """A required external program is not installed."""
