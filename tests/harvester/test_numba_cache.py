"""What numba keeps on disk of a program to which anybody adds parts."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from numba.core import caching

from harvester.compilation import numba
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
    head = "import numpy as np\nfrom harvester.compilation import compiled\n"
    body = f"@compiled\ndef slow(x):\n{lines}\n    return x\n"
    (tmp_path / "slow_to_compile.py").write_text(f"{head}\n\n{body}")
    program = (
        "from slow_to_compile import slow; print('ready', flush=True); input(); slow(1.0); "
        "print(sum(slow.stats.cache_misses.values()), sum(slow.stats.cache_hits.values()))"
    )
    here = Path(__file__).parents[2]
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
