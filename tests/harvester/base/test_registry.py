"""Parts that another package adds; `tests/test_distribution.py` runs them in worker processes."""

import tomllib
from importlib import metadata

import entry_points
import pytest
from jsonschema import Draft202012Validator

from harvester.averaging.closures import CLOSURES
from harvester.base.errors import SceneError
from harvester.device.contact import LAWS
from harvester.excitation import KINDS
from harvester.scene.json_schema import json_schema
from harvester.scene.model import Scene
from harvester.scene.tables import TRANSDUCERS


@pytest.fixture
def installed(tmp_path, monkeypatch):
    entry_points.install(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for registry in (CLOSURES, LAWS, TRANSDUCERS, KINDS):
        monkeypatch.setattr(registry, "data", dict(registry.data))
    (tmp_path / "scene.toml").write_text(entry_points.SCENE)
    return tmp_path / "scene.toml"


def test_parts_of_another_package_are_found_by_their_names(installed):
    scene = Scene.read(installed)
    assert scene.excitation.kind == "steps"
    assert TRANSDUCERS.name_of(type(scene.transducer)) == "electrode_piezo"
    assert Scene.from_dict(scene.to_dict()) == scene
    assert CLOSURES["toy"].tolerance == 1e-2


def test_a_scene_says_its_transducers_table_in_a_process_that_has_not_met_it(installed):
    scene = Scene.read(installed)
    del TRANSDUCERS["electrode_piezo"]
    assert scene.to_tables()["electrode_piezo"]["capacitance"] == 1e-7


def test_the_json_schema_holds_parts_of_other_packages(installed):
    tables = tomllib.loads(installed.read_text("utf-8"))
    validator = Draft202012Validator(json_schema())
    validator.validate(tables)
    tables["excitation"]["height"] = -1.0
    assert not validator.is_valid(tables)


def test_entry_points_are_looked_up_for_unknown_names_alone(installed, monkeypatch):
    monkeypatch.setattr(metadata, "entry_points", lambda **_: pytest.fail("looked up"))
    assert Scene.read("paper").excitation.kind == "ornstein-uhlenbeck"
    assert "hertz-damp" in LAWS


def test_what_no_package_adds_is_refused_with_what_there_is(installed):
    installed.write_text(entry_points.SCENE.replace('"dashpot"', '"dashpott"'))
    with pytest.raises(SceneError, match=r"stoppers\[0\]\.law = .dashpott.*hertz-damp"):
        Scene.read(installed)
