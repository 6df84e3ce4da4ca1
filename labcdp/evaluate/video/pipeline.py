"""Decoding, following and evaluating frames at the same time, with results in the order of the frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import TypeVar

_In = TypeVar("_In")
_Out = TypeVar("_Out")

#: Frames that wait between two steps: enough to keep both busy, few enough to keep memory small.
_WAITING = 4


def ahead(items: Generator[_In, None, None]) -> Generator[_In, None, None]:
    """Go through items that are made in a thread of their own, a few ahead.

    Close the iterator (`contextlib.closing`) if it is not used up: its thread ends then.
    """
    with ThreadPoolExecutor(1, thread_name_prefix="labcdp video") as pool:

        def next_ones() -> Future[tuple[_In, ...]]:
            return pool.submit(lambda: tuple(islice(items, 1)))

        waiting = deque(next_ones() for _ in range(_WAITING))
        try:
            while found := waiting.popleft().result():
                waiting.append(next_ones())
                yield from found
        finally:
            for future in waiting:
                future.cancel()
            wait(waiting)
            items.close()


def in_order(
    items: Iterator[_In], work: Callable[[_In], _Out], n_workers: int
) -> Generator[tuple[_In, _Out], None, None]:
    """Work on items in threads, or in this one if there are none, and return each with its result, in order."""
    if not n_workers:
        for item in items:
            yield item, work(item)
        return
    with ThreadPoolExecutor(n_workers, thread_name_prefix="labcdp video") as pool:
        waiting: deque[tuple[_In, Future[_Out]]] = deque()
        try:
            for item in items:
                waiting.append((item, pool.submit(work, item)))
                while len(waiting) >= n_workers + _WAITING or (waiting and waiting[0][1].done()):
                    first, future = waiting.popleft()
                    yield first, future.result()
            while waiting:
                first, future = waiting.popleft()
                yield first, future.result()
        finally:
            for _, future in waiting:
                future.cancel()
