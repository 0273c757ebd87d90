"""What numba keeps on disk of a program to which anybody adds parts."""

import pickle
from typing import NamedTuple

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
    own, foreign = key(piezo(0.1, 0.2)), key((1.0, (Foreign(1.0), 2)))
    index(tmp_path).save(own, "own code")
    index(tmp_path).save(foreign, "foreign code")
    assert index(tmp_path).load(own) == "own code"
    assert index(tmp_path).load(foreign) is None


def test_an_index_that_names_a_class_that_is_gone_counts_as_empty(tmp_path):
    file = tmp_path / "function.nbi"
    for unreadable in (b"cno_such_module\nPart\n.", b"cnumba\nNoSuchPart\n.", b""):
        file.write_bytes(pickle.dumps(numba.__version__) + unreadable)
        assert index(tmp_path).load(key(1.0)) is None
        index(tmp_path).save(key(1.0), "code")
        assert index(tmp_path).load(key(1.0)) == "code"
