import json
import os
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from harvester.base.errors import OutputError
from harvester.base.writing import (
    check_writable,
    in_folder,
    is_standard_output,
    whole_file,
    write_json,
    write_text,
)
from harvester.cli.command_line import main


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    target = tmp_path / "deep" / "result.json"

    def fail_halfway():
        with whole_file(target) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert list(tmp_path.iterdir()) == []
    write_json(target, {"value": 1.5})
    assert json.loads(target.read_text()) == {"value": 1.5}
    assert [path.name for path in target.parent.iterdir()] == ["result.json"]


def test_an_old_file_stays_until_the_new_one_is_whole(tmp_path):
    target = tmp_path / "result.json"
    write_json(target, {"value": "old"})
    with pytest.raises(ValueError, match="JSON"):
        write_json(target, {"value": float("nan")})
    assert json.loads(target.read_text()) == {"value": "old"}


def test_what_cannot_be_written_is_refused_before_the_run(tmp_path):
    check_writable(tmp_path / "new" / "newer" / "result.json")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="cannot be written"):
        check_writable("/dev/null/result.json")
    with pytest.raises(OutputError, match="name a file"):
        check_writable(tmp_path)


@pytest.fixture
def near(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(autouse=True)
def devices_stay(monkeypatch):
    """Whatever is broken, a test that runs as root replaces no device of the machine."""
    replace = os.replace

    def guarded(source, target):
        assert not os.path.realpath(target).startswith("/dev/"), f"{target} would be replaced"
        replace(source, target)

    monkeypatch.setattr(os, "replace", guarded)


def test_a_file_is_replaced_where_links_lead_and_keeps_its_permissions(near):
    (near / "deep").mkdir()
    real = near / "deep" / "real.json"
    real.write_text("old")
    real.chmod(0o600)
    (near / "link.json").symlink_to("deep/real.json")
    (near / "dangling.json").symlink_to("deep/new.json")
    for link, target in (("link.json", real), ("dangling.json", near / "deep" / "new.json")):
        check_writable(link)
        write_text(link, "new")
        assert (near / link).is_symlink()
        assert target.read_text() == "new"
    assert real.stat().st_mode & 0o777 == 0o600
    assert sorted(path.name for path in (near / "deep").iterdir()) == ["new.json", "real.json"]


def test_a_new_file_follows_the_umask(near):
    before = os.umask(0o027)
    try:
        write_text("new.json", "new")
    finally:
        os.umask(before)
    assert (near / "new.json").stat().st_mode & 0o777 == 0o640


def bind(path):
    with socket.socket(socket.AF_UNIX) as opened:
        opened.bind(path)


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (os.mkdir, "is a folder"),
        (bind, "is a socket"),
        (lambda path: os.symlink(path, path), "symbolic links"),
        (lambda path: os.symlink("no/where", path), "a link into a missing folder"),
    ],
)
def test_what_is_no_file_is_refused_and_stays(near, make, reason):
    make("taken")
    kind = os.lstat("taken").st_mode
    for write in (check_writable, lambda path: write_text(path, "new")):
        with pytest.raises(OutputError, match=reason) as caught:
            write("taken")
        assert "\n" not in str(caught.value)
        assert os.lstat("taken").st_mode == kind
    assert os.listdir() == ["taken"]


def test_devices_and_fifos_are_written_to(near):
    for device in ("/dev/null", "/dev/full"):
        os.symlink(device, os.path.basename(device))
        check_writable(os.path.basename(device))
    write_text("null", "new")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    with pytest.raises(OutputError, match="No space left"):
        write_text("full", "new")
    os.mkfifo("fifo")
    check_writable("fifo")
    read = []
    reader = threading.Thread(target=lambda: read.append(Path("fifo").read_text()))
    reader.start()
    write_json("fifo", [1])
    reader.join()
    assert json.loads(read[0]) == [1]
    assert sorted(os.listdir()) == ["fifo", "full", "null"]


def test_standard_output_is_itself_under_every_name(near, capsys):
    os.symlink("/dev/stdout", "link")
    for path in ("-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "link"):
        assert is_standard_output(path)
        check_writable(path)
        write_text(path, "é")
        assert capsys.readouterr().out == "é"
    assert not is_standard_output("fd/1")
    reading, writing = os.pipe()
    write_text(f"/dev/fd/{writing}", "é")
    assert os.read(reading, 10) == "é".encode()


def test_a_stream_takes_one_file(near, capsys):
    for path in ("-", "/dev/stdout"):
        assert main(["schematic", "linear", "--output", path]) == 0
        assert capsys.readouterr().out.endswith("</svg>\n")
    assert main(["schematic", "linear", "--output", "/dev/null"]) == 0
    for path in ("/dev/stdout", "/dev/null"):
        assert main(["netlist", "linear", "--dialect", "ltspice", "--output", path]) == 2
        assert "also writes a noise file" in capsys.readouterr().err


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(near):
    write_text("a.json", "old")
    code = (
        "import resource; from harvester.base.writing import write_text\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "write_text('a.json', 'x' * 5000)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "OutputError: a.json: cannot be written: File too large" in ended.stderr
    assert (near / "a.json").read_text() == "old"
    assert os.listdir() == ["a.json"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_protected_files_and_folders_are_refused(near):
    write_text("a.json", "old")
    os.chmod("a.json", 0o444)
    with pytest.raises(OutputError, match="write-protected"):
        write_text("a.json", "new")
    os.mkdir("closed", 0o555)
    with pytest.raises(OutputError, match="Permission denied"):
        check_writable("closed/a.json")


def test_files_that_the_program_names_are_no_way_out_of_a_folder(near, capsys):
    os.mkdir("results")
    write_text("foreign", "old")
    os.symlink("../foreign", "results/linear-paper.json")
    os.symlink("results", "elsewhere")
    with pytest.raises(OutputError, match="outside the folder"):
        in_folder("elsewhere", "linear-paper.json")
    assert main(["average", "linear", "--method", "paper", "--output", "results"]) == 2
    assert (near / "foreign").read_text() == "old"
    os.mkfifo("results/linear-load-study.nc")
    assert main(["load-study", "linear", "--output", "results"]) == 2
    assert "load-study.nc: is not a regular file" in capsys.readouterr().err
    assert in_folder("elsewhere", "new.json") == Path("elsewhere/new.json")


@pytest.mark.slow
def test_a_result_reaches_one_place_where_the_other_is_full(near, capsys):
    call = ["average", "linear", "--method", "paper", "--quiet"]
    assert main([*call, "--json", "/dev/full", "--output", "results"]) == 2
    assert (
        capsys.readouterr().err
        == "harvester: /dev/full: cannot be written: No space left on device\n"
    )
    assert len(os.listdir("results")) == 5
