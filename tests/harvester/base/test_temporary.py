"""Temporary folders: what a killed process leaves is cleared, what is in use is not."""

import os
import signal
import subprocess
import sys

import pytest

from harvester.base.temporary import TemporaryFolder, clear_abandoned

MAKE = (
    "import sys, time; from harvester.base.temporary import TemporaryFolder; "
    "one = TemporaryFolder(sys.argv[1]); open(one.name + '/file', 'w').close(); "
    "print(one.name, flush=True); time.sleep(60)"
)


@pytest.fixture
def other(tmp_path):
    """Another process that has a folder in `tmp_path`, and that folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", MAKE, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    with process:
        yield process, process.stdout.readline().strip()
        process.kill()


@pytest.mark.parametrize("number", [signal.SIGXCPU, signal.SIGKILL, signal.SIGTERM])
def test_the_next_process_clears_what_a_killed_one_left(tmp_path, other, number):
    process, folder = other
    clear_abandoned.cache_clear()
    clear_abandoned(str(tmp_path))
    assert os.listdir(folder) == ["file"]
    process.send_signal(number)
    process.wait()
    assert os.path.exists(folder)
    clear_abandoned.cache_clear()
    with TemporaryFolder(tmp_path) as own:
        assert os.listdir(tmp_path) == [os.path.basename(own)]
    assert os.listdir(tmp_path) == []


def test_links_and_folders_of_other_names_stay(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "harvester-run-link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "harvester-run-file").write_text("")
    clear_abandoned.cache_clear()
    clear_abandoned(str(tmp_path))
    assert len(os.listdir(tmp_path)) == 3


def test_a_folder_ends_with_its_process(tmp_path):
    program = MAKE.replace("time.sleep(60)", "pass")
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=True, timeout=60)
    assert os.listdir(tmp_path) == []
