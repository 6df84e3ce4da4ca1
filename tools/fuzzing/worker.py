"""Trying damaged files in a process of its own, with limits on memory and time, and judging what came of it."""

import hashlib
import os
import pickle
import random
import resource
import shutil
import signal
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labcdp.core.errors import LabcdpError

from .damage import damaged
from .targets import SEEDS, TARGETS, WrongNumberError

#: Memory beside what is taken before the first input.
MOST_BYTES = 2**30
#: Characters of a message beside the paths it names.
MOST_CHARACTERS = 1000


class HangError(BaseException):
    """An input took longer than it may."""


@dataclass(frozen=True)
class Finding:
    """An input that was not refused in one clear line, or read as what it is not.

    Parameters
    ----------
    target : str
        The reader.
    number : int
        Number of the input, from which it can be made again.
    kind : str
        What happened, and where; the same for inputs that fail alike.
    detail : str
        The traceback or message.
    """

    target: str
    number: int
    kind: str
    detail: str


class Bench:
    """A target with its seeds copied to a folder in which they are damaged.

    Parameters
    ----------
    name : str
        The target.
    seeds, work : Path
        Folders of all seeds, and of copies.
    seed : int
        Of the random numbers.
    """

    def __init__(self, name: str, seeds: Path, work: Path, seed: int) -> None:
        self.name, self.target, self.seed = name, TARGETS[name], seed
        self.folder = work / name
        self._origin = seeds / SEEDS.get(name, name)
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self._origin, self.folder)
        self.files = sorted(path for path in self.folder.glob(self.target.files) if path.is_file())
        self.before = {path: fingerprint(self._read(path)) for path in self.files}

    def _read(self, path: Path) -> Any:
        return self.target.read(self.folder, path)

    def input(self, number: int) -> tuple[Path, bytes]:
        """Return the file to be damaged, and its damaged content, for the input of this number."""
        rng = random.Random(f"{self.seed} {self.name} {number}")
        path = rng.choice(self.files)
        data = damaged(self._whole(path), self.target.ways, rng)
        return path, self.target.repair(data) if self.target.repair else data

    def _whole(self, path: Path) -> bytes:
        return (self._origin / path.relative_to(self.folder)).read_bytes()

    def attempt(self, number: int) -> Finding | None:
        """Try an input; None if all was well."""
        path, data = self.input(number)
        path.write_bytes(data)
        try:
            with _alarm(self.target.most_seconds), warnings.catch_warnings(action="error", category=RuntimeWarning):
                found = fingerprint(self._read(path))
        except LabcdpError as error:
            problem = _problem_of_message(str(error), self.folder)
            return Finding(self.name, number, f"message: {problem}", str(error)[:2000]) if problem else None
        except WrongNumberError as error:
            return Finding(self.name, number, "wrong number", str(error)[:500])
        except HangError:
            return Finding(self.name, number, f"hang: {_place(traceback.format_exc())}", "")
        except BaseException as error:
            text = "".join(traceback.format_exception(error, limit=-12))
            return Finding(self.name, number, f"{type(error).__name__} at {_place(text)}", text[-3000:])
        finally:
            self._restore(path)
        if self.target.strict and data != self._whole(path) and not self._same(found, path):
            return Finding(self.name, number, "wrong number: an altered file was accepted", repr(found)[:500])
        return None

    def _same(self, found: Any, path: Path) -> bool:
        """Whether the same was read; journals may end earlier."""
        return bool(
            found == self.before[path] or (isinstance(found, tuple) and found == self.before[path][: len(found)])
        )

    def _restore(self, path: Path) -> None:
        for other in self.folder.rglob("*"):
            if other.is_file() and not (self._origin / other.relative_to(self.folder)).exists():
                other.unlink()
        path.write_bytes(self._whole(path))


def fingerprint(value: Any) -> Any:
    """Return what tells results apart: a tuple for lists, so that a shorter one can be compared, else a hash."""
    if isinstance(value, list):
        return tuple(map(fingerprint, value))
    return hashlib.sha256(pickle.dumps(value)).hexdigest()


def _problem_of_message(text: str, folder: Path) -> str:
    if not text.isprintable():
        return "it is more than one line, or has control characters"
    if len(text.replace(str(folder), "")) > MOST_CHARACTERS:
        return f"it has {len(text)} characters" if len(text) < 10_000 else "it is very long"
    return ""


def _place(text: str) -> str:
    """Return the innermost line of labcdp in a traceback."""
    lines = [line.strip() for line in text.splitlines() if line.strip().startswith("File ")]
    own = [line for line in lines if "/labcdp/" in line or "/drivers/" in line or "/calibration/" in line]
    return (own or lines or [""])[-1].rpartition("/")[2].replace('"', "")


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """Raise after so much processor time: on a busy computer any input takes long; what waits is ended outside."""

    def ring(*_: object) -> None:
        raise HangError

    old = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, old)


def limit_memory() -> None:
    """Limit this process to what it has taken, and some more."""
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + MOST_BYTES, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def work(connection: Any, benches: list[tuple[str, Path, Path, int]]) -> None:
    """Serve (target, number) pairs: answer each with a finding or None, and the seconds it took."""
    # Libraries tell of damage on the terminal.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    made = {arguments[0]: Bench(*arguments) for arguments in benches}
    limit_memory()
    connection.send("ready")
    while (asked := connection.recv()) is not None:
        name, number = asked
        began = time.monotonic()
        found = made[name].attempt(number)
        connection.send((found, time.monotonic() - began))
