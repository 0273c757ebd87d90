"""Circuit-accurate simulation of vibration energy harvesters under coloured noise.

>>> import harvester
>>> scene = harvester.Scene.load("paper").replace({"excitation.intensity": 0.05})
>>> scene.excitation.intensity
0.05

Functions take a scene, its file or its built-in name, and everything else by keyword:
`harvester.simulate("paper", method="circuit")`, `harvester.average("paper")`,
`harvester.validate("paper")`. A method is a name or an object with its settings:
`harvester.Circuit(step="fine")`, `MonteCarlo(…)`, `Stationary(…)`. They return results with error
bars; see their help.
"""

import importlib
import os
import sys

import circuits
from harvester.version import __version__

if getattr(circuits, "PROJECT", None) != "vibration-harvester":
    _FOREIGN = (
        f"the package circuits in {circuits.__file__} belongs to another project: "
        "install harvester into an environment of its own"
    )
    if os.path.basename(sys.argv[0]) == "harvester":
        # The command's first import: nothing above it could turn an exception into a line.
        print(f"harvester: {_FOREIGN}", file=sys.stderr)
        raise SystemExit(2)
    raise ImportError(_FOREIGN)

# Type checkers take this for `typing.TYPE_CHECKING`. A worker process cannot import `typing` yet:
# see `harvester.workers.isolation`.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from circuits.schematic.drawing import schematic as schematic
    from harvester.averaging.method import Stationary as Stationary
    from harvester.averaging.of_scene import average as average
    from harvester.errors import AveragingError as AveragingError
    from harvester.errors import CompiledDeviceUnavailable as CompiledDeviceUnavailable
    from harvester.errors import EnergyNotBalanced as EnergyNotBalanced
    from harvester.errors import EngineNotFound as EngineNotFound
    from harvester.errors import ExportError as ExportError
    from harvester.errors import FolderInUse as FolderInUse
    from harvester.errors import HarvesterError as HarvesterError
    from harvester.errors import IdentificationError as IdentificationError
    from harvester.errors import LoadChatters as LoadChatters
    from harvester.errors import LoadError as LoadError
    from harvester.errors import MissingLibrary as MissingLibrary
    from harvester.errors import NetlistError as NetlistError
    from harvester.errors import OptimumError as OptimumError
    from harvester.errors import OutOfTime as OutOfTime
    from harvester.errors import OutputError as OutputError
    from harvester.errors import ProgramNotFound as ProgramNotFound
    from harvester.errors import SceneError as SceneError
    from harvester.errors import SimulationError as SimulationError
    from harvester.errors import SimulatorAborted as SimulatorAborted
    from harvester.errors import SimulatorCrashed as SimulatorCrashed
    from harvester.errors import SimulatorTimeout as SimulatorTimeout
    from harvester.errors import SolutionDiverged as SolutionDiverged
    from harvester.errors import SpringRangeLeft as SpringRangeLeft
    from harvester.errors import UnknownOption as UnknownOption
    from harvester.errors import UnknownQuantity as UnknownQuantity
    from harvester.explorer.explorer import explore as explore
    from harvester.export.coupled import coupled as coupled
    from harvester.identification.identify import identify as identify
    from harvester.identification.measured_impedance import MeasuredImpedance as MeasuredImpedance
    from harvester.identification.measured_impedance import read_impedance as read_impedance
    from harvester.identification.measured_response import MeasuredResponse as MeasuredResponse
    from harvester.identification.measurement import Measurement as Measurement
    from harvester.identification.measurement import read_measurement as read_measurement
    from harvester.results.result import Result as Result
    from harvester.running.opening import open_runner as open_runner
    from harvester.scene.model import Scene as Scene
    from harvester.simulation.methods import Circuit as Circuit
    from harvester.simulation.methods import MonteCarlo as MonteCarlo
    from harvester.simulation.simulate import simulate as simulate
    from harvester.studies.loads.study import save as save
    from harvester.studies.orbits.public import basins as basins
    from harvester.studies.orbits.public import bifurcation as bifurcation
    from harvester.studies.orbits.public import residence as residence
    from harvester.studies.public import frequency_response as frequency_response
    from harvester.studies.public import load_study as load_study
    from harvester.studies.public import optimum as optimum
    from harvester.studies.public import sensitivity as sensitivity
    from harvester.studies.public import spectrum as spectrum
    from harvester.studies.public import sweep as sweep
    from harvester.studies.public import validate as validate
    from harvester.verification.accuracy.both import accuracy as accuracy
    from harvester.verification.accuracy.time_to_accuracy import (
        time_to_accuracy as time_to_accuracy,
    )
    from harvester.verification.accuracy.work_precision import work_precision as work_precision
    from harvester.verification.known_results.verify import verify as verify
    from harvester.verification.paper.claims import claims as claims
    from harvester.verification.paper.reproduce import reproduce as reproduce
    from harvester.verification.stability.matrix import stability as stability

# Where each public name stands. It is imported at its first use, so that `import harvester` stays
# light.
_WHERE = {
    "Scene": "harvester.scene.model",
    "Result": "harvester.results.result",
    "simulate": "harvester.simulation.simulate",
    "average": "harvester.averaging.of_scene",
    "Circuit": "harvester.simulation.methods",
    "MonteCarlo": "harvester.simulation.methods",
    "Stationary": "harvester.averaging.method",
    "validate": "harvester.studies.public",
    "explore": "harvester.explorer.explorer",
    "coupled": "harvester.export.coupled",
    "frequency_response": "harvester.studies.public",
    "basins": "harvester.studies.orbits.public",
    "bifurcation": "harvester.studies.orbits.public",
    "residence": "harvester.studies.orbits.public",
    "spectrum": "harvester.studies.public",
    "sweep": "harvester.studies.public",
    "open_runner": "harvester.running.opening",
    "load_study": "harvester.studies.public",
    "save": "harvester.studies.loads.study",
    "optimum": "harvester.studies.public",
    "sensitivity": "harvester.studies.public",
    "identify": "harvester.identification.identify",
    "Measurement": "harvester.identification.measurement",
    "MeasuredImpedance": "harvester.identification.measured_impedance",
    "MeasuredResponse": "harvester.identification.measured_response",
    "read_measurement": "harvester.identification.measurement",
    "read_impedance": "harvester.identification.measured_impedance",
    "accuracy": "harvester.verification.accuracy.both",
    "work_precision": "harvester.verification.accuracy.work_precision",
    "time_to_accuracy": "harvester.verification.accuracy.time_to_accuracy",
    "stability": "harvester.verification.stability.matrix",
    "verify": "harvester.verification.known_results.verify",
    "reproduce": "harvester.verification.paper.reproduce",
    "claims": "harvester.verification.paper.claims",
    "schematic": "circuits.schematic.drawing",
    "HarvesterError": "harvester.errors",
    "SceneError": "harvester.errors",
    "UnknownOption": "harvester.errors",
    "UnknownQuantity": "harvester.errors",
    "LoadChatters": "harvester.errors",
    "LoadError": "harvester.errors",
    "NetlistError": "harvester.errors",
    "AveragingError": "harvester.errors",
    "OptimumError": "harvester.errors",
    "IdentificationError": "harvester.errors",
    "EngineNotFound": "harvester.errors",
    "CompiledDeviceUnavailable": "harvester.errors",
    "MissingLibrary": "harvester.errors",
    "ProgramNotFound": "harvester.errors",
    "ExportError": "harvester.errors",
    "OutputError": "harvester.errors",
    "FolderInUse": "harvester.errors",
    "SimulationError": "harvester.errors",
    "SimulatorCrashed": "harvester.errors",
    "SimulatorTimeout": "harvester.errors",
    "SimulatorAborted": "harvester.errors",
    "SolutionDiverged": "harvester.errors",
    "SpringRangeLeft": "harvester.errors",
    "EnergyNotBalanced": "harvester.errors",
    "OutOfTime": "harvester.errors",
}
__all__ = ["__version__", *_WHERE]


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'harvester' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
