import pytest

from harvester.base.errors import HarvesterError
from harvester.cli.cite import all_sources, sources_of
from harvester.cli.command_line import main
from harvester.scene.model import Scene


def cited(scene, *engines):
    return " ".join(f"{s['method']} {s['reference']}" for s in sources_of(content(scene, *engines)))


def content(scene, *engines):
    results = {"results": {name: {} for name in engines}} if len(engines) > 1 else {}
    return {"scene": scene.to_dict(), "engine": engines[0], **results}


def test_a_result_cites_what_it_used_and_nothing_else():
    monte_carlo = cited(Scene.read("linear"), "monte-carlo")
    assert "Flyvbjerg" in monte_carlo
    for absent in ("ngspice", "Lankarani", "Saad", "Stratonovich", "PySpice"):
        assert absent not in monte_carlo
    everything = cited(
        Scene.read("paper"),
        "circuit",
        "monte-carlo",
        "averaging consistent",
        "averaging fokker_planck",
    )
    for present in ("vibro-impact", "ngspice", "Lankarani", "Saad", "Stratonovich", "PySpice"):
        assert present in everything
    averaged = cited(Scene.read("paper"), "averaging consistent")
    assert "Saad" not in averaged
    assert "Flyvbjerg" not in averaged


@pytest.mark.parametrize(
    ("load", "author"),
    [("bridge", "Ottman"), ("bridge_buck", "LTC3588"), ("sshi_series", "Guyomar"),
     ("sece", "synchronous electric charge extraction")],
)  # fmt: skip
def test_a_load_cites_its_paper(load, author):
    assert author in cited(Scene.read("device", [f"load.netlist={load}"]), "circuit")
    assert author not in cited(Scene.read("device"), "circuit")


@pytest.mark.parametrize(
    ("name", "author"),
    [("asymmetric", "Varoto"), ("one_sided", "9093605"), ("tristable", "Costa"),
     ("electromagnetic", "Kapanen")],
)  # fmt: skip
def test_a_device_cites_where_its_values_are_from(name, author):
    assert author in cited(Scene.read(name), "monte-carlo")
    assert author not in cited(Scene.read("device"), "monte-carlo")
    assert ("Lankarani" in cited(Scene.read(name), "circuit")) == (name == "one_sided")


def test_every_source_can_be_reached():
    scenes = [Scene.read(name) for name in Scene.names()]
    scenes += [
        Scene.read("device", [f"load.netlist={load}"])
        for load in ("bridge_buck", "sshi_parallel", "sece")
    ]
    scenes += [
        Scene.read("bimorph").replace(
            {"beam.fatigue_strain": 1e-4, "beam.fatigue_cycles": 1e6, "beam.fatigue_exponent": 9.0},
            magnets={"distance": 0.01, "reach": 0.005, "tip_moment": 0.1, "frame_moment": 0.1},
        )
    ]
    engines = ("circuit", "averaging fokker_planck")
    engines += ("averaging consistent of fitted noise",)
    reached = {s["reference"] for scene in scenes for s in sources_of(content(scene, *engines))}
    assert reached == {source["reference"] for source in all_sources()}


@pytest.mark.slow
def test_the_command_reads_real_results(tmp_path, capsys):
    target = tmp_path / "a.json"
    assert main(["average", "paper", "--json", str(target)]) == 0
    capsys.readouterr()
    assert main(["cite", str(target)]) == 0
    shown = capsys.readouterr().out
    assert "Stratonovich" in shown
    assert "ngspice" not in shown
    assert main(["cite"]) == 0
    assert capsys.readouterr().out.count("\n") == 2 * len(all_sources())


@pytest.mark.parametrize(
    ("text", "word"), [("[1]", "no scene"), ("{", "not a JSON"), ("{}", "no scene"), (None, "read")]
)
def test_what_is_no_result_is_refused(tmp_path, capsys, text, word):
    target = tmp_path / "a.json"
    if text is not None:
        target.write_text(text)
    assert main(["cite", str(target)]) == 2
    assert word in capsys.readouterr().err


@pytest.mark.parametrize("engine", [{}, {"engine": 5}, {"results": [1], "engine": None}])
def test_a_result_without_an_engine_is_refused(engine):
    with pytest.raises(HarvesterError, match="no scene and engine"):
        sources_of({"scene": {}, **engine})
