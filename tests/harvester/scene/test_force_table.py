"""[oscillator] force_table and restoring_force_range: files, checks, round trip."""

import pickle

import pytest
from device_scenes import MAGNETS

from harvester.averaging.of_scene import average
from harvester.base.errors import AveragingError, SceneError, SpringRangeLeft
from harvester.engines.simulate import simulate
from harvester.scene.force_file import read_points_of
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers

TABLE = [*MAGNETS]
SOFT = {
    "oscillator.restoring_force": [0.0, 4.0, 0.0, -1.5],
    "oscillator.restoring_force_range": [-1.2, 1.2],
}


def scene_of(table, **more):
    changes = {"oscillator.force_table": table}
    changes |= {f"oscillator.{key}": value for key, value in more.items()}
    return Scene.read("duffing").replace(changes)


def test_a_scene_holds_its_points_and_comes_back_from_its_tables():
    scene = scene_of(TABLE)
    tables = scene.to_tables()["oscillator"]
    assert "linear_stiffness" not in tables
    assert "force_interpolation" not in tables
    assert Scene.from_dict(scene.to_dict()) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(scene) == hash(scene_of(TABLE))
    assert scene.digest() != scene_of([*TABLE[:-1], [1.5, 8.1]]).digest()
    assert not any("force_table" in key for key in numbers(scene))
    back = scene.replace({"oscillator.linear_stiffness": 1.0})
    assert back.oscillator.force_table is None


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(f"{x},{f}" for x, f in TABLE),
        "x (m);F (N)\n" + "\n".join(f"{x}; {f}" for x, f in TABLE),
        "# magnets\n" + "\n".join(f"{x}\t{f} # point" for x, f in TABLE) + "\n\n",
        "\n".join(f"  {x}   {f}" for x, f in TABLE),
    ],
    ids=["commas", "heading", "tabs and comments", "blanks"],
)
def test_a_file_of_points_is_read_beside_the_scene(tmp_path, text):
    (tmp_path / "magnets.csv").write_text(text)
    tables = (
        'units = "scaled"\n[oscillator]\ndamping = 0.1\nforce_table = "magnets.csv"\n'
        "[piezo]\ncoupling = 0.4\n[load]\ndecay_rate = 0.3\n"
        '[excitation]\nkind = "white"\nintensity = 0.1\n[run]\nduration = 1.0\n'
    )
    (tmp_path / "mine.toml").write_text(tables)
    scene = Scene.read(tmp_path / "mine.toml")
    assert [list(each) for each in scene.oscillator.force_table] == TABLE
    (tmp_path / "magnets.csv").unlink()
    assert scene.replace({"oscillator.damping": 0.2}).oscillator.damping == 0.2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2\n3,4,5\n", "line 2.*must hold two numbers, a displacement and a force"),
        ("1,2\nthree,4\n", "line 2"),
        ("1,nan\n", "line 1"),
        ("", "0 lines with a displacement and a force: must be at least 2"),
    ],
)
def test_a_file_that_is_no_table_is_refused_by_its_line(tmp_path, text, words):
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(SceneError, match=words):
        scene_of(str(file))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x [um];F [mN]\n-1,000;-2\n1,000;2\n", "1000 or -1.000: save it without"),
        ("x [mm],F [MN]\n-1,-1\n1,1\n", r"column F \[MN\]: MN is ambiguous: millinewtons"),
    ],
)
def test_a_number_or_a_unit_with_two_readings_is_refused(tmp_path, text, words):
    (tmp_path / "two.csv").write_text(text)
    tables = {"units": "SI", "oscillator": {"force_table": str(tmp_path / "two.csv")}}
    with pytest.raises(SceneError, match=words):
        read_points_of(tables, "a")


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(SceneError, match=r"force_table: .*nowhere\.csv: the table of force cannot"):
        scene_of("nowhere.csv")


@pytest.mark.parametrize(
    ("table", "more", "words"),
    [
        ([[-1, -1], [1, 1], [0.5, 2]], {}, r"force_table\[2\].*must ascend"),
        ([[1, -1], [2, 1]], {}, "on both sides of 0"),
        ([[-1, -1, 0], [2, 1]], {}, r"force_table\[0\]"),
        ([[k - 20, k - 20] for k in range(41)], {}, 'at most 33 .*"smooth"'),
        ([[-1, -1], [1, 1]], {"force_interpolation": "smooth"}, "at least 4"),
        ([[-1, 1], [1, -1]], {}, "ends on the left with a slope of -1.*restoring_force_range"),
        ([[-1, -1], [0, 1], [1, 0.5]], {}, "ends on the right with a slope"),
        (TABLE, {"restoring_force": [0, 1]}, "exclude each other"),
        (TABLE, {"restoring_force_range": [0.1, 2.0]}, "a displacement below 0 and one above"),
        (
            [[-2, -3], [-1, 1], [0.5, 2.0], [2, 3]],
            {"restoring_force_range": [-0.5, 1.0]},
            "no stable rest position in this range",
        ),
    ],
)
def test_tables_that_no_device_has_are_refused(table, more, words):
    tables = Scene.read("duffing").to_tables()
    oscillator = {"damping": 0.1, "force_table": table, **more}
    with pytest.raises(SceneError, match=words):
        Scene.from_tables({**tables, "oscillator": oscillator})


def test_a_softening_spring_needs_its_range():
    scene = Scene.read("duffing")
    with pytest.raises(SceneError, match=r"unbounded on the right.*restoring_force_range"):
        scene.replace({"oscillator.restoring_force": SOFT["oscillator.restoring_force"]})
    soft = scene.replace(SOFT)
    assert soft.to_tables()["oscillator"]["restoring_force_range"] == (-1.2, 1.2)
    with pytest.raises(SceneError, match=r"start.displacement = 1.3: must lie within"):
        soft.replace({"start": {"displacement": 1.3}})


@pytest.mark.parametrize("method", ["fokker_planck", "paper", "consistent"])
def test_a_stationary_density_refuses_a_range_by_its_name(method):
    with pytest.raises(AveragingError, match="restoring_force_range: a stationary density"):
        average(Scene.read("duffing").replace(SOFT), method=method)


def test_averaging_over_orbits_refuses_a_table_by_its_name():
    with pytest.raises(AveragingError, match="the spring"):
        average(scene_of(TABLE), method="paper")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "load"),
    [
        pytest.param("monte-carlo", {}, marks=pytest.mark.exhaustive),
        ("circuit", {}),
        pytest.param("monte-carlo", {"netlist": "bridge"}, marks=pytest.mark.exhaustive),
    ],
)
def test_leaving_the_range_ends_the_run_with_time_and_place(pool, method, load):
    scene = Scene.read("device").replace(
        {
            "oscillator.restoring_force": [0.0, 60.0, 0.0, -1.5e5],
            "oscillator.restoring_force_range": [-0.011, 0.011],
            "run.duration": 10.0,
            "run.settle": 1.0,
            "run.realizations": 2,
            "excitation.intensity": 0.5,
        }
    )
    scene = scene.replace(load=load) if load else scene
    words = r"left oscillator.restoring_force_range = \[-0.011, 0.011\] at t = [\d.]+ s, x = -?0.01"
    with pytest.raises(SpringRangeLeft, match=words):
        simulate(scene, method=method, workers=1, runner=pool)
    calm = scene.replace({"excitation.intensity": 0.01})
    assert simulate(calm, method=method, workers=1, runner=pool).steps > 0
