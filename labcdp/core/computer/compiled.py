"""Loops that NumPy has no function for, compiled by Numba."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def compiled(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Compile a function of arrays and numbers at its first call; other threads run while it does.

    Arithmetic is as written, in the order in which it is written: results are the same whether a function was compiled
    now or before.

    Compiled code is cached on disk next to the module, or in the user's cache folder where that cannot be written, or
    else not at all. Modules with such functions are named ``*_kernel`` and imported where they are used, or by modules
    that are, as Numba takes its time to load.
    """
    from numba import njit

    _forget_outdated(Path(function.__code__.co_filename).parent)
    try:
        made = njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:
        # There is no folder to keep it in.
        made = njit(nogil=True, error_model="numpy")(function)
    return cast(Callable[_Parameters, _Result], made)


@cache
def _forget_outdated(folder: Path) -> None:
    """Forget what is older than any kernel: Numba looks at the file a function is in, not at those it calls."""
    newest_s = max(path.stat().st_mtime for path in Path(__file__).parents[2].rglob("*_kernel.py"))
    with suppress(OSError):
        for index in (folder / "__pycache__").glob("*.nbi"):
            if index.stat().st_mtime < newest_s:
                index.unlink(missing_ok=True)
