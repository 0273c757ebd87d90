"""Verification judges by public names."""

import ast
from pathlib import Path

import pytest

import harvester.validation

FOLDER = Path(harvester.validation.__file__).parent
MODULES = sorted(FOLDER.rglob("*.py"))


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
