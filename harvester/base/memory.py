"""Checks at start-up whether the libraries fit into a limited memory.

If OpenBLAS gets no memory when it is loaded or first called, it retries endlessly.
"""

from __future__ import annotations

import contextlib
import importlib
import re
from pathlib import Path

# Modules that are imported inside functions elsewhere.
IMPORTED_LATER = (
    "scipy.linalg",
    "scipy.optimize",
    "scipy.signal",
    "scipy.sparse.linalg",
    "scipy.stats",
)
# For each limit its line of /proc/self/status, its name in the shell, and the memory of the
# libraries in addition to numpy (bytes), measured with numba 0.68 and scipy 1.18.
LIMITS = {
    "RLIMIT_AS": ("VmSize", "address space (ulimit -v)", 400 << 20),
    "RLIMIT_DATA": ("VmData", "data (ulimit -d)", 180 << 20),
}


def load_libraries_early() -> bool:
    """If memory is limited, import libraries that are needed later; return whether it is limited.

    Raises MemoryError if they do not fit.
    """
    if not _is_limited():
        return False
    for name in IMPORTED_LATER:
        importlib.import_module(name)
    # The libraries' copies of BLAS allocate the buffers of one thread at their first call.
    import numpy as np
    from scipy import linalg
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    square = np.eye(200)
    linalg.lu_factor(square @ square)
    return True


def _is_limited():
    """Whether this process's memory is limited; raises MemoryError if the libraries do not fit."""
    limited = False
    for name, (line, words, needed) in LIMITS.items():
        limit = _limit(name)
        if limit is None:
            continue
        limited = True
        if limit - _used_memory(line) < needed:
            raise MemoryError(
                f"the libraries need {needed >> 20} MB more of {words} than Python itself, and "
                f"the limit is {limit >> 20} MB; raise it"
            )
    return limited


def _limit(name):
    """A limit of this process (bytes); None if unlimited."""
    try:
        import resource
    except ImportError:
        return None
    soft = resource.getrlimit(getattr(resource, name))[0]
    return None if soft == resource.RLIM_INFINITY else soft


def _used_memory(line):
    """Memory used by this process (bytes); 0 if the system does not report it."""
    with contextlib.suppress(OSError):
        match = re.search(rf"{line}:\s+(\d+) kB", Path("/proc/self/status").read_text())
        if match:
            return 1024 * int(match.group(1))
    return 0
