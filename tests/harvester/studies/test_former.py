"""Names of the release before still work, and say what to write instead."""

import pytest

import harvester
from harvester import studies


def test_a_report_is_the_study_itself():
    study = object()
    with pytest.warns(DeprecationWarning, match="load_study returns all"):
        assert harvester.Report(study) is study


def test_a_dataset_is_asked_of_the_study():
    class Study:
        def to_xarray(self):
            return "data"

    with pytest.warns(DeprecationWarning, match=r"study\.to_xarray"):
        assert studies.to_dataset(Study()) == "data"


def test_optimum_takes_several_parameters():
    with (
        pytest.warns(DeprecationWarning, match="optimum takes several"),
        pytest.raises(harvester.HarvesterError, match=r"did you mean load\.decay_rate"),
    ):
        harvester.optimum_of_several("linear", {"load.decay_rat": None, "load.decay_rate": None})
