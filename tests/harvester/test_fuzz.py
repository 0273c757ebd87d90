"""Scenes and records from anywhere: only named errors come out, each within a second."""

import datetime
import io
import math

import numpy as np
import pytest
from fuzzing import budget, ends_well
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import wavfile

from harvester.scene.model import Scene
from harvester.scene.source import BUILT_IN

SAMPLES = np.sin(0.37 * np.arange(200))
NUMBERS = st.one_of(
    st.sampled_from([0, -1, 1, 10**400, -(10**4000), 2**63, 2**128, 0.5, 5e-324, 1e308, math.inf]),
    st.integers(),
    st.floats(),
    st.floats(width=32).map(np.float32),
    st.integers(-5, 5).map(np.int16),
)
WORDS = st.one_of(
    st.sampled_from(["scaled", "SI", "record", "sum", "sine", "white", "prescribed_displacement"]),
    st.sampled_from(["bridge", "resistor", "../resistor.lib", "/dev/zero", "", ".", "a\0b"]),
    st.text(max_size=30),
    st.just("x" * 100_000),
)
ODD = st.one_of(
    st.none(), st.booleans(), st.binary(max_size=9), st.dates(), st.just({1, 2}), st.just(object())
)
VALUES = st.recursive(
    st.one_of(NUMBERS, WORDS, ODD, st.just(np.arange(3.0)), st.just(datetime.time(1))),
    lambda inner: st.one_of(
        st.lists(inner, max_size=5), st.dictionaries(st.text(max_size=9), inner, max_size=5)
    ),
    max_leaves=8,
)
PARTS = st.fixed_dictionaries(
    {"kind": WORDS},
    optional={
        name: VALUES
        for name in ("parts", "file", "unit", "amplitude", "frequency", "intensity", "knot_spacing")
    },
)
KEYS = sorted(
    {
        f"{table}.{key}"
        for name in Scene.names()
        for table, values in Scene.read(name).to_tables().items()
        for key in (values if isinstance(values, dict) else ())
    }
    | {"units", "length_scale", "load", "stoppers", "excitation", "run", "load.netlist"}
    | {"load.parameters", "load.parameters.resistance", "load.subcircuit", "excitation.parts"}
)


@pytest.mark.slow
@budget(100)
@given(
    name=st.sampled_from(Scene.names()),
    changes=st.dictionaries(
        st.one_of(st.sampled_from(KEYS), st.text(max_size=12)),
        st.one_of(VALUES, PARTS, st.lists(PARTS, max_size=3)),
        max_size=3,
    ),
)
def test_fuzz_values_of_a_scene(name, changes):
    with ends_well():
        Scene.read(name).replace(changes)


@budget(100)
@given(tables=st.one_of(VALUES, st.dictionaries(st.sampled_from(KEYS), VALUES)))
def test_fuzz_tables(tables):
    with ends_well():
        Scene.from_tables(tables)


def spliced(whole, pieces):
    """Bytes with a stretch taken out, and a piece or another stretch of them put in."""
    place = st.integers(0, len(whole))
    cut = st.tuples(place, st.integers(0, 40), st.one_of(pieces, st.binary(max_size=8)))

    def apply(cuts):
        content = whole
        for start, length, piece in cuts:
            content = content[:start] + piece + content[start + length :]
        return content

    return st.lists(cut, max_size=4).map(apply)


FRAGMENTS = [b"[" * 3000, b"{a=" * 3000, b"a." * 30_000, b"'''", b'"""', b"[[run]]", b"[run]"]
NUMERALS = [b"9" * 5000, b"0x" + b"f" * 999, b"1e999", b"nan", b"1979-05-27", b"true", b"kind=[]"]
CHARACTERS = [b"\xff\x00", b"\x1b[31m", b"\r", b"\\u0000", b'"\\ud800"', b"=", b"\xef\xbb\xbf"]
TOML_PIECES = st.sampled_from([*FRAGMENTS, *NUMERALS, *CHARACTERS])


@budget(150)
@given(content=spliced((BUILT_IN / "paper.toml").read_bytes(), TOML_PIECES))
def test_fuzz_scene_file(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    path.write_bytes(content)
    with ends_well():
        Scene.read(path)


@budget(100)
@given(text=st.one_of(st.tuples(st.sampled_from(KEYS), st.text(max_size=30)).map("=".join), WORDS))
def test_fuzz_overrides(text):
    with ends_well():
        Scene.read("paper", [text])


def written(suffix):
    stream = io.BytesIO()
    if suffix == "npy":
        np.save(stream, SAMPLES)
    elif suffix == "wav":
        wavfile.write(stream, 100, (SAMPLES * 2000).astype(np.int16))
    else:
        np.savetxt(stream, np.column_stack([np.arange(200) / 100, SAMPLES]), fmt="%.6g")
    return stream.getvalue()


BYTES = [b"\0" * 4, b"\xff" * 4, b"RIFX", b"data", b"\x1f\x8b", b"(" * 99, b"9" * 40, b"9" * 5000]
DTYPES = [b"'|O'", b"<c16", b"<U9", b"?", b"f2", b"True"]
FIELDS = [b"1e999", b"1e300", b"nan", b"-1", b",", b";", b"\n", b"#", b"1_0"]
RECORD_PIECES = st.sampled_from([*BYTES, *DTYPES, *FIELDS])
RECORD_KEYS = st.fixed_dictionaries(
    {},
    optional={
        "column": st.sampled_from([0, 1, 7, "a", 10**400]),
        "time_column": st.sampled_from([0, 1, "t"]),
        "sampling_rate": st.sampled_from([100.0, 1e-30, 1e30]),
        "mend": st.just(["nan", "uneven", "clipped"]),
        "band": st.sampled_from([[0.0, 10.0], [1.0, 20.0], [1e-30, 1e-29]]),
        "detrend": st.just("linear"),
        "repetition": st.just("periodic"),
        "knot_spacing": st.sampled_from([1e-30, 1e-3, 1e-6]),
    },
)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["npy", "wav", "csv"])
def test_fuzz_records(tmp_path, suffix):
    path = tmp_path / f"motion.{suffix}"

    @budget(120)
    @given(content=spliced(written(suffix), RECORD_PIECES), keys=RECORD_KEYS)
    def read(content, keys):
        path.write_bytes(content)
        table = {"kind": "record", "file": str(path), "unit": "scaled", **keys}
        with ends_well():
            scene = Scene.read("linear").replace({"excitation": table, "run": {"duration": 0.3}})
            assert np.isfinite(scene.excitation.samples).all()
            scene.excitation.notes(scene.excitation.interval, 1.0, scene.run)

    read()
