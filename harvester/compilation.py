"""How functions are compiled: cached on disk, with C's arithmetic (1/0 gives inf, no checks)."""

from functools import partial

from numba import njit

compiled = partial(njit, cache=True, error_model="numpy")
# Sums over many points in any order, several at a time.
summing = partial(njit, cache=True, error_model="numpy", fastmath={"reassoc", "nsz", "contract"})
