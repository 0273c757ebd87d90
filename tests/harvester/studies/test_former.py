"""Names of the release before still work, and say what to write instead."""

import importlib
from dataclasses import replace

import pytest

import harvester
from harvester import studies
from harvester.estimates.estimate import Estimate
from harvester.studies.optimum.axis import Axis, Parameter
from harvester.studies.optimum.result import Averaging, Optimum

PARAMETER = Parameter(Axis("load.decay_rate", 0.1, 2.0), 1.0, 0.1)
VALUE = Estimate(2.0, 0.1, None, "power")


def test_a_report_is_the_study_itself():
    study = object()
    with pytest.warns(DeprecationWarning, match=r"use harvester\.load_study"):
        assert harvester.Report(study) is study


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("comparison", "validate"),
        ("frequency_response", "frequency_response"),
        ("loads.study", "load_study"),
        ("optimum", "optimum"),
        ("sensitivity", "sensitivity"),
    ],
)
def test_the_module_that_held_a_function_before_hands_it_on(module, name):
    former = importlib.import_module(f"harvester.studies.{module}")
    with pytest.warns(DeprecationWarning, match=f"is now harvester.studies.public.{name}"):
        assert getattr(former, name) is getattr(harvester, name)


def test_a_dataset_is_asked_of_the_study():
    class Study:
        def to_xarray(self):
            return "data"

    with pytest.warns(DeprecationWarning, match=r"use its to_xarray"):
        assert studies.to_dataset(Study()) == "data"


def test_optimum_takes_several_parameters():
    with (
        pytest.warns(DeprecationWarning, match=r"use harvester\.optimum"),
        pytest.raises(harvester.HarvesterError, match=r"did you mean load\.decay_rate"),
    ):
        harvester.optimum_of_several("linear", {"load.decay_rat": None, "load.decay_rate": None})


@pytest.mark.parametrize(
    ("former", "value"),
    [
        ("ranges", [PARAMETER]),
        ("axis", PARAMETER.axis),
        ("averaged_place", 1.1),
        ("fitted", [(0.5, VALUE)]),
        ("wall_seconds", 3.0),
    ],
)
def test_an_optimum_has_what_it_had(former, value):
    averaging = Averaging("paper", 1.1, 2.1, "", 2.0)
    scene = harvester.Scene.load("linear")
    place = {"load.decay_rate": 0.5}
    found = Optimum(
        scene, "mean_power", "W", "circuit", [PARAMETER], VALUE, [(place, VALUE)], averaging
    )
    with pytest.warns(DeprecationWarning, match=f"Optimum.{former} is now"):
        assert getattr(replace(found, seconds=3.0), former) == value
    with pytest.raises(AttributeError, match="nonsense"):
        found.nonsense  # noqa: B018
