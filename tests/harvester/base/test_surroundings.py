import hashlib
import os
import subprocess
import sys

import pytest

from harvester.base import numba_cache
from harvester.base.surroundings import PACKAGE, away_from_working_folder, foreign_writers_of

DRAW = """
import hashlib
from harvester import Scene, average
from harvester.results.drawing import draw_result
from harvester.results import figures
result = average(Scene.read("linear"), method="consistent")
print(hashlib.sha256(figures.image(figures.drawn(draw_result, result), "png")).hexdigest())
"""


def drawn(folder, **environment):
    """Digest of a figure drawn in a folder by a process of its own."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("MPL")}
    done = subprocess.run(
        [sys.executable, "-c", DRAW],
        cwd=folder,
        env={**clean, "PYTHONPATH": str(PACKAGE.parent), **environment},
        capture_output=True,
        text=True,
        timeout=60.0,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


@pytest.mark.slow
def test_no_settings_of_matplotlib_reach_a_figure(tmp_path):
    plain = drawn(tmp_path)
    settings = "figure.facecolor: red\nfont.size: 30\ntext.usetex: True\nbackend: nonsense\n"
    (tmp_path / "matplotlibrc").write_bytes(settings.encode() + b"\xff\xfe")
    assert drawn(tmp_path, MPLBACKEND="nonsense") == plain
    (tmp_path / "matplotlibrc").unlink()
    os.mkfifo(tmp_path / "matplotlibrc")
    (tmp_path / "settings").write_text("lines.linewidth: 9\naxes.facecolor: black\n")
    assert drawn(tmp_path, MATPLOTLIBRC=str(tmp_path / "settings")) == plain


def test_a_figure_is_not_the_users_settings(monkeypatch):
    import matplotlib

    from harvester.averaging.of_scene import average
    from harvester.results import figures
    from harvester.results.drawing import draw_result
    from harvester.scene.model import Scene

    result = average(Scene.read("linear"), method="consistent")

    def picture():
        drawn = figures.image(figures.drawn(draw_result, result), "png")
        return hashlib.sha256(drawn).hexdigest()

    plain = picture()
    with matplotlib.rc_context({"axes.facecolor": "black", "lines.linewidth": 9.0}):
        assert picture() == plain


def test_the_working_folder_is_the_same_afterwards(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KeyError), away_from_working_folder():
        raise KeyError(os.getcwd())
    assert os.getcwd() == str(tmp_path)
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with away_from_working_folder():
        assert os.getcwd() == str(PACKAGE)


def test_who_else_writes_looks_at_every_folder_above(tmp_path):
    path = tmp_path / "upper" / "lower" / "file"
    path.parent.mkdir(parents=True)
    path.touch(0o600)
    assert foreign_writers_of(path) == ""
    assert foreign_writers_of(tmp_path / "not" / "there") == ""
    for place in (path, path.parent, path.parent.parent):
        mode = place.stat().st_mode
        place.chmod(0o777)
        assert foreign_writers_of(path) == f"{place} can be written by others"
        place.chmod(mode)
    # As /tmp is: names may be added there, not moved.
    path.parent.parent.chmod(0o1777)
    assert foreign_writers_of(path) == ""
    (tmp_path / "link").symlink_to(path)
    path.chmod(0o666)
    assert foreign_writers_of(tmp_path / "link") == f"{path} can be written by others"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_what_belongs_to_another_user_is_not_ours(tmp_path):
    os.chown(tmp_path, 65534, 65534)
    assert foreign_writers_of(tmp_path / "file") == f"{tmp_path} belongs to another user"


def test_code_that_numba_keeps_where_others_write_is_not_read(monkeypatch, tmp_path):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "cache"))
    assert numba_cache.is_safe()
    planted = tmp_path / "cache" / "harvester_0" / "moments.nbi"
    planted.parent.mkdir(parents=True)
    planted.touch()
    planted.chmod(0o600)
    assert numba_cache.is_safe()
    planted.chmod(0o666)
    assert not numba_cache.is_safe()
    planted.chmod(0o600)
    (tmp_path / "cache").chmod(0o777)
    assert not numba_cache.is_safe()
    monkeypatch.setattr("numba.core.config.CACHE_DIR", "")
    monkeypatch.setattr(numba_cache.os, "access", lambda *_: True)
    assert numba_cache.is_safe()
    monkeypatch.setattr(numba_cache.os, "access", lambda *_: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert numba_cache.is_safe()
    tmp_path.chmod(0o777)
    assert not numba_cache.is_safe()
