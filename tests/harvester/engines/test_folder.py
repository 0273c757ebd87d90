import concurrent.futures
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from harvester.base.errors import FolderInUse, OutputError
from harvester.base.writing import whole_file
from harvester.cli.command_line import main
from harvester.engines import folder as folder_module
from harvester.engines.folder import LOCK, StudyFolder, held

HOLD = "import sys, time; from harvester.engines.folder import StudyFolder; "
HOLD += "StudyFolder(sys.argv[1]).hold(); print('held', flush=True); time.sleep(60)"


@pytest.fixture
def other_run(tmp_path):
    """Another process that holds the folder."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"held\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.mark.slow
def test_a_second_run_is_refused_by_name_until_the_first_is_killed(tmp_path, other_run, capsys):
    command = ["load-study", "linear", "--method", "consistent", "--load", "resistor"]
    command += ["--output", str(tmp_path)]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{tmp_path}: another run uses this folder (process {other_run.pid} on" in error
    assert [path.name for path in tmp_path.glob("[!.]*")] == ["points"]
    other_run.kill()
    other_run.wait()
    assert main(command) == 0
    assert (tmp_path / "linear-load-study.json").exists()


def test_within_one_process_too(tmp_path):
    with held(tmp_path) as mine, held(mine):
        with pytest.raises(FolderInUse), held(tmp_path):
            pass
        with pytest.raises(FolderInUse), held(tmp_path / "points" / ".."):
            pass
    with held(tmp_path):
        pass


def say_and_wait(ready):
    ready.set()
    time.sleep(60.0)


def test_a_forked_child_does_not_outlast_its_parent_as_holder(tmp_path):
    context = multiprocessing.get_context("fork")
    ready = context.Event()
    child = context.Process(target=say_and_wait, args=(ready,))
    with held(tmp_path):
        child.start()
        assert ready.wait(30.0)
    try:
        with held(tmp_path):
            pass
    finally:
        child.kill()
        child.join()


def test_only_leftovers_of_a_study_are_taken_away(tmp_path, monkeypatch):
    points = tmp_path / "points"
    points.mkdir()
    # As kill -9 leaves it.
    with monkeypatch.context() as killed:
        killed.setattr(os, "replace", lambda *_: None)
        killed.setattr(Path, "unlink", lambda *_, **__: None)
        for path in (points / "piece.npz", tmp_path / "power.png"):
            with whole_file(path) as file:
                file.write(b"half")
    assert len([*tmp_path.glob(".*"), *points.glob(".*")]) == 2
    name = ".harvester-0123456789abcdef"
    somebodys = [tmp_path / f"{name}.png", tmp_path / ".harvester-notes", points / "a.npz"]
    somebodys += [points / f"x{name}", points / name.upper(), points / "README"]
    for path in somebodys:
        path.write_text("mine")
    folder_like = points / name
    folder_like.mkdir()
    link = tmp_path / name
    link.symlink_to(somebodys[0])
    with held(tmp_path):
        found = {path for path in tmp_path.rglob("*") if path.name != LOCK}
    assert found == {points, *somebodys, folder_like, link}


def test_a_folder_made_for_a_run_that_kept_nothing_goes(tmp_path, capsys):
    place = tmp_path / "study"
    assert main(["load-study", "device", "--load", "bridgee", "--output", str(place)]) == 2
    assert "did you mean bridge?" in capsys.readouterr().err
    assert not place.exists()
    # Not one that was there before, nor one in which anything is kept.
    place.mkdir()
    with held(place):
        pass
    assert (place / "points").is_dir()
    for kept in (place / "points" / "one", place / "table.csv"):
        shutil.rmtree(place)
        with held(place):
            kept.write_text("")
        assert kept.exists()


def test_a_lock_that_its_holder_has_taken_away_is_none(tmp_path, monkeypatch):
    """Opened before the holder's end, locked after it: the next run locks another file."""
    opened = folder_module._open

    def late(path):
        handle = opened(path)
        path.unlink()
        return handle

    monkeypatch.setattr(folder_module, "_open", late)
    with pytest.raises(FolderInUse, match="start again"):
        StudyFolder(tmp_path / "study").hold()


def test_a_folder_that_cannot_be_locked_is_said_and_not_cleaned(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", no_locks)
    leftover = tmp_path / ".harvester-0123456789abcdef"
    leftover.touch()
    with held(tmp_path) as study:
        assert "cannot lock" in study.notes[0]
    assert leftover.exists()


def test_a_lock_under_two_names_is_not_written_to(tmp_path):
    (tmp_path / "somebodys").write_text("mine")
    os.link(tmp_path / "somebodys", tmp_path / LOCK)
    with held(tmp_path):
        pass
    assert (tmp_path / "somebodys").read_text() == "mine"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder: folder.write_text(""), "study: is not a folder"),
        (lambda folder: folder.symlink_to("nowhere"), "study: is not a folder"),
        (lambda folder: folder.symlink_to(folder), "study: is not a folder"),
        (lambda folder: os.mkfifo(folder), "study: is not a folder"),
        (lambda folder: (folder.mkdir(), (folder / "points").touch()), "points: is not a folder"),
        (lambda folder: (folder.mkdir(), os.mkfifo(folder / LOCK)), f"{LOCK}: is not a file"),
        (lambda folder: (folder / LOCK).mkdir(parents=True), f"{LOCK}: cannot be opened"),
        (
            lambda folder: (folder.mkdir(), (folder / LOCK).symlink_to("/etc/motd")),
            f"{LOCK}: cannot be opened",
        ),
    ],
)
def test_a_folder_that_is_none_is_one_line(tmp_path, make, said):
    make(tmp_path / "study")
    with pytest.raises(OutputError, match=said) as caught:
        StudyFolder(tmp_path / "study").hold()
    assert str(caught.value).isprintable()


def test_a_name_too_long_is_one_line(tmp_path):
    with pytest.raises(OutputError, match="cannot be created"):
        StudyFolder(tmp_path / ("a" * 300)).hold()


def test_a_folder_behind_a_link_is_that_folder(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with held(tmp_path / "real"), pytest.raises(FolderInUse), held(tmp_path / "link"):
        pass


def test_threads_of_one_process_do_not_share_a_folder(tmp_path):
    inside, done = threading.Event(), threading.Event()

    def hold():
        with held(tmp_path):
            inside.set()
            done.wait(30.0)

    with concurrent.futures.ThreadPoolExecutor() as threads:
        first = threads.submit(hold)
        inside.wait(30.0)
        with pytest.raises(FolderInUse):
            threads.submit(hold).result()
        done.set()
        first.result()
    assert not folder_module._HANDLES


def children(process):
    threads = Path(f"/proc/{process.pid}/task").glob("*/children")
    return [int(word) for thread in threads for word in thread.read_text().split()]


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="finds workers in /proc")
def test_a_worker_killed_from_outside_is_no_outcome_for_ever(tmp_path):
    """Both tries of a piece are killed; the next run computes it."""
    study = ["load-study", "linear", "--method", "monte-carlo", "--load", "resistor"]
    study += ["--set", "run.realizations=1", "--workers", "1", "--output", str(tmp_path)]
    process = subprocess.Popen(
        [sys.executable, "-m", "harvester", *study, "--set", "run.duration=1e7"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while process.poll() is None and time.monotonic() < deadline:
        for child in children(process):
            os.kill(child, signal.SIGKILL)
        time.sleep(0.2)
    said, _ = process.communicate(timeout=10.0)
    assert "SimulatorCrashed" in said
    assert "to compute them again" in said.replace("\n", " ")
    assert process.returncode == 1
    assert list((tmp_path / "points").iterdir()) == []
