"""The command's process from its first moment on."""

import subprocess
import sys

import pytest

from harvester.base.surroundings import PACKAGE

INTERRUPTED = """
import builtins, sys

before = builtins.__import__

def interrupted(name, *rest):
    if name == {module!r}:
        raise KeyboardInterrupt
    return before(name, *rest)

builtins.__import__ = interrupted
sys.argv = ["harvester", "average", "paper"]
from harvester.__main__ import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    "module", ["harvester.cli.command_line", "cyclopts", "harvester.scene.model", "numpy"]
)
def test_an_interrupt_while_libraries_are_imported_is_one_line(module):
    program = INTERRUPTED.format(module=module)
    shown = subprocess.run(
        [sys.executable, "-c", program], cwd=PACKAGE.parent, capture_output=True, text=True
    )
    assert shown.returncode == 130
    assert shown.stderr == "harvester: interrupted; nothing was written\n"
    assert shown.stdout == ""


@pytest.mark.slow
def test_python_without_docstrings_is_refused_in_one_line():
    call = [sys.executable, "-OO", "-m", "harvester", "average", "linear"]
    ended = subprocess.run(call, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "use python -O" in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_an_interrupt_that_a_callback_swallows_ends_in_the_code_of_one():
    program = (
        "import os, signal, sys\nimport harvester.cli.command_line\n"
        # A shell starts what runs in the background with interrupts ignored.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def run():\n    try:\n        os.kill(os.getpid(), signal.SIGINT)\n"
        "        signal.pause()\n    except KeyboardInterrupt:\n        return 0\n"
        "harvester.cli.command_line.main = run\nfrom harvester.__main__ import main\n"
        "sys.exit(main())"
    )
    shown = subprocess.run(
        [sys.executable, "-c", program], cwd=PACKAGE.parent, capture_output=True, text=True
    )
    assert shown.returncode == 130
    assert shown.stderr == "harvester: interrupted, but only after its last result\n"
