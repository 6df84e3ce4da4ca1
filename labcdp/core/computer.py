"""The computer: compiled loops, threads and processes."""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from threading import Event, Thread
from typing import Any, Generic, ParamSpec, TypeVar, cast

from .errors import InputError

_Parameters = ParamSpec("_Parameters")
_Compiled = TypeVar("_Compiled")


#: Parameters of mallopt (glibc, malloc.h), and the size from which memory is mapped by itself.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX, _MAPPED_BYTES = -1, -3, -8, 2**18


def give_back_memory() -> None:
    """Let the memory of arrays go back to the system when they are freed, from now on; for processes that run for long.

    By itself glibc raises its threshold for what is mapped to the largest block freed so far, up to 32 MiB: images are
    then cut from heaps, of which each thread has another, and between what stays there they are not given back.
    """
    with suppress(AttributeError, OSError, TypeError):  # another C library manages its memory in its own way
        set_option = ctypes.CDLL(None).mallopt
        for option, value in ((_MMAP_THRESHOLD, _MAPPED_BYTES), (_TRIM_THRESHOLD, _MAPPED_BYTES), (_ARENA_MAX, 2)):
            set_option(option, value)


def compiled(function: Callable[_Parameters, _Compiled]) -> Callable[_Parameters, _Compiled]:
    """Compile a function of arrays and numbers at its first call; other threads run while it does.

    Arithmetic is as written, in the order in which it is written: results are the same whether a function was compiled
    now or before.

    Compiled code is cached on disk next to the module, or in the user's cache folder where that cannot be written, or
    else not at all. Modules with such functions are named ``*_kernel`` and imported where they are used, or by modules
    that are, as Numba takes its time to load.
    """
    from numba import njit

    _forget_outdated(Path(function.__code__.co_filename).parent)
    # C calls none of them: an entry for it would only take time.
    ways = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    try:
        made = njit(cache=True, **ways)(function)
    except RuntimeError:
        # There is no folder to keep it in.
        made = njit(**ways)(function)
    return cast(Callable[_Parameters, _Compiled], made)


def compiled_part(function: Callable[_Parameters, _Compiled]) -> Callable[_Parameters, _Compiled]:
    """Compile a function that only compiled ones call, along with them and kept in them.

    It has no entry from Python, which would take as long to compile as a short function itself.
    """
    from numba import njit

    made = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True)(function)
    return cast(Callable[_Parameters, _Compiled], made)


@cache
def _forget_outdated(folder: Path) -> None:
    """Forget what is older than any kernel: Numba looks at the file a function is in, not at those it calls."""
    newest_s = max(path.stat().st_mtime for path in Path(__file__).parents[1].rglob("*_kernel.py"))
    with suppress(OSError):
        for index in (folder / "__pycache__").glob("*.nbi"):
            if index.stat().st_mtime < newest_s:
                index.unlink(missing_ok=True)


_Part = TypeVar("_Part")
_Result = TypeVar("_Result")

#: Number of values from which threads are worth their overhead (a few tenths of a millisecond).
LONG = 2**16


class InterruptSafeThread:
    """A thread whose end can be awaited even if a signal arrives meanwhile.

    If Ctrl-C interrupts `threading.Thread.join`, CPython up to 3.12 treats the thread as ended although it still runs.

    Parameters
    ----------
    work : callable
        What it does.
    name : str
        Of the thread.
    """

    def __init__(self, work: Callable[[], None], name: str) -> None:
        self._ended = Event()
        self._work = work
        self._thread = Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def finish(self, request_end: Callable[[], None]) -> None:
        """Request the end of the thread and wait for it; an interrupt is raised only afterwards."""
        interrupted: BaseException | None = None
        while not self._ended.is_set():
            try:
                request_end()
                self._ended.wait()
            except BaseException as error:
                interrupted = error
        self._thread.join()
        if interrupted is not None:
            raise interrupted

    def _run(self) -> None:
        try:
            self._work()
        finally:
            self._ended.set()


def each_in_thread(function: Callable[[_Part], _Result], parts: Sequence[_Part], size: int) -> list[_Result]:
    """Call a function for each of a few parts, in threads if the parts process `LONG` values or more.

    NumPy releases the GIL while it sorts and searches. The parts are the same with and without threads, and so are the
    results.
    """
    if size < LONG:
        return [function(part) for part in parts]
    with ThreadPoolExecutor(len(parts)) as pool:
        return list(pool.map(function, parts))


#: So often a task is given to a process before it is given up, if processes die of it.
_ATTEMPTS = 2
#: One process computes in one thread, as there is one for each core.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

_Task = TypeVar("_Task")
_Value = TypeVar("_Value")


@dataclass(frozen=True, eq=False)
class _Worker:
    process: SpawnProcess
    pipe: Connection

    @classmethod
    def start(cls) -> _Worker:
        here, there = get_context("spawn").Pipe()
        process = get_context("spawn").Process(target=_serve, args=(there,), daemon=True)
        given = {name: os.environ.get(name) for name in _ONE_THREAD}
        os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
        try:
            process.start()
        finally:
            for name, value in given.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})
        # Without this end here, the end of the process is the end of the pipe.
        there.close()
        return cls(process, here)

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def attempted(function: Callable[..., _Value], *arguments: Any) -> tuple[_Value | None, BaseException | None]:
    """Return the value of a function, or the error that it ended with."""
    try:
        return function(*arguments), None
    except Exception as error:
        return None, error


class Threads(Generic[_Task]):
    """Threads of this process, with the interface of `Processes`."""

    def __init__(self, n_workers: int | None = None) -> None:
        self._n_workers = n_workers or usable_cores()

    def run(
        self, function: Callable[..., _Value], tasks: Sequence[_Task], *arguments: Any
    ) -> Iterator[tuple[_Task, _Value | None, BaseException | None]]:
        """Call a function with each task and the arguments, and return results or errors as they come."""
        if self._n_workers == 1:
            # In this thread, which Ctrl-C interrupts.
            yield from ((task, *attempted(function, task, *arguments)) for task in tasks)
            return
        pool = ThreadPoolExecutor(self._n_workers)
        try:
            running = {pool.submit(function, task, *arguments): task for task in tasks}
            for future in as_completed(running):
                error = future.exception()
                # Results are not kept: there may be many, and large ones.
                yield running.pop(future), None if error else future.result(), error
        finally:
            pool.shutdown(cancel_futures=True)


class Processes(Generic[_Task]):
    """Processes of this computer, each with one task at a time; they end with the iteration over their results.

    Parameters
    ----------
    n_workers : int or None
        How many; None for one a core.
    """

    def __init__(self, n_workers: int | None = None) -> None:
        self._n_workers = n_workers or usable_cores()
        #: Number of each process that died, and what it was at.
        self.died: list[tuple[int | None, _Task]] = []

    def run(
        self, function: Callable[..., _Value], tasks: Sequence[_Task], *arguments: Any
    ) -> Iterator[tuple[_Task, _Value | None, BaseException | None]]:
        """Call a function with each task and the arguments, and return results or errors as they come."""
        waiting = deque((task, 1) for task in tasks)
        running: dict[Connection, tuple[_Worker, _Task, int]] = {}
        idle: list[_Worker] = []
        try:
            while waiting or running:
                while waiting and len(running) < self._n_workers:
                    task, attempt = waiting.popleft()
                    worker = idle.pop() if idle else _Worker.start()
                    running[worker.pipe] = (worker, task, attempt)
                    worker.pipe.send((function, task, arguments))
                for pipe in wait(list(running)):
                    assert isinstance(pipe, Connection)
                    worker, task, attempt = running[pipe]
                    value, error, died = _answer(pipe)
                    if died:
                        # Until it is ended, it is among those that are.
                        worker.end()
                        self.died.append((worker.process.pid, task))
                    del running[pipe]
                    if died and attempt < _ATTEMPTS:
                        waiting.appendleft((task, attempt + 1))
                        continue
                    idle += [] if died else [worker]
                    yield task, value, error
        finally:
            for worker in [*idle, *(worker for worker, _, _ in running.values())]:
                worker.end()


def _answer(pipe: Connection) -> tuple[Any, BaseException | None, bool]:
    """Value or error that a process answered with, and whether it died instead."""
    try:
        return *pipe.recv(), False
    except (EOFError, OSError):
        text = "its process died, as did one before: check that there is enough memory, or evaluate this file alone"
        return None, InputError(text), True
    except Exception as error:  # of an exception that cannot be made again here
        return None, InputError(f"it failed with an error that cannot be passed on ({error})"), False


def _end_with_parent() -> None:
    """End with the process that began this one: what it still wrote would be in the way of a resumption."""
    parent = parent_process()
    assert parent is not None, "it was started by another process"
    parent.join()
    os._exit(1)


def _serve(pipe: Connection) -> None:
    """Work through what comes, until the pipe ends; what is interrupted is ended by the process that began it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, name="parent", daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            function, task, arguments = pipe.recv()
            try:
                pipe.send(attempted(function, task, *arguments))
            except (pickle.PicklingError, TypeError, AttributeError) as error:
                pipe.send((None, InputError(f"its result cannot be passed on ({error})")))
