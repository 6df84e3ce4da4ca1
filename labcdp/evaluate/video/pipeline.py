"""Decoding, following and evaluating frames at the same time, with results in the order of the frames."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from queue import Empty, Full, Queue
from typing import TypeVar

from ...core.computer.threads import InterruptSafeThread

_In = TypeVar("_In")
_Out = TypeVar("_Out")

#: Frames that wait between two steps: enough to keep both busy, few enough to keep memory small.
_WAITING = 4
#: Seconds between two looks at whether anybody still takes what waits.
_LOOK_S = 0.2


def ahead(items: Iterable[_In]) -> Generator[_In, None, None]:
    """Go through items that are made in a thread of their own, a few ahead.

    Close the iterator (`contextlib.closing`) if it is not used up: its thread ends then.
    """
    queue: Queue[tuple[_In | None, BaseException | None, bool]] = Queue(_WAITING)
    stopped = threading.Event()

    def put(item: _In | None, error: BaseException | None, more: bool) -> None:
        while not stopped.is_set():
            try:
                queue.put((item, error, more), timeout=_LOOK_S)
            except Full:
                continue
            return

    def make() -> None:
        iterator = iter(items)
        try:
            for item in iterator:
                put(item, None, True)
                if stopped.is_set():
                    break
            put(None, None, False)
        except BaseException as error:
            put(None, error, False)
        finally:
            close = getattr(iterator, "close", None)
            if close is not None:
                close()

    thread = InterruptSafeThread(make, "labcdp video")
    thread.start()
    try:
        while True:
            try:
                item, error, more = queue.get(timeout=_LOOK_S)
            except Empty:
                continue
            if error is not None:
                raise error
            if not more:
                return
            yield item  # type: ignore[misc]
    finally:
        thread.finish(stopped.set)


def in_order(
    items: Iterable[_In], work: Callable[[_In], _Out], n_workers: int
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
