"""Files that are no records, or want to be more than a machine holds: one line each."""

import bz2
import gzip
import io
import lzma
import os
import resource
import socket
import struct
import warnings
import zipfile

import numpy as np
import pytest
from scipy.io import wavfile

from harvester.base import reading
from harvester.base.errors import SceneError
from harvester.records import formats
from harvester.records import wav as wav_format
from harvester.scene.model import Scene

SAMPLES = np.sin(0.37 * np.arange(200))
FIELDS = np.zeros(200, [("t", "f8"), ("when", "M8[s]"), ("pair", "f4", 2), ("a", ">f4")])
FIELDS["a"] = SAMPLES


def read(path, **keys):
    """The samples of a record in a scene."""
    table = {"kind": "record", "file": str(path), "unit": "scaled", "sampling_rate": 100.0}
    table |= {"detrend": "none", **keys}
    table = {key: value for key, value in table.items() if value is not None}
    scene = Scene.read("linear").replace({"excitation": table, "run": {"duration": 0.5}})
    return scene.excitation.samples


def refused(path, *words, **keys):
    with pytest.raises(SceneError) as caught:
        read(path, **keys)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 600
    for word in (path.name, *words):
        assert word in message


def npy(values):
    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=True)
    return stream.getvalue()


def claim(shape, descr="<f8", rest=b"\0" * 800):
    """A .npy file whose header says what it likes."""
    header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + rest


def wav(channels=1, rate=100, bits=16, stride=2, claimed=400, size=400, tag=1, order="<"):
    form = struct.pack(f"{order}HHIIHH", tag, channels, rate, rate * stride, stride, bits)
    kind = b"RIFF" if order == "<" else b"RIFX"
    head = kind + struct.pack(f"{order}I", 36 + size) + b"WAVEfmt " + struct.pack(f"{order}I", 16)
    data = (SAMPLES * 2000).astype(f"{order}i2").tobytes()[:size]
    return head + form + b"data" + struct.pack(f"{order}I", claimed) + data


def zipped():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("arr_0.npy", b"\0" * 10**7)
    return stream.getvalue()


LINES = "".join(f"{value:.6f}\n" for value in SAMPLES)
DEEP = claim("(" * 4000 + ")" * 4000)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.npy", b"", ["it is empty"]),
        ("empty.wav", b"", ["it is empty"]),
        ("empty.csv", b"", ["it is empty"]),
        ("magic.npy", b"\x93NUMPY", ["not a valid .npy"]),
        ("pickle.npy", b"\x80\x04K\x01.", ["does not begin as a .npy"]),
        ("objects.npy", npy(np.array([{}, 1], object)), ["not a valid .npy"]),
        ("archive.npy", zipped(), ["zip archive", "unpack"]),
        ("archive.wav", zipped(), ["zip archive"]),
        ("bomb.csv", gzip.compress(b"\0" * 10**6), ["gzip"]),
        ("bomb.npy", bz2.compress(b"\0" * 10**6), ["bzip2"]),
        ("bomb.txt", lzma.compress(b"\0" * 10**6), ["xz"]),
        ("claims.npy", claim("(10**15,)"), ["not a valid .npy"]),
        ("tera.npy", claim("(1000000000000,)"), ["not a valid .npy"]),
        ("square.npy", claim("(4294967296, 4294967296)"), ["not a valid .npy"]),
        ("minus.npy", claim("(-5,)"), ["not a valid .npy"]),
        ("digits.npy", claim(f"({'9' * 5000},)"), ["not a valid .npy"]),
        ("deep.npy", DEEP, ["not a valid .npy"]),
        ("no width.npy", claim("(1000000000, 0)"), ["no samples"]),
        ("no size.npy", claim("(100000000000000,)", "|S0"), ["not"]),
        ("call.npy", claim("__import__('os').system('true')"), ["not a valid .npy"]),
        ("short.npy", npy(SAMPLES)[:-8], ["not a valid .npy"]),
        ("none.npy", npy(SAMPLES[:0]), ["no samples"]),
        ("point.npy", npy(1.0), ["shape ()"]),
        ("cube.npy", npy(np.zeros((9, 9, 9))), ["shape (9, 9, 9)"]),
        ("complex.npy", npy(SAMPLES + 1j), ["complex numbers", "identify"]),
        ("bool.npy", npy(SAMPLES > 0), ["bool"]),
        ("text.npy", npy(SAMPLES.astype(str)), ["str"]),
        ("bytes.npy", npy(SAMPLES.astype("S9")), ["bytes"]),
        ("dates.npy", npy(np.arange(200).astype("M8[s]")), ["datetime64"]),
        ("huge.npy", npy(SAMPLES * 1e300), ["largest sample", "e+299", "unit"]),
        ("tiny.npy", npy(SAMPLES * 1e-300), ["largest sample", "e-301"]),
        ("four.wav", b"RIFF", ["does not begin as a .wav"]),
        ("no data.wav", wav()[:36], ["ends before its samples"]),
        ("no fmt.wav", b"RIFF\0\0\0\0WAVEdata\4\0\0\0\0\0\0\0", ["fmt"]),
        ("cut fmt.wav", b"RIFF\0\0\0\0WAVEfmt \4\0\0\0\1\0\1\0data\4\0\0\0\0\0\0\0", ["fmt"]),
        ("chunks.wav", b"RIFF\0\0\0\0WAVE" + b"abcd\0\0\0\0" * 10**5, ["1000 chunks"]),
        ("channels.wav", wav(channels=0), ["0 channels"]),
        ("rate.wav", wav(rate=0), ["0 Hz"]),
        ("bits.wav", wav(bits=0), ["0 bits"]),
        ("stride.wav", wav(stride=0), ["in 0 bytes"]),
        ("thousand.wav", wav(channels=1000), ["1000 channels"]),
        ("mp3.wav", wav(tag=85), ["0x55"]),
        ("half.wav", wav(tag=3), ["16 bits"]),
        ("cut.wav", wav(size=300), ["claims 400", "contains 300", "truncated"]),
        ("giant.wav", wav(claimed=2**32 - 16), ["truncated"]),
        ("none.wav", wav(claimed=0), ["no samples"]),
        ("nul.csv", LINES.encode() + b"\0", ["NUL", "UTF-8"]),
        ("wide.csv", LINES.encode("utf-16"), ["UTF-16", "UTF-8"]),
        ("latin.csv", "a,²\n".encode("latin-1") + b"1,2\n" * 99, ["UTF-8"]),
        ("ragged.csv", b"1,2\n" * 70 + b"1\n" + b"1,2\n" * 70, ["line 71", "1 columns"]),
        ("long.csv", b"1," * 10**6, ["line 1", "one line per sample"]),
        ("hex.csv", b"0x1p3\n" * 99, ["no numbers"]),
        ("python.csv", b"1_000\n2_000\n" * 99, ["no numbers"]),
        ("words.csv", ("\x1b[31m" + "x" * 9999 + ",b\n").encode() + b"1,2\n" * 99, ["x1b[31m"]),
        ("many.csv", b"1.5," * 20_000 + b"1\n", ["0 … 20000"]),
        ("huge.csv", b"1e300\n-1e300\n" * 99, ["largest sample"]),
        ("infinite.csv", b"inf\n" * 99, ["without a number"]),
    ],
)
def test_what_is_no_record_is_refused_in_one_line(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refused(path, *words)


@pytest.mark.parametrize("name", ["motion.csv", "motion.npy", "motion.wav"])
def test_only_plain_files_are_read(tmp_path, name):
    path = tmp_path / name
    refused(path, "No such file")
    os.mkfifo(path)
    refused(path, "a pipe")
    path.unlink()
    path.mkdir()
    refused(path, "a folder")
    path.rmdir()
    path.symlink_to(path)
    refused(path, "symbolic links")
    path.unlink()
    for device in ("zero", "stdin", "full"):
        path.symlink_to(f"/dev/{device}")
        if not path.is_file():
            refused(path, "plain file")
        path.unlink()


def test_a_socket_is_no_record(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket.csv")
        refused(tmp_path / "socket.csv", "a socket")


@pytest.mark.parametrize("name", ["a" * 5000 + ".csv", "a\ud800.csv", "\x1b]0;title\x07\n.csv"])
def test_names_that_no_file_has(tmp_path, name):
    with pytest.raises(SceneError) as caught:
        read(tmp_path / name)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize("suffix", ["csv", "npy", "wav"])
def test_a_large_file_is_refused_by_its_size_without_being_read(tmp_path, suffix):
    path = tmp_path / f"motion.{suffix}"
    with path.open("wb") as stream:
        stream.truncate(10**12)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused(path, "too large", "1e+06 MB")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000


def test_a_record_never_takes_more_than_its_share_of_the_memory(tmp_path, monkeypatch):
    physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert reading.memory_limit() <= reading.MEMORY_SHARE * physical
    path = tmp_path / "motion.npy"
    np.save(path, SAMPLES)
    monkeypatch.setattr(formats, "memory_limit", lambda: 250 * formats.BYTES_PER_SAMPLE)
    assert read(path).size == 200
    refused(path, "knot_spacing", "allows 250", knot_spacing=1e-3)
    np.save(path, np.tile(SAMPLES, 2).astype(np.float32))
    refused(path, "400 samples", "allows 250")
    np.save(path, np.tile(SAMPLES, 10))
    refused(path, "too large")
    np.save(path, SAMPLES)
    part = {"kind": "record", "file": str(path), "unit": "scaled", "sampling_rate": 100.0}
    with pytest.raises(SceneError, match="400 samples in all"):
        Scene.read("linear").replace(
            {"excitation": {"kind": "sum", "parts": [part, part]}, "run": {"duration": 0.5}}
        )


def test_a_gap_of_the_time_column_makes_no_endless_grid(tmp_path):
    time = np.arange(200) / 100.0
    time[100:] += 1e9
    path = tmp_path / "motion.npy"
    np.save(path, np.column_stack([time, SAMPLES]))
    refused(path, "cut the record", column=1, time_column=0, sampling_rate=None, mend=["uneven"])
    for far in (1e300, -1e308):
        time[3] = far
        np.save(path, np.column_stack([time, SAMPLES]))
        refused(path, "in seconds", column=1, time_column=0, sampling_rate=None)


@pytest.mark.parametrize("band", [[1e-9, 10.0], [5.0, 5.0 + 1e-9], [0.0, 1e-9]])
def test_a_band_that_rounding_would_lose_is_refused(tmp_path, band):
    path = tmp_path / "motion.npy"
    np.save(path, SAMPLES)
    refused(path, "excitation.band", band=band)


DTYPES = ["f2", "f4", "f8", "g", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"]


@pytest.mark.parametrize("dtype", [*DTYPES, *(f">{dtype}" for dtype in DTYPES if dtype != "g")])
def test_every_real_number_of_numpy_is_read(tmp_path, dtype):
    path = tmp_path / "motion.npy"
    values = (SAMPLES * 50 + 60).astype(dtype)
    np.save(path, np.asfortranarray(np.column_stack([values, values[::-1]])))
    np.testing.assert_array_equal(read(path, column=1), values[::-1].astype(float))


def test_fields_are_columns_by_their_names(tmp_path):
    path = tmp_path / "motion.npy"
    np.save(path, FIELDS)
    np.testing.assert_array_equal(read(path, column="a"), FIELDS["a"].astype(float))
    refused(path, "datetime64", column="when")
    refused(path, "one real number", column="pair")
    refused(path, "t, when, pair, a")


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int32, np.float32, np.float64])
@pytest.mark.parametrize("channels", [1, 2])
def test_sound_files_are_read_as_scipy_reads_them(tmp_path, dtype, channels):
    path = tmp_path / "motion.wav"
    whole = np.issubdtype(dtype, np.integer)
    top = np.iinfo(dtype).max / 2.0 if whole else 1.0
    values = ((SAMPLES + 1.0) * top).astype(dtype)
    wavfile.write(path, 100, np.column_stack([values] * channels))
    expected = wavfile.read(path)[1].reshape(200, -1)[:, -1].astype(float)
    if dtype is np.uint8:
        expected = (expected - 128.0) / 128.0
    elif whole:
        expected /= -float(np.iinfo(dtype).min)
    found = read(path, column=channels - 1, sampling_rate=None)
    np.testing.assert_allclose(found, expected, rtol=1e-15)


@pytest.mark.parametrize("order", ["<", ">"])
def test_three_bytes_a_sample_either_way_round(order):
    whole = np.round(SAMPLES * (2**23 - 1)).astype(int)
    data = b"".join(
        int(n).to_bytes(3, "little" if order == "<" else "big", signed=True) for n in whole
    )
    content = wav(bits=24, stride=3, claimed=600, size=0, order=order) + data
    (found,) = wav_format.read(content).take([0])
    np.testing.assert_allclose(found, whole / 2.0**23, rtol=1e-15)


def test_a_sound_file_of_unknown_length_is_read_to_its_end(tmp_path):
    path = tmp_path / "motion.wav"
    path.write_bytes(wav(claimed=2**32 - 1))
    expected = np.trunc(SAMPLES * 2000) / 2.0**15
    np.testing.assert_array_equal(read(path, sampling_rate=None), expected)


def test_a_record_that_is_quiet_at_first_has_notes(tmp_path):
    path = tmp_path / "motion.npy"
    np.save(path, np.where(np.arange(400) < 150, 0.0, np.sin(np.arange(400))))
    table = {"kind": "record", "file": str(path), "unit": "scaled", "sampling_rate": 100.0}
    table["detrend"] = "none"
    scene = Scene.read("linear").replace({"excitation": table, "run": {"duration": 0.5}})
    assert "factor of inf" in scene.excitation.notes(0.01, 100.0, scene.run)[1]


def test_lines_end_in_any_way(tmp_path):
    for end in ("\n", "\r\n", "\r"):
        path = tmp_path / "motion.csv"
        path.write_bytes(b"\xef\xbb\xbfa\n".replace(b"\n", end.encode()))
        with path.open("ab") as stream:
            stream.write(LINES.replace("\n", end).encode())
        np.testing.assert_allclose(read(path, column="a"), SAMPLES, atol=1e-6)
