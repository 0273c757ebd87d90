"""Names of the release before still work, and say what to write instead."""

import importlib

import pytest

import harvester
from harvester import studies


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
