"""Plain loops over time, compiled by numba where that pays.

numba is an extra (``fembridge[fast]``), takes 0.4 s to import, and each loop some seconds to
compile, once for a machine. So a loop is compiled for work that would take NumPy longer
(`compile_for`), or once numba is loaded; all of them have an equal in NumPy, beside which the
tests run them.
"""

import sys
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

# Numbers, membranes times time steps, from which on loading numba pays: NumPy takes 1 s for ten
# million.
_LEAST_NUMBERS = 5_000_000
_so_far = 0


def compile_for(numbers: int) -> bool:
    """Load numba if it is installed and `numbers`, and those asked for so far, are many.

    Whether loops are compiled now.
    """
    global _so_far
    _so_far += numbers
    if _so_far >= _LEAST_NUMBERS and _is_installed():
        import numba  # noqa: F401 - from here on `compiled` finds it
    return "numba" in sys.modules


def compiled(loop: Callable[..., Any]) -> Callable[..., Any] | None:
    """`loop` compiled, and kept on disk; None while numba is not loaded."""
    return jit(loop) if "numba" in sys.modules else None


@cache
def jit(loop: Callable[..., Any]) -> Callable[..., Any] | None:
    """`loop` compiled; None without numba."""
    try:
        from numba import njit
    except ImportError:
        return None
    options = {"error_model": "numpy", "nogil": True}
    try:
        return njit(loop, cache=True, **options)  # type: ignore[no-any-return]
    except RuntimeError:  # no folder for the cache is writable
        return njit(loop, **options)  # type: ignore[no-any-return]


@cache
def _is_installed() -> bool:
    return find_spec("numba") is not None
