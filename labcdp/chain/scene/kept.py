"""Results kept for the next chain that needs the same, as the cells of a sweep do."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from threading import Lock
from typing import ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

#: How many results of a function are kept; maps of a large sensor take 20 MB.
_MOST = 2


def kept(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Keep the last results of a function of hashable arguments; threads that ask at once wait for one of them."""
    cached = lru_cache(maxsize=_MOST)(function)
    lock = Lock()

    @wraps(function)
    def call(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        with lock:
            return cached(*arguments, **named)  # type: ignore[arg-type]

    return call
