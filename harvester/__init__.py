"""Circuit-accurate simulation of vibration energy harvesters under coloured noise.

>>> import harvester
>>> scene = harvester.Scene.load("paper").replace({"excitation.intensity": 0.05})
>>> scene.excitation.intensity
0.05

`harvester.simulate(scene, engine="circuit")`, `harvester.average(scene)`
and `harvester.validate(scene)` return results with error bars; see their help.
"""

import importlib

__version__ = "0.1.0"

# What is imported where it is first used, so that `import harvester` stays light.
_WHERE = {
    "Scene": "harvester.scene.model",
    "Result": "harvester.results",
    "simulate": "harvester.simulation",
    "average": "harvester.averaging.of_scene",
    "validate": "harvester.studies.comparison",
    "frequency_response": "harvester.studies.frequency_response",
    "schematic": "harvester.engines.circuit",
    "load_study": "harvester.studies",
    "HarvesterError": "harvester.errors",
}
__all__ = ["__version__", *_WHERE]


def __getattr__(name):
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'harvester' has no attribute {name!r}")


def __dir__():
    return sorted(__all__)
