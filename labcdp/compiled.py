"""Loops that NumPy has no function for, compiled by Numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

#: Sums may be taken in any order, as NumPy takes them too; what is not finite stays so.
_FAST_MATH = {"reassoc", "contract", "nsz"}


def compiled(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Compile a function of arrays and numbers at its first call; other threads run while it does.

    What is compiled is kept on disk beside the module, or in the user's cache folder where that cannot be written.
    Modules with such functions are named ``*_kernel`` and imported where they are used, or by modules that are, as
    Numba takes its time to load. It notices a change of the file a function is in, but not of others it calls
    functions of: whoever edits one deletes ``__pycache__``.
    """
    from numba import njit

    made = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST_MATH)(function)
    return cast(Callable[_Parameters, _Result], made)
