"""Circuit-accurate simulation of vibration energy harvesters under coloured noise.

>>> import harvester
>>> scene = harvester.Scene.read("paper").replace({"excitation.intensity": 0.05})
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

# The stub for type checkers is the one table of the public names: name and module. A name is
# imported at its first use, so that `import harvester` stays light.
with open(os.path.join(os.path.dirname(__file__), "__init__.pyi"), encoding="utf-8") as _stub:
    _IMPORTS = [line.split() for line in _stub if line.startswith("from ")]
_WHERE = {words[-1]: words[1] for words in _IMPORTS}
__all__ = list(_WHERE)
# Commands that are no functions, since files are all that they read or write.
COMMANDS_ONLY = ("cite", "completion", "engine", "load", "new", "schema")


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    from harvester.base.plain_text import nearest

    hint = nearest(name, __all__)
    hint = hint if hint or name.startswith("_") else f"; there are {', '.join(sorted(__all__))}"
    if name in COMMANDS_ONLY:
        hint = f"; on the command line: harvester {name}"
    if name in ("load", "read"):
        hint += "; Result.read reads a result's JSON, Scene.read a scene"
    raise AttributeError(f"module 'harvester' has no attribute {name!r}{hint}")


def __dir__() -> list[str]:
    return sorted(__all__)
