"""Loops that NumPy has no function for, compiled by Numba."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from types import FunctionType
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

    _in_use.append(function.__qualname__)
    _forget_outdated(Path(function.__code__.co_filename).parent)
    try:
        made = njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:
        # There is no folder to keep it in.
        made = njit(nogil=True, error_model="numpy")(function)
    return cast(Callable[_Parameters, _Result], made)


#: Names of the functions that `compiled` made.
_in_use: list[str] = []


def compiled_with_others(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """Compile a function as `compiled` does, but only where other compiled functions are in use, as in videos.

    Elsewhere NumPy runs it: for a few pictures, loading Numba takes longer than it saves. The function and what it
    calls in its module are written so that both can run them; their results agree but for rounding.
    """

    @cache
    def made() -> Callable[_Parameters, _Result]:
        from numba.extending import register_jitable

        for helper in _helpers(cast(FunctionType, function), set()):
            register_jitable(helper)
        return compiled(function)

    @wraps(function)
    def called(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        return (made() if _in_use else function)(*args, **kwargs)

    return called


def _helpers(function: FunctionType, seen: set[str]) -> Iterator[FunctionType]:
    """Yield the functions of its module that a function calls, those that they call first."""
    for name in function.__code__.co_names:
        helper = function.__globals__.get(name)
        if isinstance(helper, FunctionType) and helper.__module__ == function.__module__ and name not in seen:
            seen.add(name)
            yield from _helpers(helper, seen)
            yield helper


@cache
def _forget_outdated(folder: Path) -> None:
    """Forget what is older than any kernel: Numba looks at the file a function is in, not at those it calls."""
    newest_s = max(path.stat().st_mtime for path in Path(__file__).parents[2].rglob("*_kernel.py"))
    with suppress(OSError):
        for index in (folder / "__pycache__").glob("*.nbi"):
            if index.stat().st_mtime < newest_s:
                index.unlink(missing_ok=True)
