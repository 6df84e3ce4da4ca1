"""Processes of this computer that work through tasks; they are reached by pipes, and listen nowhere."""

from __future__ import annotations

import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Generic, TypeVar

from ..errors import InputError

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
        return None, InputError(f"it failed with an error that cannot be handed on ({error})"), False


def _serve(pipe: Connection) -> None:
    """Work through what comes, until the pipe ends; what is interrupted is ended by the process that began it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            function, task, arguments = pipe.recv()
            answer: tuple[Any, BaseException | None]
            try:
                answer = function(task, *arguments), None
            except Exception as error:
                answer = None, error
            try:
                pipe.send(answer)
            except (pickle.PicklingError, TypeError, AttributeError) as error:
                pipe.send((None, InputError(f"its result cannot be handed on ({error})")))
