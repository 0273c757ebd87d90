"""What is changed in numba stands in numba as it did when the change was tried."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harvester.base import compilation, numba_cache, numba_patches
from harvester.base.compilation import numba


@pytest.mark.parametrize("name", numba_patches.REPLACED)
def test_what_is_replaced_is_what_the_patch_was_written_for(name):
    found = numba_patches.digest_of(numba_patches.ORIGINAL[name])
    assert found == numba_patches.REPLACED[name], (
        f"{name} of numba {numba.__version__} is not that of {numba_patches.TRIED_WITH}: read it, "
        "see that harvester/base/numba_patches.py still does what it says, and write its digest "
        "there"
    )


def test_the_patches_are_in_place():
    original = numba_patches.ORIGINAL["numba.core.caching.IndexDataCacheFile"]
    assert numba.core.caching.IndexDataCacheFile is not original
    assert issubclass(numba.core.caching.IndexDataCacheFile, original)
    compiles = numba_patches.ORIGINAL["numba.core.dispatcher.Dispatcher.compile"]
    assert numba.core.dispatcher.Dispatcher.compile.__wrapped__ is compiles


@pytest.mark.parametrize("option", ["UNCOUNTED", "INLINE", "WITHIN"])
def test_numba_has_each_option_and_refuses_one_that_it_has_not(option):
    (name,) = getattr(compilation, option)
    assert numba.njit(**getattr(compilation, option))(lambda x: -x)(-1.0) == 1.0
    with pytest.raises(KeyError, match=f"no_such_{name}"):
        numba.njit(**{f"no_such_{name}": True})(lambda x: -x)(-1.0)


def test_the_tables_of_normal_numbers_are_those_of_the_ziggurat():
    """Each of 256 layers has the same area under exp(-x²/2), 4.93e-3 (Doornik 2005, Table 1)."""
    tables = numba_patches.ziggurat
    right = tables.wi_double * 2.0**52
    height = tables.fi_double
    area = right[1:] * (height[:-1] - height[1:])
    assert np.allclose(area, 0.00492867323399, rtol=1e-9)


@pytest.mark.slow
def test_a_settings_file_of_the_working_folder_is_not_read(tmp_path):
    (tmp_path / ".numba_config.yaml").write_text('opt: "0"\n')
    program = (
        "from harvester.base.compilation import numba; "
        "numba.njit(lambda x: x)(1.0); print(int(numba.core.config.OPT))"
    )
    here = str(Path(__file__).parents[3])
    call = [sys.executable, "-c", program]
    done = subprocess.run(
        call, cwd=tmp_path, env={"PYTHONPATH": here}, capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[-1] == "3"


@pytest.mark.slow
def test_cached_code_is_loaded_without_what_only_compiling_needs(tmp_path):
    (tmp_path / "part.py").write_text(
        "import numpy as np\n"
        "from harvester.base.compilation import compiled\n"
        "place = compiled(lambda numbers: np.searchsorted(numbers, 1.5))\n"
    )
    program = (
        "import sys; import numpy as np; from part import place; "
        "print(place(np.arange(4.0)), 'numba.np.arraymath' in sys.modules)"
    )
    here = str(Path(__file__).parents[3])
    variables = {"PYTHONPATH": f"{here}:{tmp_path}", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    call = [sys.executable, "-c", program]
    for compiling in (True, False):
        done = subprocess.run(call, env=variables, capture_output=True, text=True, check=True)
        assert done.stdout.split() == ["2", str(compiling)]


def test_nothing_of_numba_is_changed_elsewhere():
    """An assignment to an attribute of numba's own modules, other than its public settings."""
    package = Path(numba_cache.__file__).parents[1]
    for folder in (package, package.parent / "circuits"):
        for file in folder.rglob("*.py"):
            if file.name == "numba_patches.py":
                continue
            lines = [line.strip() for line in file.read_text(encoding="utf-8").splitlines()]
            own = [
                line
                for line in lines
                if line.startswith(("numba.", "caching.", "dispatcher.")) and " = " in line
            ]
            assert all(line.startswith("numba.core.config.CPU_FEATURES") for line in own), file
