"""Modules under the names of the last release."""

import importlib

import pytest

from harvester.former_names import FORMER_NAMES
from harvester.show import figures


@pytest.mark.parametrize("former", FORMER_NAMES)
def test_a_former_name_leads_to_the_new_module_with_a_warning(former):
    with pytest.warns(DeprecationWarning, match=FORMER_NAMES[former]):
        module = importlib.reload(importlib.import_module(former))
    new = importlib.import_module(FORMER_NAMES[former])
    public = [name for name in vars(new) if not name.startswith("_")]
    assert all(getattr(module, name) is getattr(new, name) for name in public)


def test_a_module_that_became_a_package_hands_on_what_it_held():
    with pytest.warns(DeprecationWarning, match=r"harvester\.results\.result\.Result"):
        from harvester.results import Result
    assert Result.__module__ == "harvester.results.result"
    with pytest.warns(DeprecationWarning, match=r"harvester\.simulation\.simulate\.check_step"):
        from harvester.simulation import check_step
    assert check_step("fine") == "fine"


@pytest.mark.parametrize("name", figures._FORMER)
def test_drawings_are_handed_on_from_where_they_were(name):
    with pytest.warns(DeprecationWarning, match=name):
        assert callable(getattr(figures, name))
