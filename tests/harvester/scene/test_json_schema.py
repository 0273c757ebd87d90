"""The JSON Schema of scenes accepts what the program accepts, and rejects faults of form."""

import json
import re
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from harvester.base.errors import HarvesterError
from harvester.cli.command_line import main
from harvester.scene.json_schema import json_schema
from harvester.scene.model import Scene
from harvester.scene.overrides import parsed, put
from harvester.scene.source import BUILT_IN

ROOT = Path(__file__).parents[3]
VALIDATOR = Draft202012Validator(json_schema())
# Scenes in the docs that hold their units and a load are whole.
DOCUMENTED = [
    (page.name, block)
    for page in sorted((ROOT / "docs").rglob("*.md"))
    for block in re.findall(r"^```toml\n(units = .*?)^```", page.read_text("utf-8"), re.M | re.S)
    if "[load]" in block
]
# Built-in scene and one wrong key or value in it.
WRONG = """
device oscillator.mas=1
device oscillator.mass=-1
device oscillator.mass=0
device oscillator.mass=none
device oscillator.mass="much"
device oscillator.mass="2M"
device oscillator.mass="2q"
device oscillator.mass="-2k"
device oscillator.mass=true
device oscillator.mass=1e40
device oscillator.mass=inf
device oscillator.mass=[1]
device oscillator.mass=2026-11-27
device oscillator.damping=none
device oscillator.damping=-0.1
device oscillator.linear_stiffness=none
device oscillator.cubic_stiffness=-3
device oscillator.restoring_force=[1]
device oscillator.restoring_force=[1,2,3,4,5,6,7,8,9]
device oscillator.restoring_force=["a","b"]
device oscillator.force_table=[[1,2,3],[2,3,4]]
device oscillator.force_interpolation="smooth"
device oscillator.restoring_force_range=[1]
device oscillator.base_factor=0
device oscillator=3
device units="si"
device units=none
device length_scale=0
paper length_scale=1
paper oscillator.mass=1
paper oscillator.frequency=2
paper oscillator.quality_factor=2
paper load.resistance=3
device load.decay_rate=3
paper piezo.capacitance=1e-9
device piezo.leakage_rate=1
device piezo.coupling=none
device piezo.coupling="strong"
device piezo.capacitance=43
device piezo.capacitance=none
device piezo.k2=0.1
device oscillator.frequency=12
device oscillator.quality_factor=12
device load.netlist="bridge"
bimorph beam.quality_factor=3
device piezo=none
device coil={coupling=1,resistance=2}
device load.kind="bulb"
device load.resistance=none
device load.subcircuit="x"
device load.parameters={r=1}
device load={netlist="bridge",kind="resistor"}
device load={netlist="bridge",parameters={r=[1]}}
device load=none
device excitation=none
device excitation.kind="noise"
device excitation.intensity=none
device excitation.amplitude=1
device excitation={kind="sine",amplitude=1}
device excitation={kind="sine",amplitude=-1,frequency=2}
device excitation={kind="spectrum",unit="g^2/Hz"}
device excitation={kind="spectrum",unit="dB",breakpoints=[[1,1],[2,1]]}
device excitation={kind="spectrum",unit="g^2/Hz",breakpoints=[[1,1]]}
device excitation={kind="spectrum",profile="navmat"}
device excitation={kind="sum",parts=[]}
device excitation={kind="sum",parts=[{kind="sine"}]}
device excitation={kind="record"}
device excitation={kind="record",file=3}
device excitation={kind="record",file="a\\u0000b"}
device excitation={kind="record",file="a.csv",mend=["all"]}
device excitation={kind="record",file="a.csv",band=[1]}
device run.seed=-1
device run.seed=1.5
device run.seed="x"
device run.realizations=0
device run.orbit="worst"
device run.duration=none
device run.duration=0
one_sided stoppers[0].gap=0
one_sided stoppers[0].restitution=1.1
one_sided stoppers[0].side="top"
one_sided stoppers[0].law="hertz"
one_sided stoppers[0].exponent=9
one_sided stoppers=[]
device start.position=1
device stopper={gap=1}
bimorph oscillator.mass=1
bimorph piezo.k2=0.1
bimorph beam.length=60
bimorph beam.length=none
bimorph beam.material="steal"
bimorph beam.layers=3
bimorph beam={length=1}
bimorph units="scaled"
device magnets={distance=0.01,reach=0.01}
""".strip().splitlines()


def changed(name, override):
    """The tables of a built-in scene with one change that replaces nothing else."""
    tables = tomllib.loads((BUILT_IN / f"{name}.toml").read_text("utf-8"))
    key, value = parsed(override)
    table, _, last = key.partition(".")
    if not last or value is None or "[" in table:
        put(tables, key, value, "--set")
    else:
        tables.setdefault(table, {})[last] = value
    return tables


@pytest.mark.parametrize("name", Scene.names())
def test_built_in_scenes_are_valid(name):
    VALIDATOR.validate(tomllib.loads((BUILT_IN / f"{name}.toml").read_text("utf-8")))
    VALIDATOR.validate(json.loads(json.dumps(Scene.read(name).to_tables())))


def test_documented_scenes_are_valid():
    assert DOCUMENTED
    for _, block in DOCUMENTED:
        assert VALIDATOR.is_valid(tomllib.loads(block)), block


@pytest.mark.parametrize("wrong", WRONG)
def test_one_wrong_key_or_value_is_rejected_by_schema_and_program(wrong):
    tables = changed(*wrong.split(" ", 1))
    assert not VALIDATOR.is_valid(tables)
    with pytest.raises(HarvesterError) as caught:
        Scene.from_tables(tables, origin="mine.toml")
    assert str(caught.value).startswith("mine.toml")
    assert "\n" not in str(caught.value)


def test_alternatives_and_suffixes_are_valid():
    for right in (
        'cantilever oscillator.damping_ratio="27m"',
        'device load={netlist="bridge",parameters={resistance="100k"}}',
        'device excitation={kind="record",file="a.csv",unit="g",column=2}',
        "device excitation={intensity=1,correlation_time=0.1}",
        'device excitation={kind="spectrum",profile="gevs-acceptance"}',
        'device oscillator={mass=1,quality_factor=30,force_table="f.csv"}',
        'device piezo={k2=0.1,capacitance="40n"}',
    ):
        assert VALIDATOR.is_valid(changed(*right.split(" ", 1))), right


def test_the_list_of_keys_in_the_docs_is_up_to_date():
    path = ROOT / "docs" / "scene_keys.py"
    spec = spec_from_file_location("scene_keys", path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.PAGE.read_text("utf-8") == module.page(), "run python docs/scene_keys.py"


def test_the_command_prints_it(capsys):
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json_schema()
    Draft202012Validator.check_schema(json_schema())
