import numpy as np
import pytest

from harvester.estimators import estimate_all
from harvester.output_estimates import estimate_output
from harvester.parameters import scale
from harvester.scene import Scene
from harvester.studies.piece_file import Piece
from harvester.studies.pieces import Store, compute, key_of


@pytest.fixture(scope="module")
def bridge():
    scene = Scene.load("device").replace(
        {"load.netlist": "bridge", "run.duration": 2.0, "run.settle": 0.5, "run.realizations": 2}
    )
    return scene


@pytest.fixture(scope="module")
def piece(bridge, pool):
    call = {"engine": "circuit", "indices": [0, 1], "step": "default", "window": (1.0, 1.5)}
    return pool.map("harvester.studies.pieces:compute", [{"scene": bridge, **call}])[0]


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


def test_half_a_file_is_no_piece(piece, tmp_path):
    store = Store(tmp_path)
    store.put("key", piece)
    path = tmp_path / "points" / "key.npz"
    whole = path.read_bytes()
    for share in (0.0, 0.3, 0.9):
        path.write_bytes(whole[: int(share * len(whole))])
        assert Store(tmp_path).get("key") is None


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
