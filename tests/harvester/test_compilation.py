import re
import shutil
import subprocess
import sys

import pytest

from harvester.compilation import PACKAGE, compiled_sources


def test_a_change_in_one_file_reaches_the_code_compiled_from_another(tmp_path):
    """The contact force lives in `device/contact`, its use in `monte_carlo`."""
    shutil.copytree(PACKAGE, tmp_path / "harvester", ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "from harvester.scene.model import Scene; from harvester.scene.units import scale\n"
        "from harvester.engines.schemes import _acceleration\n"
        "p, _ = scale(Scene.load('paper'))\n"
        "print(_acceleration(p, True, 1.1, 9.0, 0.0, 1.5, 0.0, 0.0, 0.0))"
    )

    def acceleration():
        command = [sys.executable, "-c", code]
        shown = subprocess.run(
            command,
            cwd=tmp_path,
            env={"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            check=True,
        )
        return float(shown.stdout)

    before = acceleration()
    assert acceleration() == before
    forces = tmp_path / "harvester" / "device" / "contact.py"
    changed = forces.read_text().replace(
        "return push, damping(contact.law, depth, v, gain, held_speed)",
        "return 2.0 * push, damping(contact.law, depth, v, gain, held_speed)",
    )
    assert changed != forces.read_text()
    forces.write_text(changed)
    assert acceleration() < before - 1.0


def test_compiled_code_survives_a_change_of_what_it_is_not_made_of():
    """Classes that are arguments of compiled code count, and constants from elsewhere."""
    sources = {file.relative_to(PACKAGE.parent).as_posix() for file in compiled_sources()}
    made_of = {"device/coil", "device/hertz", "engines/lockstep", "record/moments", "scene/units"}
    assert {f"harvester/{name}.py" for name in made_of} <= sources
    assert "circuits/kernel/stepping.py" in sources
    others = ("show", "commands", "studies", "identification", "verification", "running")
    assert not [name for name in sources if name.split("/")[1] in others]


ALL_ENGINES = """
from harvester.compilation import numba
from numba.core import event

class Names(event.Listener):
    def on_start(self, told):
        compiled.append(told.data["dispatcher"].__qualname__)

    def on_end(self, told):
        pass

compiled = []
event.register("numba:compile", Names())
from harvester import average
from harvester.engines.realization import run
from harvester.scene.model import Scene
brief = {"run.duration": 1.0, "run.settle": 0.0, "run.realizations": 1}
for name, load in (("linear", {}), ("device", {"load.netlist": "bridge"})):
    scene = Scene.load(name).replace(brief | load)
    for engine in ("circuit", "monte-carlo"):
        run(scene, engine, [0], "default", "external", None, lambda *_: None)
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


@pytest.mark.parametrize("text", ["cache_dir: {folder}/evil\ndisable_jit: 1\n", "1: 2\n", "[: -"])
def test_numba_takes_no_settings_of_the_working_folder(tmp_path, text):
    (tmp_path / ".numba_config.yaml").write_text(text.format(folder=tmp_path))
    code = (
        "from harvester.device.system import potential\n"
        "from harvester.compilation import compiled, numba\n"
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
