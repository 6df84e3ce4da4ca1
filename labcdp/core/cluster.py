"""Workers of a Dask cluster that work through tasks, as the processes of this computer do."""

from __future__ import annotations

import logging
import os
import secrets
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from ssl import SSLError
from typing import Any, Generic, Protocol, TypeVar
from urllib.parse import urlsplit

from .disk.files import reason
from .errors import InputError

#: Loggers that Dask gives levels and outputs of their own.
_LOGGERS = ("distributed", "distributed.client", "distributed.gc", "tornado", "tornado.application", "asyncio")
#: Time a scheduler is given to answer, and one to get a worker, in seconds.
_ANSWER_S, _WORKER_S = 10.0, 60.0

_Task = TypeVar("_Task")
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class TlsFiles:
    """Files by which the two sides of a connection know each other and encrypt what they send (PEM).

    Parameters
    ----------
    ca : Path
        Certificate of the authority that signed those of scheduler and workers.
    certificate, key : Path
        Of this computer.

    Raises
    ------
    InputError
        If there is no such file.
    """

    ca: Path
    certificate: Path
    key: Path

    def __post_init__(self) -> None:
        for name in ("ca", "certificate", "key"):
            path = getattr(self, name)
            if not path.is_file():
                raise InputError(f"{path} is not a file: give the {name} of the cluster as a PEM file")

    def security(self) -> Any:
        """Return them as Dask takes them; what is sent is encrypted."""
        from distributed.security import Security

        return Security(
            require_encryption=True,
            tls_ca_file=str(self.ca),
            tls_client_cert=str(self.certificate),
            tls_client_key=str(self.key),
        )


class Runner(Protocol[_Task]):
    """What works through tasks: threads or processes of this computer, or a cluster."""

    def run(
        self, function: Callable[..., _Value], tasks: Sequence[_Task], *arguments: Any
    ) -> Iterator[tuple[_Task, _Value | None, BaseException | None]]:
        """Call a function with each task and the arguments, and return results or errors as they come."""


class Cluster(Generic[_Task]):
    """Workers of a cluster, with the interface of `labcdp.core.computer.Processes`.

    Where a worker dies, Dask gives its task to another one, as often as its `allowed-failures` says.

    Parameters
    ----------
    client : distributed.Client
        Connected to the scheduler.
    folder : Path or None
        That all workers have to see.
    versions : mapping of str to str
        Packages and their versions here, which the workers must have, too.
    """

    def __init__(self, client: Any, folder: Path | None, versions: Mapping[str, str]) -> None:
        self._client, self._folder, self._versions = client, folder, versions

    def run(
        self, function: Callable[..., _Value], tasks: Sequence[_Task], *arguments: Any
    ) -> Iterator[tuple[_Task, _Value | None, BaseException | None]]:
        """Call a function with each task and the arguments, and return results or errors as they come.

        Raises
        ------
        InputError
            If the scheduler does not answer any more, there is no worker, or one that cannot be used.
        """
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        try:
            waiting = deque(tasks)
            running: dict[Any, _Task] = {}

            def fill() -> None:
                # What waits for a worker that dies would be suspected, too: no more is given out than is done at once.
                n_threads = self._n_threads() if waiting else 0
                while waiting and len(running) < n_threads:
                    task = waiting.popleft()
                    running[self._client.submit(function, task, *arguments, pure=False)] = task

            fill()
            while running:
                for future in self._completed(list(running)):
                    value: _Value | None = None
                    error: BaseException | None = None
                    try:
                        value = future.result(timeout=_ANSWER_S)
                    except (CommClosedError, CancelledError):
                        raise
                    except KilledWorker as killed:
                        error = InputError(
                            f"its worker died, as did others before (the last one was {killed.last_worker.address}): "
                            "check that there is enough memory, or evaluate this file alone"
                        )
                    except Exception as raised:
                        error = raised
                    task = running.pop(future)
                    fill()
                    yield task, value, error
        except (CommClosedError, CancelledError, OSError) as error:
            raise InputError(
                f"the Dask scheduler at {self._client.scheduler.address} no longer answers: start it again; what was "
                "finished is recorded"
            ) from error

    def _completed(self, futures: Sequence[Any]) -> Sequence[Any]:
        """Wait until some are completed, as long as there is a worker."""
        from distributed import wait

        while True:
            try:
                return list(wait(futures, timeout=_WORKER_S, return_when="FIRST_COMPLETED").done)
            except TimeoutError:
                self._require_worker()

    def _require_worker(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_WORKER_S)
        except TimeoutError as error:
            raise InputError(
                f"the cluster has had no worker for {_WORKER_S:g} s: start workers, and try again"
            ) from error

    def _n_threads(self) -> int:
        """Wait for a worker, make sure that all can be used, and count their threads."""
        self._require_worker()
        sees = {} if self._folder is None else self._sees(self._folder)
        for address, node in self._client.get_versions(packages=list(self._versions))["workers"].items():
            for package, version in self._versions.items():
                if (there := node["packages"].get(package)) != version:
                    raise InputError(
                        f"worker {address} has {package} {there}, this computer {version}: install the same version "
                        "to get the same results"
                    )
            if not sees.get(address, True):
                raise InputError(
                    f"worker {address} does not see the folder {self._folder}: give a folder that all workers see "
                    "under the same path"
                )
        return sum(self._client.nthreads().values())

    def _sees(self, folder: Path) -> dict[str, bool]:
        """Whether each worker sees what is made in a folder."""
        probe = folder / f".labcdp-{secrets.token_hex(8)}.part"
        try:
            probe.touch()
            return dict(self._client.run(os.path.exists, str(probe), on_error="ignore"))
        finally:
            probe.unlink(missing_ok=True)


@dataclass(frozen=True)
class Workers:
    """What works through tasks: this computer, with a worker a core unless told, or a Dask scheduler's workers.

    Parameters
    ----------
    address : str or None
        Of a scheduler; None for this computer.
    n_workers : int or None
        Of this computer; None for one a core.
    tls : TlsFiles or None
        For an address ``tls://``; None for a cluster without encryption and passwords.
    """

    address: str | None = None
    n_workers: int | None = None
    tls: TlsFiles | None = None

    @contextmanager
    def opened(
        self, here: Callable[[int | None], Runner[_Task]], folder: Path | None, versions: Mapping[str, str]
    ) -> Iterator[Runner[_Task]]:
        """Start workers of this computer, or connect to a cluster.

        Parameters
        ----------
        here : callable
            Makes those of this computer, which open no port.
        folder : Path or None
            Where workers of a cluster are to write; made if it does not exist. None if they write nothing.
        versions : mapping of str to str
            As for `Cluster`.

        Raises
        ------
        InputError
            If the scheduler cannot be reached, or the folder cannot be made.
        """
        if self.address is None:
            yield here(self.n_workers)
            return
        if (self.tls is not None) != self.address.startswith("tls://"):
            raise InputError(
                f"the cluster is {self.address}: give its TLS files only with an address that begins with tls://"
            )
        try:
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be made ({error.strerror}): choose a folder you can write to") from error
        from distributed import Client
        from distributed.comm.addressing import parse_address
        from distributed.comm.registry import get_backend

        security = None if self.tls is None else self.tls.security()
        with ExitStack() as stack:
            stack.enter_context(_quiet())
            try:
                # A client for an address of unknown kind leaves a task behind that fails later.
                get_backend(parse_address(self.address)[0])
                client = stack.enter_context(Client(self.address, timeout=_ANSWER_S, security=security))
            except (OSError, ValueError, TimeoutError) as error:
                raise InputError(self._not_connected(error)) from error
            yield Cluster(client, folder, versions)

    def _not_connected(self, error: BaseException) -> str:
        """Say why there is no connection: certificates that do not fit, or no scheduler."""
        from distributed.comm.core import FatalCommClosedError

        if any(isinstance(one, SSLError | FatalCommClosedError) for one in _causes(error)):
            return (
                f"the certificates of this computer and of the scheduler at {self.address} do not match "
                f"({reason(error)}): both must be signed by the authority that is given first, and the key must be "
                "that of the certificate"
            )
        scheme = "tcp" if self.tls is None else "tls"
        return (
            f"no Dask scheduler answers at {self.address}: start one with dask scheduler, or give its address, for "
            f"example {scheme}://192.0.2.7:8786"
        )

    @property
    def is_open_to_others(self) -> bool:
        """Whether the cluster has neither encryption nor passwords, and is not on this computer alone."""
        host = urlsplit(self.address or "").hostname or ""
        return self.address is not None and self.tls is None and host not in ("127.0.0.1", "localhost", "::1")


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and those that it came of."""
    cause: BaseException | None = error
    while cause is not None:
        yield cause
        cause = cause.__cause__ or cause.__context__


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
