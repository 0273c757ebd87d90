"""One calling convention: a scene however it is named, then options by keyword."""

import inspect

import pytest

import harvester
from harvester.cli.command_line import main
from harvester.engines.opening import RunnerOptions
from harvester.scene.calling import scene_of, takes_scene


def power(scene, *, method="circuit", step="default"):
    return scene.name, method, step


def test_a_scene_a_name_and_a_file_are_the_same(tmp_path):
    paper = harvester.Scene.read("paper")
    file = tmp_path / "paper.toml"
    file.write_bytes((harvester.scene.model.BUILT_IN / "paper.toml").read_bytes())
    assert scene_of(paper) is paper
    assert scene_of("paper") == scene_of(file) == scene_of(str(file)) == paper
    assert takes_scene(power)("paper", step=0.1) == ("paper", "circuit", 0.1)


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        ((), {"engine": "circuit"}, "no option engine; there are method, step"),
        ((), {"stop": 1.0}, "no option stop .did you mean step"),
        ((), {"zzzz": 1.0}, "no option zzzz; there are method, step"),
        ((), {"seed": 3}, r"no option seed; it is a value of the scene: .*run\.seed"),
        ((), {"resistance": 3}, r"'coil\.resistance' or 'load\.resistance': …"),
        (("circuit",), {}, "'circuit' is given without its name: .* method="),
    ],
)
def test_other_options_are_refused_with_the_nearest(arguments, options, words):
    with pytest.raises(harvester.UnknownOption, match=words) as raised:
        takes_scene(power)("paper", *arguments, **options)
    assert isinstance(raised.value, TypeError)


def test_an_option_of_the_command_is_answered_with_its_name_in_python():
    with pytest.raises(harvester.UnknownOption, match=r"no option sweep .did you mean over"):
        harvester.load_study("device", sweep={"load.resistance": [1e4]})


# What a study goes over, where it must be told, stands behind the scene.
OVER = {
    "frequency_response": [[1.0]],
    "optimum": ["load.decay_rate"],
    "sensitivity": [{}],
    "sweep": [{}],
}
NAMES = ["simulate", "average", "validate", "load_study", *OVER]


@pytest.mark.parametrize("name", NAMES)
def test_public_functions_take_a_scene_and_keywords(name):
    function, over = getattr(harvester, name), OVER.get(name, [])
    first, *others = inspect.signature(function).parameters.values()
    assert first.name == "scene"
    kinds = {each.kind for each in others[len(over) :]}
    assert kinds <= {inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD}
    with pytest.raises(harvester.SceneError, match="did you mean paper"):
        function("papr", *over)
    with pytest.raises(harvester.UnknownOption, match="no option engine"):
        function("paper", *over, engine="circuit")
    with pytest.raises(harvester.UnknownOption, match="is given without its name"):
        function("paper", *over, "circuit")


@pytest.mark.parametrize("name", ["load_study", *OVER])
def test_every_study_takes_what_runs_it(name):
    function, over = getattr(harvester, name), OVER.get(name, [])
    for option in RunnerOptions.__annotations__:
        with pytest.raises(harvester.SceneError, match="did you mean paper"):
            function("papr", *over, **{option: None})
    with pytest.raises(harvester.UnknownOption, match="did you mean workers"):
        function("paper", *over, worker=1)


def test_the_load_of_a_scene_is_its_table_and_the_class_reads_scenes():
    scene = harvester.Scene.read("paper")
    assert scene.load.decay_rate == scene.to_tables()["load"]["decay_rate"]
    with pytest.raises(AttributeError):
        scene.load = None


@pytest.mark.parametrize(
    ("call", "python", "command"),
    [
        (
            lambda: harvester.sensitivity("paper", vary={"load.decay_rate": "±10%"}, rows=17),
            "rows 17: must be a power of two",
            ["sensitivity", "paper", "--vary", "load.decay_rate=±10%", "--rows", "17"],
        ),
        (
            lambda: harvester.simulate("paper", window=(3.0, 1.0)),
            "window 3:1: must be 0",
            ["simulate", "paper", "--window", "3:1"],
        ),
    ],
)
def test_an_error_names_the_parameter_in_python_and_the_option_of_a_command(
    call, python, command, capsys
):
    with pytest.raises(harvester.HarvesterError, match=f"^{python}"):
        call()
    assert main(command) == 2
    assert f"harvester: --{python}" in capsys.readouterr().err
    with pytest.raises(harvester.HarvesterError, match=f"^{python}"):
        call()


@pytest.mark.parametrize("option", ["workers", "time_budget"])
def test_true_is_no_number(option):
    with pytest.raises(harvester.HarvesterError, match="True: must be a"):
        harvester.sweep("paper", {"load.decay_rate": [1.0]}, **{option: True})
