"""Workers of a Dask cluster that work through tasks."""

from __future__ import annotations

import logging
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from ....core.errors import InputError
from ....core.finding import Finding, warning
from ....report.findings import finding_text
from ..checks import package_versions
from .record import ArchiveTask, NotSeenError
from .tls import TlsFiles

#: Loggers that Dask gives levels and outputs of their own.
_LOGGERS = ("distributed", "distributed.client", "distributed.gc", "tornado", "tornado.application", "asyncio")

#: Polling interval for active workers, in seconds.
_LOOK_S = 0.3

#: Time a scheduler is given to answer, one whose workers cannot be used to get another, and one without a worker to get
#: one, in seconds.
_ANSWER_S, _USABLE_S, _WORKER_S = 10.0, 10.0, 60.0

#: So often a task is given to a worker before it is given up, if workers die of it.
_ATTEMPTS = 2

_Value = TypeVar("_Value")


class Cluster:
    """Workers of a Dask cluster, each with as many tasks at a time as it has threads.

    The tasks are given out here and not by the scheduler's own rules, so that it is known which task a worker died
    of: a scheduler hands a worker more than it can do at once, and suspects all of it.

    Parameters
    ----------
    client : distributed.Client
        Connected to the scheduler.
    folder : Path
        Where the workers are to write.
    """

    def __init__(self, client: Any, folder: Path) -> None:
        self._client = client
        self._folder = folder
        self._died: list[Finding] = []
        #: Threads of each worker that may be used, and why others may not.
        self._threads: dict[str, int] = {}
        self._refused: dict[str, Finding] = {}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Workers that died, with what they were at, and workers that could not be used."""
        return (*self._died, *self._refused.values())

    def run(
        self, function: Callable[..., _Value], tasks: Sequence[ArchiveTask], *arguments: Any
    ) -> Iterator[tuple[ArchiveTask, _Value | None, BaseException | None]]:
        """Call a function with each task and the arguments, and return results or errors as they come.

        Raises
        ------
        InputError
            If the scheduler does not answer any more, or there is no worker.
        """
        waiting = deque((task, 1) for task in tasks)
        running: dict[Any, tuple[str, ArchiveTask, int]] = {}
        try:
            while waiting or running:
                with _answering(self._client):
                    self._look()
                    for address in self._idle([address for address, _, _ in running.values()]):
                        if waiting:
                            task, attempt = waiting.popleft()
                            future = self._client.submit(
                                function, task, *arguments, workers=[address], pure=False, key=_key(task, attempt)
                            )
                            running[future] = (address, task, attempt)
                    ended = [(*running.pop(future), _outcome(future)) for future in self._ended(running)]
                for address, task, attempt, (died, value, error) in ended:
                    if died:
                        self._died.append(warning("worker-died", address, video=str(task.video)))
                        if attempt < _ATTEMPTS:
                            waiting.appendleft((task, attempt + 1))
                            continue
                        error = InputError(_died_of(address))
                    yield task, value, None if error is None else _named(error, address)
        finally:
            if running:
                with suppress(Exception):
                    self._client.cancel(list(running), force=True)

    def _look(self) -> None:
        """Find out which workers there are, and check new ones; wait for some if there are none."""
        start = time.monotonic()
        while True:
            workers = self._workers()
            new = [one for one in workers if one not in self._threads and one not in self._refused]
            for address in new:
                reason = self._unusable(address)
                if reason:
                    self._refused[address] = warning("worker-refused", address, reason=reason)
                else:
                    self._threads[address] = int(workers[address]["nthreads"])
            self._threads = {one: threads for one, threads in self._threads.items() if one in workers}
            if self._threads:
                return
            waited_s = time.monotonic() - start
            if workers and waited_s > _USABLE_S:
                raise InputError("; ".join(finding_text(self._refused[address]) for address in workers))
            if waited_s > _WORKER_S:
                raise InputError(f"the cluster has had no worker for {_WORKER_S:g} s: start workers, and try again")
            time.sleep(_LOOK_S)

    def _workers(self) -> dict[str, Any]:
        """Ask the scheduler for its workers; raises ConnectionError if it does not answer."""
        workers: dict[str, Any] | None = self._client.scheduler_info(n_workers=-1).get("workers")
        if workers is None:
            raise ConnectionError("the scheduler went away")
        return workers

    def _unusable(self, address: str) -> str:
        """Say why a worker cannot be used, or nothing."""
        with _probe(self._folder) as name:
            try:
                answer = self._client.run(_look_around, str(self._folder / name), workers=[address])[address]
            except ImportError as error:
                return f"labcdp cannot be imported there ({error}): install the same version as here"
            except (OSError, KeyError, TimeoutError) as error:
                return f"it does not answer ({type(error).__name__}): start it again"
        here = package_versions()
        for package, there in answer["versions"].items():
            if there != here[package]:
                return (
                    f"it has {package} {there}, this computer {here[package]}: install the same, for the same results"
                )
        if not answer["sees"]:
            return f"it does not see the folder {self._folder}: give a folder that all workers see under the same path"
        return ""

    def _idle(self, busy: Sequence[str]) -> list[str]:
        """Workers with a thread that has nothing to do, once for each such thread."""
        return [one for one, threads in self._threads.items() for _ in range(threads - busy.count(one))]

    def _ended(self, running: dict[Any, tuple[str, ArchiveTask, int]]) -> list[Any]:
        """Wait a moment; return tasks that are done, and those whose worker is gone."""
        from distributed import wait

        with suppress(TimeoutError):
            wait(list(running), timeout=_LOOK_S, return_when="FIRST_COMPLETED")
        return [
            future
            for future, (address, _, _) in running.items()
            if future.status != "pending" or address not in self._threads
        ]


@contextmanager
def open_cluster(address: str, tls: TlsFiles | None, folder: Path) -> Iterator[Cluster]:
    """Connect to a cluster.

    Parameters
    ----------
    address : str
        Of a scheduler.
    tls : TlsFiles or None
        For an address ``tls://``; None for a cluster without encryption and passwords.
    folder : Path
        Where the workers are to write; made if it does not exist.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, or the folder cannot be made.
    """
    if (tls is not None) != address.startswith("tls://"):
        raise InputError(
            f"the cluster is {address}: give its TLS files with an address that begins with tls://, and not else"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): give a folder you can write to") from error
    from distributed import Client
    from distributed.comm.addressing import parse_address
    from distributed.comm.registry import get_backend

    with ExitStack() as stack:
        stack.enter_context(_quiet())
        try:
            # A client for an address of unknown kind leaves a task behind that fails later.
            get_backend(parse_address(address)[0])
            client = stack.enter_context(
                Client(address, timeout=_ANSWER_S, security=None if tls is None else tls.security())
            )
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(
                f"no Dask scheduler answers at {address}: start one with dask scheduler, or give its address, for "
                "example tcp://192.0.2.7:8786"
            ) from error
        yield Cluster(client, folder)


def _key(task: ArchiveTask, attempt: int) -> str:
    return f"labcdp-{task.video.name}-{attempt}-{secrets.token_hex(6)}"


def _died_of(address: str) -> str:
    return f"worker {address} died, as did one before: check that there is enough memory, or evaluate this video alone"


def _named(error: BaseException, address: str) -> BaseException:
    """Name the worker in an error that is of its computer and not of the video."""
    return InputError(f"worker {address}: {error}") if isinstance(error, NotSeenError) else error


def _outcome(future: Any) -> tuple[bool, Any, BaseException | None]:
    """Whether the worker died, the value, and the error that the task raised."""
    died, value, error = future.status == "pending", None, None
    if future.status == "error":
        error = future.exception()
    elif not died:
        try:
            value = future.result(timeout=_ANSWER_S)
        except (OSError, TimeoutError):  # it died between the end of the task and this question
            died = True
    future.release()
    return died, value, error


@contextmanager
def _answering(client: Any) -> Iterator[None]:
    """Turn what a scheduler that went away causes into one error."""
    from distributed.comm.core import CommClosedError

    try:
        yield
    except (CommClosedError, OSError, CancelledError) as error:
        raise InputError(
            f"the Dask scheduler at {client.scheduler.address} no longer answers: start it again; what was "
            "finished is recorded"
        ) from error


@contextmanager
def _probe(folder: Path) -> Iterator[str]:
    """Put a file into a folder, by which a worker knows it again."""
    name = f".labcdp-{secrets.token_hex(8)}.part"
    try:
        (folder / name).touch()
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({error.strerror}): give a folder you can write to") from error
    try:
        yield name
    finally:
        (folder / name).unlink(missing_ok=True)


def _look_around(probe: str) -> dict[str, Any]:
    """Return resources and visible files of a worker; runs there."""
    return {"versions": package_versions(), "sees": Path(probe).exists()}


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log from the terminal: what matters is in results and errors."""
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
