import dataclasses
import io
import json
import os
import socket
import zipfile

import numpy as np
import pytest

from harvester.averaging.method import Stationary
from harvester.base.errors import (
    AveragingError,
    SimulationError,
    SimulatorAborted,
    SimulatorCrashed,
    SimulatorTimeout,
    SolutionDiverged,
)
from harvester.engines.codec import (
    DIGEST,
    MOST_BYTES,
    TREE,
    NotAnAnswer,
    digest_of,
    packed,
    unpacked,
)
from harvester.engines.methods import Circuit, MonteCarlo, engine_of
from harvester.engines.realizations import Realizations, averaging
from harvester.engines.store import MISSING, AnswerStore
from harvester.engines.task import Task, compute
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.estimate import Estimate
from harvester.statistics.moments import PRODUCTS, Moments
from harvester.statistics.output_side import estimate_output
from harvester.statistics.run_quantities import estimate_all


@pytest.fixture(scope="module")
def bridge():
    return Scene.read("device").replace(
        {"load.netlist": "bridge", "run.duration": 2.0, "run.settle": 0.5, "run.realizations": 2}
    )


@pytest.fixture(scope="module")
def task(bridge):
    """The first two realizations, of which a circuit with a bridge takes one at a time."""
    cut = Realizations.of(prepared(bridge), Circuit(), waveform=True)
    return dataclasses.replace(cut, size=2).tasks(0, 2)[0]


@pytest.fixture(scope="module")
def answer(task, pool):
    call = {"function": task.function, "arguments": task.arguments}
    return pool.map(compute, [call])[0][0]


def path_of(task, folder):
    return folder / "points" / f"{task.key}.npz"


def test_an_answer_read_back_gives_the_same_numbers(bridge, task, answer, tmp_path):
    AnswerStore(tmp_path).put(task, answer)
    read = AnswerStore(tmp_path).get(task)
    parameters = prepared(bridge).system

    def values(some):
        found = estimate_all(some["moments"], parameters) | estimate_output(some["moments"])
        return {name: repr((e.estimate, e.standard_error)) for name, e in found.items()}

    assert values(read) == values(answer)
    np.testing.assert_array_equal(read["waveform"], answer["waveform"])
    assert read["seconds"] == answer["seconds"]
    assert list((tmp_path / "points").iterdir()) == [path_of(task, tmp_path)]


def test_every_kind_of_plain_answer_comes_back_as_it_was():
    estimate = Estimate(1.0, None, np.inf, "voltage^2", "ä note")
    kept = {
        "none": None,
        "numbers": [1, 0.1, -np.inf, True, np.float64(0.3)],
        2.5: (1, [2, (3,)], {}),
        "text": "two\nlines",
        "estimate": estimate,
        "arrays": [np.arange(3), np.zeros((2, 0)), np.array([True, False])],
    }
    found = unpacked(packed("key", kept), "key")
    for left, right in zip(kept.pop("arrays"), found.pop("arrays"), strict=True):
        np.testing.assert_array_equal(left, right)
        assert left.dtype == right.dtype
    assert found == kept
    assert np.isnan(unpacked(packed("key", np.nan), "key"))
    for strange in (object(), np.array(["text"]), {1, 2}, lambda: None):
        with pytest.raises(TypeError):
            packed("key", strange)


def test_an_answer_under_another_name_is_none():
    """Of the same form, as a file that was copied: only its key tells."""
    with pytest.raises(NotAnAnswer, match="belongs to another task"):
        unpacked(packed("key", 1.0), "other")


class Bomb:
    """Pickled, it makes a file when it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def rewritten(content, **changes):
    """A piece's arrays with some of them changed and a fresh digest, as a forger would."""
    arrays = dict(np.load(io.BytesIO(content)))
    del arrays[DIGEST]
    arrays |= changes
    file = io.BytesIO()
    np.savez(file, **arrays, digest=np.array(digest_of(arrays)))
    return file.getvalue()


def tree(content):
    """A tree's text as it lies in a file."""
    text = content if isinstance(content, str) else json.dumps(content)
    return {TREE: np.frombuffer(text.encode(), dtype=np.uint8)}


def forged(whole, answer):
    """The file with another answer in the place of its own."""
    return rewritten(whole, **tree({"key": key_in(whole), "answer": answer}))


def key_in(whole):
    return json.loads(np.load(io.BytesIO(whole))[TREE].tobytes())["key"]


def name_in(whole, field):
    """Name of the array that holds a field of the first realization's moments."""
    answer = json.loads(np.load(io.BytesIO(whole))[TREE].tobytes())["answer"]
    moments = dict(answer[1:])["moments"][1]
    names = [each.name for each in dataclasses.fields(Moments)]
    return moments[2:][names.index(field)][1]


def zipped(name, content, kind=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", kind) as opened:
        opened.writestr(name, content)
    return file.getvalue()


def npz(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def absurd_header(shape):
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        file, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    return file.getvalue()


FOREIGN = {
    "nothing": lambda whole, spoor: b"",
    "a third": lambda whole, spoor: whole[: len(whole) // 3],
    "nearly all": lambda whole, spoor: whole[:-30],
    "a flipped bit": lambda whole, spoor: whole[:900] + bytes([whole[900] ^ 1]) + whole[901:],
    "text": lambda whole, spoor: b"[" * 100_000,
    "too large": lambda whole, spoor: bytes(MOST_BYTES + 1),
    "a zip bomb": lambda whole, spoor: zipped("header.npy", bytes(2 * MOST_BYTES)),
    "another compression": lambda whole, spoor: zipped("header.npy", b"", zipfile.ZIP_LZMA),
    "a terabyte's shape": lambda whole, spoor: zipped("0.integrals.npy", absurd_header((2**40,))),
    "a negative shape": lambda whole, spoor: zipped("0.integrals.npy", absurd_header((-1,))),
    "a pickle": lambda whole, spoor: npz(header=np.array(Bomb(spoor), dtype=object)),
    "an edit": lambda whole, spoor: npz(
        **(dict(np.load(io.BytesIO(whole))) | {name_in(whole, "products"): np.zeros(8)})
    ),
    "another key": lambda whole, spoor: rewritten(whole, **tree({"key": "other", "answer": 1})),
    "a nested tree": lambda whole, spoor: rewritten(whole, **tree("[" * 50_000)),
    "a long number": lambda whole, spoor: rewritten(
        whole, **tree(f'{{"key": "{key_in(whole)}", "answer": {"9" * 5000}}}')
    ),
    "an unknown kind": lambda whole, spoor: forged(whole, ["object", "Popen", "true"]),
    "a field too many": lambda whole, spoor: forged(whole, ["object", "Estimate", *range(9)]),
    "an array that is not there": lambda whole, spoor: forged(whole, ["array", "a99"]),
    "another's answer": lambda whole, spoor: forged(whole, ["dict", ["quantities", ["dict"]]]),
    "a bell": lambda whole, spoor: forged(whole, "\a"),
    "no number": lambda whole, spoor: rewritten(
        whole, **{name_in(whole, "products"): np.full(len(PRODUCTS), np.nan)}
    ),
    "another shape": lambda whole, spoor: rewritten(
        whole, **{name_in(whole, "integrals"): np.ones((3, 2))}
    ),
    "other wells": lambda whole, spoor: rewritten(
        whole, **{name_in(whole, "saddles"): np.zeros(2)}
    ),
    "negative times": lambda whole, spoor: rewritten(
        whole,
        **{(name := name_in(whole, "integrals")): -np.load(io.BytesIO(whole))[name]},
    ),
    "a crash": lambda whole, spoor: forged(whole, ["error", "SimulatorCrashed", "signal 9"]),
    "no memory": lambda whole, spoor: forged(whole, ["error", "SimulatorAborted", "no memory"]),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_no_answer_is_named_and_written_again(task, answer, tmp_path, kind):
    AnswerStore(tmp_path).put(task, answer)
    assert AnswerStore(tmp_path).get(task) is not MISSING
    path, spoor = path_of(task, tmp_path), tmp_path / "spoor"
    path.write_bytes(FOREIGN[kind](path.read_bytes(), spoor))
    store = AnswerStore(tmp_path)
    assert store.get(task) is MISSING
    assert store.get(task) is MISSING
    (line,) = store.refused.values()
    assert line.startswith(str(path))
    assert line.endswith(": computed again")
    assert line.isprintable()
    assert not spoor.exists()
    store.put(task, answer)
    assert store.get(task) is not MISSING
    assert AnswerStore(tmp_path).get(task) is not MISSING


def make_socket(path):
    with socket.socket(socket.AF_UNIX) as one, pytest.MonkeyPatch.context() as patch:
        patch.chdir(path.parent)
        one.bind(path.name)


@pytest.mark.parametrize(
    "make",
    [
        lambda path: path.mkdir(),
        os.mkfifo,
        make_socket,
        lambda path: path.symlink_to("/dev/zero"),
        lambda path: path.symlink_to(path.parent / "somebodys"),
        lambda path: path.symlink_to(path),
    ],
)
def test_what_is_no_file_is_left_there_and_the_answer_not_kept(task, answer, tmp_path, make):
    (tmp_path / "points").mkdir()
    somebodys, path = tmp_path / "points" / "somebodys", path_of(task, tmp_path)
    somebodys.write_bytes(packed(task.key, answer))
    before = somebodys.read_bytes()
    make(path)
    kind = os.lstat(path).st_mode
    store = AnswerStore(tmp_path)
    assert store.get(task) is MISSING
    store.put(task, answer)
    assert store.get(task) is answer
    assert "was not stored" in store.refused[task.key]
    assert os.lstat(path).st_mode == kind
    assert somebodys.read_bytes() == before


def fail(report, error):
    raise error


@pytest.mark.parametrize(
    ("error", "kept"),
    [
        (SolutionDiverged("at 1 s"), True),
        (SimulatorAborted("timestep too small"), True),
        (AveragingError("does not hold"), True),
        (SimulatorAborted("malloc: can't allocate 3 bytes"), False),
        (SimulatorCrashed("was killed by signal 9"), False),
        (SimulatorTimeout("10 s"), False),
        (MemoryError(), False),
        (OSError(28, "No space left on device"), False),
        (ZeroDivisionError("a mistake in here"), False),
    ],
)
def test_what_another_run_may_end_otherwise_is_not_kept(tmp_path, error, kept):
    found, _ = compute(fail, {"error": error}, None)
    assert isinstance(found, SimulationError | AveragingError)
    store, task = AnswerStore(tmp_path), Task(fail, {})
    store.put(task, found)
    assert store.get(task) is not MISSING
    assert store.passing == (not kept)
    again = AnswerStore(tmp_path).get(task)
    assert (again is not MISSING) == kept
    if kept:
        assert (type(again), str(again)) == (type(error), str(error))


def test_an_answer_too_large_is_not_kept_and_that_is_said(tmp_path):
    store, task = AnswerStore(tmp_path), Task(fail, {})
    store.put(task, np.zeros(MOST_BYTES // 8))
    assert store.get(task) is not MISSING
    assert "was not stored" in store.refused[task.key]


def test_a_closure_that_refuses_says_so():
    scene = Scene.read("device").replace({"excitation.correlation_time": 100.0})
    task = averaging(scene, Stationary("consistent"))
    found, _ = compute(task.function, task.arguments, None)
    assert isinstance(found, AveragingError)


def test_the_key_follows_all_that_decides_the_numbers(bridge):
    def key(scene=bridge, method="circuit", start=0, step="default", version="1", **kept):
        cut = Realizations(prepared(scene), engine_of(method, step=step), 1, version, **kept)
        return cut.tasks(start, start + 1)[0].key

    others = [
        key(bridge.replace({"run.seed": 2})),
        key(bridge.replace({"load.parameters.resistance": 1.0})),
        key(method="monte-carlo"),
        key(start=1),
        key(step="fine"),
        key(version="2"),
        key(density=True),
        key(waveform=True),
    ]
    assert len({key(), *others}) == 9
    assert key() == key()


def test_the_key_does_not_follow_how_many_are_wanted(bridge):
    def keys(realizations):
        scene = bridge.replace({"run.realizations": realizations})
        return [task.key for task in Realizations.of(prepared(scene), MonteCarlo()).tasks(0, 16)]

    assert keys(80) == keys(64) == keys(1000)
    assert keys(32) != keys(64)  # more batches in each
