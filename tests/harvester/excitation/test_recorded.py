import numpy as np
import pytest
from scipy import signal
from scipy.io import wavfile
from truths import Keep, flat, records_of

from harvester.averaging.of_scene import average
from harvester.base.errors import AveragingError, SceneError
from harvester.engines.simulate import simulate
from harvester.excitation import conditioning
from harvester.excitation import recorded as recorded_motion
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.studies.answers import longer_runs

pytestmark = pytest.mark.usefixtures("shared_workers")

RATE = 100.0


def motion(seconds=40.0, seed=1):
    """Filtered noise at 100 Hz."""
    rng = np.random.default_rng(seed)
    sections = signal.butter(2, [0.2, 8.0], "bandpass", fs=RATE, output="sos")
    return signal.sosfiltfilt(sections, rng.standard_normal(round(seconds * RATE) + 1))


def recorded(path, name="linear", run=(), **keys):
    """A built-in scene with a record, run over 30 s of it."""
    table = {"kind": "record", "file": str(path), "unit": "scaled", "sampling_rate": RATE}
    table["detrend"] = "none"
    if name != "linear":
        table["unit"] = "m/s^2"
    tables = Scene.read(name).to_tables()
    tables["excitation"] = {k: v for k, v in {**table, **keys}.items() if v is not None}
    run = {"duration": 30.0, **dict(run)}
    tables["run"] = {key: value for key, value in run.items() if value is not None}
    return Scene.from_tables(tables, name=name)


def saved(folder, values, suffix="npy"):
    path = folder / f"motion.{suffix}"
    np.save(path, values)
    return path


def test_a_linear_device_answers_a_record_as_lsim_says(tmp_path):
    samples = motion()
    scene = recorded(saved(tmp_path, samples))
    p = flat(scene)
    keep = Keep()
    for record in records_of(scene, 30.0):
        keep.add(record)
    matrix = np.array(
        [[0, 1, 0], [-p.linear_stiffness, -p.damping, -p.coupling], [0, 1, -p.decay_rate]]
    )
    time = np.arange(3001) / RATE
    system = (matrix, np.array([[0], [1], [0]]), np.eye(3), np.zeros((3, 1)))
    _, expected, _ = signal.lsim(system, samples[:3001], time)
    np.testing.assert_allclose(keep.at_knots(0.01), expected[1:], atol=1e-8)


def test_a_bump_of_the_base_pushes_the_mass_the_other_way(tmp_path):
    scene = recorded(saved(tmp_path, motion()), "device", unit="g")
    eta = noise_path(prepared(scene), 0).read(3001)
    np.testing.assert_allclose(eta, -9.80665 * motion()[:3001] / 0.01, rtol=1e-12)


def test_text_numpy_and_sound_files_hold_the_same_motion(tmp_path):
    samples = motion()
    time = np.arange(samples.size) / RATE
    columns = np.column_stack([time, samples, -samples])
    np.savetxt(
        tmp_path / "motion.csv",
        columns,
        fmt="%.10f",
        delimiter=";",
        header="time;north;up",
        comments="",
    )
    np.savetxt(tmp_path / "motion.txt", columns, fmt="%.10f", header="station 7")
    np.save(tmp_path / "motion.npy", columns)
    scaled = np.round(samples / 8.0 * 2**31).astype(np.int32)
    wavfile.write(tmp_path / "motion.wav", 100, scaled)
    dated = [f"2020-01-01T00:00:00,{value:.10f},ok" for value in samples]
    (tmp_path / "dated.csv").write_text("\n".join(["Station 7, 100 Hz", "when,a,flag", *dated]))
    reads = [
        {"file": "dated.csv", "column": "a"},
        {"file": "motion.csv", "column": "north", "time_column": "time", "sampling_rate": None},
        {"file": "motion.txt", "column": 1, "time_column": 0, "sampling_rate": None},
        {"file": "motion.npy", "column": 1},
        {"file": "motion.wav", "full_scale": 8.0, "sampling_rate": None},
    ]
    for keys in reads:
        name = keys.pop("file")
        scene = recorded(tmp_path / name, **keys)
        assert scene.excitation.interval == pytest.approx(0.01), name
        np.testing.assert_allclose(
            noise_path(prepared(scene), 0).read(3000), samples[:3000], atol=1e-8
        )


def test_trend_and_band_are_taken_away(tmp_path):
    time = np.arange(6000) / RATE
    wanted = np.sin(2 * np.pi * 2.0 * time)
    spoiled = wanted + 5.0 + 0.3 * time + np.sin(2 * np.pi * 30.0 * time)
    scene = recorded(saved(tmp_path, spoiled), detrend="linear", band=[0.5, 10.0])
    found = scene.excitation.samples
    # The filter's ends aside.
    np.testing.assert_allclose(found[1000:5000], wanted[1000:5000], atol=2e-3)


def test_closer_knots_follow_the_band_limited_signal(tmp_path):
    time = np.arange(6000) / RATE
    scene = recorded(saved(tmp_path, np.sin(2 * np.pi * 12.0 * time)), knot_spacing=0.003)
    assert scene.excitation.interval == pytest.approx(0.0025)
    fine = np.arange(4000, 20000)
    expected = np.sin(2 * np.pi * 12.0 * 0.0025 * fine)
    np.testing.assert_allclose(scene.excitation.samples[fine], expected, atol=1e-3)


def test_a_smooth_record_of_seven_samples_a_period_is_the_sine(tmp_path):
    time = np.arange(3000) / RATE
    path = saved(tmp_path, np.sin(2 * np.pi * 14.0 * time))
    scene = recorded(path, interpolation="smooth", run={"duration": 25.0})
    interval = scene.excitation.interval
    assert interval == pytest.approx(0.01 / 8)
    fine = np.arange(2000, 20000)
    expected = np.sin(2 * np.pi * 14.0 * interval * fine)
    # The lines between knots take 1 − (ω h)²/12 of a sine.
    taken = 1.0 - (2 * np.pi * 14.0 * interval) ** 2 / 12.0
    found = taken * scene.excitation.samples[fine]
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_record_faded_in_begins_at_nothing_and_is_itself_afterwards(tmp_path):
    samples = motion()
    found = recorded(saved(tmp_path, samples), fade_in=2.0).excitation.samples
    assert found[0] == 0.0
    assert found[100] == pytest.approx(0.5 * samples[100])
    assert found[200:] == pytest.approx(samples[200:])
    assert np.abs(found[:200]).max() <= np.abs(samples[:200]).max()


def test_a_repeated_record_has_no_seam_and_keeps_its_power(tmp_path):
    samples = motion(200.0)
    scene = recorded(
        saved(tmp_path, samples),
        repetition="periodic",
        run={"duration": 1000.0, "realizations": 3},
    )
    loop = scene.excitation.samples.size
    assert loop == samples.size - round(0.05 * samples.size)
    paths = [noise_path(prepared(scene), k).read(2 * loop) for k in range(3)]
    assert not np.array_equal(paths[0], paths[1])
    for path in paths:
        np.testing.assert_array_equal(path[:loop], path[loop:])
        largest = np.abs(np.diff(samples)).max()
        assert np.abs(np.diff(path)).max() <= 1.2 * largest
        # Two hundred seconds of it: the cross-fade is a twentieth.
        assert np.mean(path**2) == pytest.approx(np.mean(samples**2), rel=0.05)


def faulty(kind):
    """(samples, keys) of a record with one fault."""
    samples = motion()
    time = np.arange(samples.size) / RATE
    if kind == "nan":
        samples[[100, 101, 2000]] = np.nan
    elif kind == "clipped":
        samples = np.clip(samples, -2.3 * samples.std(), 2.3 * samples.std())
    elif kind == "uneven":
        time = np.delete(time, slice(500, 520))
        samples = np.delete(samples, slice(500, 520))
        return np.column_stack([time, samples]), {"time_column": 0, "sampling_rate": None}
    return samples, {}


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("nan", ["3 of 4001 samples", "sample 100"]),
        ("clipped", ["are clipped"]),
        ("uneven", ["the time steps vary by", "times their mean"]),
    ],
)
def test_faults_are_refused_in_one_line_and_mended_as_asked(tmp_path, kind, words):
    values, keys = faulty(kind)
    path = saved(tmp_path, values)
    with pytest.raises(SceneError) as caught:
        recorded(path, **keys)
    message = str(caught.value)
    assert "\n" not in message
    for word in [*words, "motion.npy", f'mend = ["{kind}"]']:
        assert word in message
    found = recorded(path, mend=[kind], **keys).excitation.samples
    truth = motion()[: found.size]
    good = np.isin(np.arange(found.size), np.arange(499, 521), invert=True)
    if kind == "clipped":
        # Nearer to the truth than what was clipped.
        assert np.abs(found - truth).max() < 0.7 * np.abs(values - truth).max()
    else:
        np.testing.assert_allclose(found[good], truth[good], atol=0.5 * truth.std())
        assert np.isfinite(found).all()


def test_what_cannot_be_mended_says_so_at_once(tmp_path):
    samples = motion()
    clipped = np.clip(samples, -samples.std(), samples.std())
    lost = np.where(np.arange(samples.size) % 5 == 2, np.nan, samples)
    for values in (clipped, lost):
        for mend in ([], ["nan", "clipped"]):
            with pytest.raises(SceneError, match="more than 10% cannot be repaired"):
                recorded(saved(tmp_path, values), mend=mend)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"unit": "g"}, ['unit = "g"', '"scaled"']),
        ({"unit": "m/s2"}, ["excitation.unit", "did you mean m/s^2"]),
        ({"sampling_rate": None}, ["sampling_rate is missing"]),
        ({"sampling_rate": 0}, ["sampling_rate", "> 0"]),
        ({"column": 3}, ["column = 3", "0 … 0"]),
        ({"column": "north"}, ["'north'", "no header"]),
        ({"band": [1.0]}, ["excitation.band", "list of 2"]),
        ({"band": [1.0, 60.0]}, ["excitation.band", "50 Hz"]),
        ({"mend": ["nann"]}, ["mend[0]", "did you mean nan"]),
        ({"knot_spacing": 0.02}, ["knot_spacing", "0.01"]),
        ({"knot_spacing": 0.005, "interpolation": "smooth"}, ["knot_spacing", "keep one"]),
        ({"interpolation": "smoth"}, ["did you mean smooth"]),
        ({"fade_in": 1.0, "repetition": "periodic"}, ["fade_in", "periodic"]),
        ({"run": {"duration": 41.0}}, ["lasts 40 s", "periodic"]),
        ({"full_scale": 2.0}, ["full_scale", ".wav"]),
        ({"file": "nowhere.csv"}, ["nowhere.csv", "cannot be read"]),
        ({"file": 3}, ["excitation.file", "a text"]),
    ],
)
def test_a_mistake_is_refused_in_one_line_that_names_it(tmp_path, keys, words):
    path = saved(tmp_path, motion())
    with pytest.raises(SceneError) as caught:
        recorded(path, **keys)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,north\n", ["no numbers"]),
        ("time,acc\n" + "0,1,0,2\n" * 70, ["decimal commas", "semicolons"]),
        ("1.0\n2.0\n", ["too short", "2 samples"]),
        ("1,2\n" * 70 + "1\n" + "1,2\n" * 70, ["line 71", "1 columns"]),
        ("a,b\n" + "1,2\n" * 70, ["column is missing", "a, b"]),
        ("2.0\n" * 70, ["constant", "2"]),
    ],
)
def test_files_that_are_no_record_are_refused(tmp_path, text, words):
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        recorded(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.slow
def test_the_record_counts_by_its_content(tmp_path):
    path = saved(tmp_path, motion())
    scene = recorded(path)
    moved = recorded(path.rename(tmp_path / "moved.npy"))
    assert moved.digest() == scene.digest()
    assert moved.to_dict()["excitation"]["sha256"] == scene.excitation.sha256
    assert Scene.from_tables(moved.to_tables(), name="linear") == moved
    np.save(moved.excitation.file, motion(seed=2))
    assert moved.replace({"run.seed": 5}).excitation == moved.excitation
    # As in another process, which holds no samples.
    recorded_motion._knots.cache_clear()
    with pytest.raises(SceneError, match="the record has changed since the scene was read"):
        simulate(moved, method="monte-carlo", workers=1)


def test_the_file_is_looked_for_beside_its_scene(tmp_path, monkeypatch):
    np.savetxt(tmp_path / "motion.csv", motion())
    text = (
        'units = "scaled"\n[oscillator]\ndamping = 0.2\nlinear_stiffness = 4.0\n'
        "[piezo]\ncoupling = 1.0\n[load]\ndecay_rate = 2.0\n[excitation]\n"
        'kind = "record"\nfile = "motion.csv"\nunit = "scaled"\nsampling_rate = 100\n'
        "[run]\nduration = 30.0\n"
    )
    (tmp_path / "scene.toml").write_text(text)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    scene = Scene.read(tmp_path / "scene.toml")
    assert scene.excitation.file == str(tmp_path / "motion.csv")
    np.savetxt(elsewhere / "other.csv", motion())
    other = Scene.read(tmp_path / "scene.toml", ["excitation.file=other.csv"])
    assert other.excitation.file == str(elsewhere / "other.csv")


def test_notes_tell_what_a_reader_must_know(tmp_path, pool):
    envelope = np.exp(-(np.linspace(-2.0, 2.0, 4001) ** 2))
    path = saved(tmp_path, motion() * envelope + 0.05)
    notes = " ".join(simulate(recorded(path), method="monte-carlo", runner=pool).notes)
    for word in ("motion.npy", "linear between samples", "quarters", 'detrend = "none"'):
        assert word in notes
    again = recorded(path, repetition="periodic", run={"duration": 100.0})
    assert "repeated 2.6 times" in " ".join(
        simulate(again, method="monte-carlo", runner=pool).notes
    )


def test_gravity_is_taken_off_and_said(tmp_path):
    """A constant part of 9.80665 m/s² beside a motion, by default and where it is not wanted."""
    path = saved(tmp_path, motion() + 9.80665)
    scene = recorded(path, "device", detrend=None)
    expected = motion() - motion().mean()
    np.testing.assert_allclose(scene.excitation.samples, expected, atol=1e-12)
    said = " ".join(scene.excitation.notes(0.01, 76.0, scene.run))
    assert "its mean, 9.8" in said
    assert 'detrend = "none" keeps it' in said
    kept = recorded(path, "device").excitation
    np.testing.assert_allclose(kept.samples, motion() + 9.80665, atol=1e-12)
    assert "its mean, " not in " ".join(kept.notes(0.01, 76.0, scene.run))


def test_a_run_without_a_duration_lasts_as_long_as_its_record(tmp_path):
    path = saved(tmp_path, motion(seconds=40.0))
    assert recorded(path, run={"duration": None}).run.duration == pytest.approx(40.0)
    assert recorded(path, run={"duration": None, "settle": 10.0}).run.duration == 30.0
    tables = recorded(path).to_tables()
    del tables["run"]
    assert Scene.from_tables(tables).run.duration == pytest.approx(40.0)
    with pytest.raises(SceneError, match=r"run\.settle = 50: must be less than the record's 40 s"):
        recorded(path, run={"duration": None, "settle": 50.0})
    again = recorded(path, run={"duration": None}, repetition="periodic")
    # Its ends are faded into each other over a twentieth.
    assert again.run.duration == pytest.approx(0.95 * 40.0, rel=1e-3)
    with pytest.raises(SceneError, match=r"run.duration is missing"):
        Scene.read("device", ["run.duration=none"])


def test_the_cross_fade_goes_all_the_way_and_keeps_the_power():
    head, tail = np.zeros((2, 1000))
    head[:100], tail[-100:] = 1.0, 1.0
    rising, falling = conditioning.closed(head)[:50], conditioning.closed(tail)[:50]
    np.testing.assert_allclose(rising**2 + falling**2, 1.0)
    # From the sample after the record's last one to the first that is left as it was.
    assert (rising[0], falling[0]) == (0.0, 1.0)
    assert rising[-1] == pytest.approx(1.0, abs=1e-3)


def test_no_run_longer_than_the_record_is_advised(tmp_path):
    """Of 40 s: a run of 30 s may be longer, one that uses all of it may not, a periodic one may."""
    path = saved(tmp_path, motion())
    longer = "take a longer record than its 40 s"
    for run, repetition, advice in (
        ({}, None, "raise run.duration = 30"),
        ({"settle": 10.0}, None, longer),
        ({"settle": 10.0}, "periodic", "raise run.duration = 30"),
    ):
        scene = recorded(path, run=run, repetition=repetition)
        assert scene.excitation.longer_run(scene.run) == advice
    noise = {"kind": "ornstein-uhlenbeck", "intensity": 0.01, "correlation_time": 0.5}
    tables = scene.to_tables()
    tables["excitation"].pop("repetition")
    tables["excitation"] = {"kind": "sum", "parts": [tables["excitation"], noise]}
    scene = Scene.from_tables(tables, name="sum")
    assert longer_runs(scene) == f"{longer} (four times as long halves the errors)"
    short = recorded(path, run={"duration": 2.0, "settle": 38.0})
    assert "raise" not in simulate(short, method="monte-carlo")["mean_power"].note


def test_averaging_of_a_record_advises_what_applies_to_it(tmp_path):
    scene = recorded(saved(tmp_path, motion()), "paper", unit="scaled")
    with pytest.raises(AveragingError, match=r"simulate \(method monte-carlo\), or average a fit"):
        average(scene, method="fokker_planck")
    with pytest.raises(AveragingError, match=r"the spring is not linear: simulate$"):
        average(scene, method="spectral")
    with pytest.raises(AveragingError, match="the spring is not linear: simulate, or take the"):
        average("paper", method="spectral")
