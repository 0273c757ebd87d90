"""Finds a C compiler and compiles shared libraries."""

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
# Time limit of the compiler (s), which normally needs half a second.
TIME_LIMIT = 120.0
NO_COMPILER = "no C compiler (cc, gcc, clang, or CC) was found: install one, or pip install ziglang"


@cache
def compiler() -> tuple[str, ...] | None:
    """Command of a C compiler: CC, else cc, gcc or clang, else Zig's from PyPI; or None."""
    # Relative entries of PATH are ignored: a compiler in the working folder is never called.
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
        Texts by file name; all .c files are compiled.
    target : str or Path
        Path of the library.

    Raises
    ------
    ProgramNotFound
        There is no compiler.
    ExportError
        The compiler fails.
    """
    words = compiler()
    if words is None:
        raise ProgramNotFound(NO_COMPILER)
    with TemporaryFolder() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, "utf-8")
        sources = [name for name in files if name.endswith(".c")]
        # No fused multiply-add: the last digit would depend on the processor.
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
        lines = done.stderr.strip().splitlines() or ["no message"]
        message = next((line for line in lines if "error" in line), lines[0])
        raise ExportError(f"{words[0]}: cannot compile the device: {message}")
