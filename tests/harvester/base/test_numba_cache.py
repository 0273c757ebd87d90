"""What numba keeps on disk of a program to which anybody adds parts."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from numba.core import caching

from harvester.base import numba_cache
from harvester.base.compilation import numba
from harvester.device.piezo import piezo


class Foreign(NamedTuple):
    number: float


def index(folder):
    return caching.IndexDataCacheFile(str(folder), "function", (1.0, 2))


def key(*arguments):
    return tuple(numba.typeof(each) for each in arguments), "machine"


def test_code_for_parts_defined_elsewhere_is_not_kept(tmp_path):
    within = key((1.0, (Foreign(1.0), 2)))
    pointed_at = (numba.types.CPointer(within[0][0]),), "machine"
    own = key(piezo(0.1, 0.2))
    index(tmp_path).save(own, "own code")
    assert index(tmp_path).load(own) == "own code"
    for foreign in (within, pointed_at):
        index(tmp_path).save(foreign, "foreign code")
        assert index(tmp_path).load(foreign) is None


def test_an_index_that_names_a_class_that_is_gone_counts_as_empty(tmp_path):
    file = tmp_path / "function.nbi"
    for unreadable in (b"cno_such_module\nPart\n.", b"cnumba\nNoSuchPart\n.", b""):
        file.write_bytes(pickle.dumps(numba.__version__) + unreadable)
        assert index(tmp_path).load(key(1.0)) is None
        index(tmp_path).save(key(1.0), "code")
        assert index(tmp_path).load(key(1.0)) == "code"


@pytest.mark.slow
def test_two_processes_compile_the_same_once(tmp_path):
    """They begin together, and it takes longer than to begin."""
    lines = "\n".join(f"    x = np.sin(x) + {k}.0 * np.hypot(x, {k}.5)" for k in range(60))
    head = "import numpy as np\nfrom harvester.base.compilation import compiled\n"
    body = f"@compiled\ndef slow(x):\n{lines}\n    return x\n"
    (tmp_path / "slow_to_compile.py").write_text(f"{head}\n\n{body}")
    program = (
        "from slow_to_compile import slow; print('ready', flush=True); input(); slow(1.0); "
        "print(sum(slow.stats.cache_misses.values()), sum(slow.stats.cache_hits.values()))"
    )
    here = Path(__file__).parents[3]
    surroundings = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{here}"}
    pipes = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
    both = [
        subprocess.Popen([sys.executable, "-c", program], env=surroundings, text=True, **pipes)
        for _ in range(2)
    ]
    assert [each.stdout.readline() for each in both] == ["ready\n"] * 2
    for each in both:
        each.stdin.write("\n")
        each.stdin.flush()
    found = [each.communicate()[0].split() for each in both]
    assert sorted(found) == [["0", "1"], ["1", "0"]]


def flipped(file):
    content = bytearray(file.read_bytes())
    content[-10] ^= 255
    file.write_bytes(content)


def cut(file):
    file.write_bytes(file.read_bytes()[:20])


def emptied(file):
    file.write_bytes(b"")


def pipe(file):
    file.unlink()
    os.mkfifo(file)


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", [flipped, cut, emptied, pipe])
def test_a_damaged_file_is_named_and_written_anew(tmp_path, monkeypatch, ending, damage):
    named = []
    monkeypatch.setattr(numba_cache, "on_damage", named.append)
    index(tmp_path).save(key(1.0), "code")
    (file,) = tmp_path.glob(f"*.{ending}")
    damage(file)
    assert index(tmp_path).load(key(1.0)) is None
    assert set(named) == {str(file)}
    index(tmp_path).save(key(1.0), "code")
    assert index(tmp_path).load(key(1.0)) == "code"


def test_damage_is_said_once_in_a_process(capsys, monkeypatch):
    monkeypatch.setattr(numba_cache, "_reported", [])
    for _ in range(2):
        numba_cache.on_damage("cache/function.nbc")
    assert capsys.readouterr().err.count("compiled again") == 1


def test_an_index_of_another_release_is_no_damage(tmp_path, monkeypatch):
    monkeypatch.setattr(numba_cache, "on_damage", pytest.fail)
    (tmp_path / "function.nbi").write_bytes(pickle.dumps("0.1") + b"anything")
    assert index(tmp_path).load(key(1.0)) is None


def test_a_folder_that_cannot_be_written_keeps_nothing(tmp_path):
    index(tmp_path / "missing").save(key(1.0), "code")


@pytest.mark.parametrize(("threads", "left"), [("0", None), ("-2", None), ("2", "2"), ("x", "x")])
def test_a_number_of_threads_that_numba_would_end_at_is_taken_out(monkeypatch, threads, left):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    numba_cache.keep_environment_usable()
    assert os.environ.get("NUMBA_NUM_THREADS") == left


@pytest.mark.parametrize("mode", [0o666, 0o602])
def test_a_file_that_others_may_write_is_not_read(tmp_path, monkeypatch, mode):
    named = []
    monkeypatch.setattr(numba_cache, "on_damage", named.append)
    own = key(1.0)
    index(tmp_path).save(own, "own code")
    for file in tmp_path.iterdir():
        file.chmod(mode)
    assert index(tmp_path).load(own) is None
    assert len(named) == 1
    index(tmp_path).save(own, "own code")
    assert index(tmp_path).load(own) == "own code"
