import dataclasses
import io
import json
import os
import socket
import zipfile

import numpy as np
import pytest

from harvester.errors import SimulatorAborted, SimulatorCrashed, SimulatorTimeout, SolutionDiverged
from harvester.estimates.means import estimate_all
from harvester.estimates.output_side import estimate_output
from harvester.record.moments import PRODUCTS
from harvester.scene.model import Scene
from harvester.scene.units import scale
from harvester.studies.piece_file import DIGEST, HEADER, MOST_BYTES, Piece, _digest, packed
from harvester.studies.pieces import Store, compute, failed, key_of
from harvester.studies.pieces import compute as pieces_compute
from harvester.studies.runs import make_source


@pytest.fixture(scope="module")
def bridge():
    scene = Scene.load("device").replace(
        {"load.netlist": "bridge", "run.duration": 2.0, "run.settle": 0.5, "run.realizations": 2}
    )
    return scene


@pytest.fixture(scope="module")
def piece(bridge, pool):
    call = {"engine": "circuit", "indices": [0, 1], "step": "default", "window": (1.0, 1.5)}
    return pool.map(pieces_compute, [{"scene": bridge, **call}])[0]


def test_a_piece_read_back_gives_the_same_numbers(bridge, piece, tmp_path):
    Store(tmp_path).put("key", piece)
    read = Store(tmp_path).get("key")
    parameters, _ = scale(bridge)

    def values(some):
        found = estimate_all(some.moments, parameters) | estimate_output(some.moments)
        return {name: repr((e.estimate, e.standard_error)) for name, e in found.items()}

    assert values(read) == values(piece)
    np.testing.assert_array_equal(read.waveform, piece.waveform)
    assert list((tmp_path / "points").iterdir()) == [tmp_path / "points" / "key.npz"]


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
    np.savez(file, **arrays, digest=np.array(_digest(arrays)))
    return file.getvalue()


def header(**content):
    return np.array(json.dumps({"key": "key", "failure": "", "seconds": 0.0} | content))


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
        **(dict(np.load(io.BytesIO(whole))) | {"0.products": np.zeros(8)})
    ),
    "another key": lambda whole, spoor: rewritten(whole, header=header(key="other", quantities={})),
    "a nested header": lambda whole, spoor: rewritten(whole, header=np.array("[" * 50_000)),
    "a long number": lambda whole, spoor: rewritten(
        whole, header=np.array('{"key": "key", "seconds": ' + "9" * 5000 + "}")
    ),
    "no number": lambda whole, spoor: rewritten(
        whole, **{"0.products": np.full(len(PRODUCTS), np.nan)}
    ),
    "another waveform": lambda whole, spoor: rewritten(whole, waveform=np.zeros((2, 3))),
    "another shape": lambda whole, spoor: rewritten(whole, **{"0.integrals": np.ones((3, 2))}),
    "other wells": lambda whole, spoor: rewritten(whole, **{"0.saddles": np.zeros(2)}),
    "negative times": lambda whole, spoor: rewritten(
        whole, **{"1.integrals": -np.load(io.BytesIO(whole))["1.integrals"]}
    ),
    "a field too many": lambda whole, spoor: rewritten(whole, **{"0.other": np.zeros(3)}),
    "a crash": lambda whole, spoor: npz(
        **{HEADER: (h := header(failure="SimulatorCrashed: signal 9", quantities={}))},
        **{DIGEST: np.array(_digest({HEADER: h}))},
    ),
    "nothing computed": lambda whole, spoor: npz(
        **{HEADER: (h := header(quantities={}))}, **{DIGEST: np.array(_digest({HEADER: h}))}
    ),
}


@pytest.fixture
def misfit(bridge):
    source = dataclasses.replace(make_source(bridge, "circuit", "default", "1"), size=2)
    return lambda piece: source.misfit(0, piece)


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_no_piece_is_named_and_written_again(piece, misfit, tmp_path, kind):
    Store(tmp_path).put("key", piece)
    assert Store(tmp_path).get("key", misfit)
    path, spoor = tmp_path / "points" / "key.npz", tmp_path / "spoor"
    path.write_bytes(FOREIGN[kind](path.read_bytes(), spoor))
    store = Store(tmp_path)
    assert store.get("key", misfit) is None
    assert store.get("key", misfit) is None
    (line,) = store.refused.values()
    assert line.startswith(str(path))
    assert line.endswith(": computed again")
    assert line.isprintable()
    assert not spoor.exists()
    store.put("key", piece)
    assert Store(tmp_path).get("key", misfit)


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
def test_what_is_no_file_is_left_there_and_the_piece_not_kept(piece, tmp_path, make):
    (tmp_path / "points").mkdir()
    somebodys, path = tmp_path / "points" / "somebodys", tmp_path / "points" / "key.npz"
    somebodys.write_bytes(packed("key", piece))
    before = somebodys.read_bytes()
    make(path)
    kind = os.lstat(path).st_mode
    store = Store(tmp_path)
    assert store.get("key") is None
    store.put("key", piece)
    assert store.get("key") is piece
    assert "not kept" in store.refused["key"]
    assert os.lstat(path).st_mode == kind
    assert somebodys.read_bytes() == before


@pytest.mark.parametrize(
    ("error", "kept"),
    [
        (SolutionDiverged("at 1 s"), True),
        (SimulatorAborted("timestep too small"), True),
        (SimulatorAborted("malloc: can't allocate 3 bytes"), False),
        (SimulatorCrashed("was killed by signal 9"), False),
        (SimulatorTimeout("10 s"), False),
        (MemoryError(), False),
        (OSError(28, "No space left on device"), False),
    ],
)
def test_what_another_run_may_end_otherwise_is_not_kept(tmp_path, error, kept):
    store = Store(tmp_path)
    store.put("key", failed(error))
    assert store.get("key").failure.startswith(type(error).__name__)
    assert (Store(tmp_path).get("key") is not None) == kept


def test_a_failure_is_kept_by_name(tmp_path):
    Store(tmp_path).put("key", Piece(failure="SolutionDiverged: at 1 s"))
    assert Store(tmp_path).get("key").failure == "SolutionDiverged: at 1 s"


def test_a_closure_that_refuses_is_a_piece_that_says_so():
    record = Scene.load("device").replace({"excitation.correlation_time": 100.0})
    piece = compute(record, "consistent", [0], "default", None, None)
    assert piece.failure.startswith("AveragingError")


def test_the_key_follows_all_that_decides_the_numbers(bridge):
    def key(scene=bridge, engine="circuit", indices=(0,), step="default", version="1"):
        return key_of(scene.digest(), engine, indices, step, None, version)

    others = [
        key(bridge.replace({"run.seed": 2})),
        key(bridge.replace({"load.parameters.resistance": 1.0})),
        key(engine="monte-carlo"),
        key(indices=(1,)),
        key(step="fine"),
        key(version="2"),
    ]
    assert len({key(), *others}) == 7
    assert key() == key()
