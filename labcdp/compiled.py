"""Loops that NumPy has no function for, compiled by Numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def compiled(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Compile a function of arrays and numbers at its first call; other threads run while it does.

    Arithmetic is as written, in the order in which it is written: results are the same whether a function was compiled
    now or before. For sums of many floats see `labcdp.sum_kernel`.

    What is compiled is kept on disk beside the module, or in the user's cache folder where that cannot be written, or
    else not at all. Modules with such functions are named ``*_kernel`` and imported where they are used, or by modules
    that are, as Numba takes its time to load. It notices a change of the file a function is in, but not of others it
    calls functions of: whoever edits one deletes ``__pycache__``.
    """
    from numba import njit

    try:
        made = njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:
        # There is no folder to keep it in.
        made = njit(nogil=True, error_model="numpy")(function)
    return cast(Callable[_Parameters, _Result], made)
