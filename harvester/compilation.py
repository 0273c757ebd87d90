"""How functions are compiled: cached on disk, with C's arithmetic (1/0 gives inf, no checks)."""

import hashlib
import os
import sys
import warnings
from functools import partial
from pathlib import Path


def _import_numba():
    """numba without the .numba_config.yaml of the working folder, which says where code is read.

    numba looks for that file when it is imported and whenever it compiles.
    """
    reader = sys.modules.get("yaml")
    sys.modules["yaml"] = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from numba.core import config
    finally:
        del sys.modules["yaml"]
        if reader:
            sys.modules["yaml"] = reader
    config._config_fname = os.devnull


if "numba" not in sys.modules:
    _import_numba()

from numba import njit  # noqa: E402 - as imported above

compiled = partial(njit, cache=True, error_model="numpy")
# Sums over many points in any order, several at a time.
summing = partial(njit, cache=True, error_model="numpy", fastmath={"reassoc", "nsz", "contract"})

PACKAGE = Path(__file__).parent


def forget_stale_code():
    """Drop compiled code when any source of the package has changed since it was written.

    numba looks at the file of the function alone, not at what the function calls elsewhere: a
    changed force law would go on being compiled into an unchanged integrator.
    """
    digest = hashlib.sha256()
    for source in sorted(PACKAGE.rglob("*.py")):
        digest.update(source.read_bytes())
    stamp = PACKAGE / "__pycache__" / "compiled-from.sha256"
    try:
        if stamp.exists() and stamp.read_text() == digest.hexdigest():
            return
        for package in (PACKAGE, PACKAGE.parent / "circuits"):
            for index in package.rglob("*.nbi"):
                index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest.hexdigest())
    except OSError:
        # Not ours to write: numba then keeps its files elsewhere.
        return


forget_stale_code()
