"""The public names: one table of them, light to import, and the same in code and documentation."""

import ast
import importlib
import inspect
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import harvester
from harvester.base import errors
from harvester.cli.table import COMMANDS

ROOT = Path(harvester.__file__).parents[1]
PUBLIC = [name for name in harvester.__all__ if name != "__version__"]
HEAVY = ("numba", "scipy", "matplotlib", "PySpice", "xarray", "dask", "rich", "ipywidgets")


def test_every_name_leads_to_what_it_says():
    for name in PUBLIC:
        assert getattr(harvester, name).__name__ == name
        assert getattr(harvester, name).__doc__


def test_completion_knows_every_name():
    assert dir(harvester) == sorted(harvester.__all__)


def test_no_module_takes_the_place_of_a_name():
    modules = {each.name for each in pkgutil.iter_modules(harvester.__path__)}
    assert modules
    assert not modules & set(PUBLIC)
    for name in modules - {"__main__"}:
        importlib.import_module(f"harvester.{name}")
    assert not [name for name in PUBLIC if inspect.ismodule(getattr(harvester, name))]


def test_every_named_error_is_public():
    kinds = {
        name
        for name, value in vars(errors).items()
        if inspect.isclass(value) and issubclass(value, harvester.HarvesterError)
    }
    assert kinds == {name for name, where in harvester._WHERE.items() if where == errors.__name__}


@pytest.mark.parametrize("package", ["harvester", "circuits"])
def test_annotations_are_shipped(package):
    assert (ROOT / package / "py.typed").exists()


COMMAND_LINE = "from harvester.cli.table import COMMANDS, app_of; app_of(COMMANDS)"


@pytest.mark.parametrize("statement", ["import harvester; dir(harvester)", COMMAND_LINE])
def test_nothing_heavy_is_imported_before_it_is_needed(statement):
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(HEAVY) & set(done.stdout.split())


def bare_functions(body, inside=""):
    """Public functions and methods of a module that lack an annotation."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from bare_functions(node.body, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            static = any(ast.unparse(each) == "staticmethod" for each in node.decorator_list)
            given = node.args.posonlyargs + node.args.args
            given = given[1:] if inside and not static else given
            given += [*node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
            if node.returns is None or any(each and each.annotation is None for each in given):
                yield inside + node.name


@pytest.mark.parametrize("package", ["harvester", "circuits"])
def test_every_public_function_is_annotated(package):
    files = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / package).rglob("*.py")}
    assert len(files) > 20
    bare = {
        name: found
        for name, path in files.items()
        if (found := list(bare_functions(ast.parse(path.read_text("utf-8")).body)))
    }
    assert not bare


def test_a_command_that_is_no_function_is_named():
    names = {command.replace("-", "_") for command in COMMANDS}
    assert names - set(harvester.__all__) == set(harvester.COMMANDS_ONLY)
    with pytest.raises(AttributeError, match="on the command line: harvester new"):
        assert harvester.new


def test_a_netlist_is_exported_from_python(tmp_path):
    harvester.netlist("paper", output=tmp_path / "paper.cir")
    harvester.export("paper", kind="deck", output=tmp_path / "same.cir")
    assert (tmp_path / "paper.cir").read_bytes() == (tmp_path / "same.cir").read_bytes()


def test_a_paired_difference_without_batches_is_refused():
    result = harvester.average("linear", method="spectral")
    with pytest.raises(harvester.HarvesterError, match=r"no batches .*results of simulate"):
        harvester.paired_difference(result, result)
    with pytest.raises(harvester.HarvesterError, match=r"harvester\.paired_difference"):
        assert result["mean_power"] - result["mean_power"]
