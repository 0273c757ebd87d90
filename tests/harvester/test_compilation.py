import shutil
import subprocess
import sys

from harvester.compilation import PACKAGE


def test_a_change_in_one_file_reaches_the_code_compiled_from_another(tmp_path):
    """The contact force lives in `forces`, its use in `monte_carlo`."""
    shutil.copytree(PACKAGE, tmp_path / "harvester", ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "from harvester.scene import Scene; from harvester.parameters import scale\n"
        "from harvester.monte_carlo import _acceleration\n"
        "p, _ = scale(Scene.load('paper'))\n"
        "print(_acceleration(p, True, 0.0, 1.5, 0.0, 0.0, 0.0))"
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
    forces = tmp_path / "harvester" / "forces.py"
    changed = forces.read_text().replace(
        "return spring + contact_damping(p, x, v, held_speed) * v",
        "return 2.0 * spring + contact_damping(p, x, v, held_speed) * v",
    )
    forces.write_text(changed)
    assert acceleration() < before - 1.0
