"""Verification by public names: its own former ones, and those of what it judges."""

import ast
import importlib
from pathlib import Path

import pytest

import harvester.verification
from harvester.show import accuracy_figure, figures
from harvester.verification import FORMER_NAMES

FOLDER = Path(harvester.verification.__file__).parent
MODULES = sorted(FOLDER.rglob("*.py"))


@pytest.mark.parametrize("former", FORMER_NAMES)
def test_a_former_name_leads_to_the_new_module_with_a_warning(former):
    with pytest.warns(DeprecationWarning, match=FORMER_NAMES[former]):
        module = importlib.reload(importlib.import_module(f"harvester.verification.{former}"))
    new = importlib.import_module(f"harvester.verification.{FORMER_NAMES[former]}")
    public = [name for name in vars(new) if not name.startswith("_")]
    assert all(getattr(module, name) is getattr(new, name) for name in public)


def test_a_former_name_of_a_drawing_leads_to_the_new_one():
    with pytest.warns(DeprecationWarning, match="accuracy_figure"):
        assert figures.draw_work_precision is accuracy_figure.draw_work_precision


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_module_takes_nothing_private_from_what_it_judges(path):
    """Neither a name with an underscore from another module, nor one of another object."""
    tree = ast.parse(path.read_text("utf-8"))
    taken = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module != "__future__"
        for alias in node.names
    }
    reached = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) not in ("self", "cls")
    }
    private = {name for name in taken | reached if name.startswith("_")}
    assert private - {"__name__", "__getattr__", "__version__"} == set()
