import re
import shutil
import subprocess
import sys

import pytest

from harvester.base.compilation import numba
from harvester.base.numba_cache import modules_of, sources
from harvester.base.surroundings import PACKAGE


@pytest.mark.slow
def test_a_change_in_one_file_reaches_the_code_compiled_from_another(tmp_path):
    """A force in one folder is compiled into the integrator of another that does not change."""
    shutil.copytree(PACKAGE, tmp_path / "harvester", ignore=shutil.ignore_patterns("__pycache__"))
    head = "from harvester.base.compilation import compiled\n"
    force = tmp_path / "harvester" / "device" / "one_force.py"
    force.write_text(f"{head}\n\n@compiled\ndef force(x):\n    return -2.0 * x\n")
    integrator = tmp_path / "harvester" / "engines" / "one_integrator.py"
    head += "from harvester.device.one_force import force\n"
    integrator.write_text(f"{head}\n\n@compiled\ndef integrate(x):\n    return force(x)\n")
    code = (
        "from harvester.engines.one_integrator import integrate\n"
        "print(integrate(1.0), sum(integrate.stats.cache_hits.values()))"
    )

    def integrated():
        command = [sys.executable, "-c", code]
        shown = subprocess.run(
            command,
            cwd=tmp_path,
            env={"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            check=True,
        )
        return shown.stdout.split()

    assert integrated() == [b"-2.0", b"0"]
    assert integrated() == [b"-2.0", b"1"]
    force.write_text(force.read_text().replace("2.0", "3.0"))
    assert integrated() == [b"-3.0", b"0"]


def test_compiled_code_survives_a_change_of_what_it_is_not_made_of():
    """Classes that are arguments of compiled code count, and constants from elsewhere."""
    from harvester.engines.monte_carlo import lockstep
    from harvester.scene.model import Scene
    from harvester.scene.prepared import prepared

    system = numba.typeof(prepared(Scene.read("device")).system)
    of_arguments = set(modules_of((system,)))
    assert {f"harvester.device.{name}" for name in ("system", "piezo", "damper")} <= of_arguments
    stepped = sources({lockstep.__name__})
    assert {"harvester.device.hertz", "harvester.scene.units"} <= stepped.keys()
    assert "harvester.device.piezo" not in stepped
    rooms = {name.split(".")[1] for name in stepped if "." in name}
    assert not rooms & {"cli", "studies", "identification", "interop", "validation", "results"}


def test_the_command_line_needs_no_numba():
    """A command that leaves the computing to workers, or computes nothing, starts sooner."""
    code = (
        "import sys, harvester\n"
        "from harvester.engines.methods import MonteCarlo\n"
        "from harvester.engines import outcome, runner, spread\n"
        "MonteCarlo().check(harvester.Scene.read('paper'))\n"
        "print([name for name in ('numba', 'scipy') if name in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    shown = subprocess.run(
        command, env={"PYTHONPATH": str(PACKAGE.parent)}, capture_output=True, check=True
    )
    assert shown.stdout == b"[]\n"


ALL_ENGINES = """
from harvester.base.compilation import numba
from numba.core import event

class Names(event.Listener):
    def on_start(self, told):
        compiled.append(told.data["dispatcher"].__qualname__)

    def on_end(self, told):
        pass

compiled = []
event.register("numba:compile", Names())
from harvester import average
from harvester.engines.methods import engine_of
from harvester.engines.realization import run
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
brief = {"run.duration": 1.0, "run.settle": 0.0, "run.realizations": 1}
for name, load in (("linear", {}), ("device", {"load.netlist": "bridge"})):
    scene = Scene.read(name).replace(brief | load)
    for engine in ("circuit", "monte-carlo"):
        run(prepared(scene), engine_of(engine), [0], None, lambda *_: None)
average("linear")
print(compiled)
"""


@pytest.mark.slow
def test_what_one_process_has_compiled_another_finds():
    command = [sys.executable, "-c", ALL_ENGINES]
    for _ in range(2):
        shown = subprocess.run(
            command, env={"PYTHONPATH": str(PACKAGE.parent)}, capture_output=True, check=True
        )
    assert shown.stdout == b"[]\n"


def test_numba_is_imported_where_the_working_folder_is_shut_out():
    direct = re.compile(r"^(from|import) numba\b", re.MULTILINE)
    folders = (PACKAGE, PACKAGE.parent / "circuits")
    sources = [source for folder in folders for source in folder.rglob("*.py")]
    assert [source.name for source in sources if direct.search(source.read_text())] == []


@pytest.mark.slow
@pytest.mark.parametrize("text", ["cache_dir: {folder}/evil\ndisable_jit: 1\n", "1: 2\n", "[: -"])
def test_numba_takes_no_settings_of_the_working_folder(tmp_path, text):
    (tmp_path / ".numba_config.yaml").write_text(text.format(folder=tmp_path))
    code = (
        "from harvester.device.system import potential\n"
        "from harvester.base.compilation import compiled, numba\n"
        "compiled(lambda x: x, cache=False)(1.0)\n"
        "print(numba.config.CACHE_DIR, numba.config.DISABLE_JIT)"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        timeout=60.0,
    )
    assert (shown.stdout.split(), shown.stderr) == (["0"], "")
