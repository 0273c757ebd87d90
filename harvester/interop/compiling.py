"""A C compiler, where one is there, and shared libraries by it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from harvester.base.errors import ExportError, ProgramNotFound
from harvester.base.temporary import TemporaryFolder

LIBRARY = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
# Time limit of the compiler (s); the sources take it half a second, so a slower one hangs.
TIME_LIMIT = 120.0
NO_COMPILER = (
    "no C compiler (cc, gcc, clang, or the one that CC names) is here: install one, or pip install "
    "ziglang"
)


@cache
def compiler() -> tuple[str, ...] | None:
    """Words that call a C compiler: CC, else cc, gcc or clang, else Zig's from PyPI; or None."""
    # Relative entries of PATH are left out: a compiler in the working folder is never called.
    path = os.pathsep.join(filter(os.path.isabs, os.get_exec_path()))
    for name in filter(None, (os.environ.get("CC"), "cc", "gcc", "clang")):
        program = shutil.which(name, path=path)
        if program:
            return (program,)
    return (sys.executable, "-m", "ziglang", "cc") if find_spec("ziglang") else None


def compile_library(files: dict[str, str], target: str | Path) -> None:
    """Compile sources to a shared library for this machine.

    Parameters
    ----------
    files : dict of str to str
        Texts by file names; all that end in .c are compiled.
    target : str or Path
        The library's file.

    Raises
    ------
    ProgramNotFound
        There is no compiler.
    ExportError
        It refuses the sources.
    """
    words = compiler()
    if words is None:
        raise ProgramNotFound(NO_COMPILER)
    with TemporaryFolder() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, "utf-8")
        sources = [name for name in files if name.endswith(".c")]
        # No fused multiply-add: it would change the last digit from processor to processor.
        options = ["-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared"]
        if sys.platform != "win32":
            options.append("-fPIC")
        try:
            done = subprocess.run(
                [*words, *options, "-o", os.path.abspath(target), *sources, "-lm"],
                cwd=folder, capture_output=True, text=True, timeout=TIME_LIMIT,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ExportError(f"{words[0]}: cannot compile the device: {error}") from None
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or ["it says nothing"]
        message = next((line for line in lines if "error" in line), lines[0])
        raise ExportError(f"{words[0]}: cannot compile the device: {message}")
