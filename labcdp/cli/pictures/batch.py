"""Process many files; one that fails does not stop the others, and all failures are reported at the end."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import typer

from ...core.computer import Processes, usable_cores
from ...core.disk import real_path
from ...core.errors import LabcdpError
from ..terminal import say

_LOGGER = logging.getLogger(__name__)
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Failure:
    """A file that could not be processed.

    Parameters
    ----------
    name : str
        The file, as it was given.
    reason : str
        What was wrong and what to do, in one line.
    """

    name: str
    reason: str


def each_once(paths: Sequence[Path], what: str = "file") -> list[Path]:
    """Return the paths without those of the same file as another one, and say so."""
    found: dict[Path, Path] = {}
    for path in paths:
        first = found.setdefault(real_path(path), path)
        if first is not path:
            say(f"Note: {path} is the same {what} as {first} and is evaluated once")
    return list(found.values())


def worked_through(
    items: Sequence[_Item], work: Callable[[_Item], _Result], n_processes: int | None = None
) -> Iterator[tuple[int, _Result | Failure]]:
    """Process items, on all cores if there are enough of them.

    What the caller does with a result is outside: a full disk ends the command, and is no failure of the file.

    Parameters
    ----------
    items : sequence
        Such as paths.
    work : callable
        Makes the result of an item; can be sent to another process.
    n_processes : int or None
        None for as many as pay; 1 for this one.

    Yields
    ------
    index of the item, result or Failure
        As they come. A failure if the work raised any error; unexpected errors are given with their type. Ctrl-C ends
        the command.
    """
    # A process takes about as long to start as two pictures.
    n_processes = min(usable_cores(), len(items) // 2) if n_processes is None else n_processes
    if n_processes < 2:
        yield from ((number, _worked(item, work)) for number, item in enumerate(items))
        return
    for (number, item), result, error in Processes[tuple[int, _Item]](n_processes).run(
        _worked_numbered, list(enumerate(items)), work
    ):
        yield number, Failure(str(item), " ".join(str(error).split())) if result is None else result


def _worked_numbered(numbered: tuple[int, _Item], work: Callable[[_Item], _Result]) -> _Result | Failure:
    return _worked(numbered[1], work)


def _worked(item: _Item, work: Callable[[_Item], _Result]) -> _Result | Failure:
    try:
        return work(item)
    except LabcdpError as error:
        return Failure(str(item), _one_line(error))
    except OSError as error:
        return Failure(str(item), f"it cannot be read ({_one_line(error)}): check the file and its permissions")
    except MemoryError:
        return Failure(str(item), "not enough memory: use fewer pixels")
    # An error of a library in one of thousands of files must not lose the results of the others.
    except Exception as error:
        _LOGGER.debug("%s failed", item, exc_info=True)
        what = f"{type(error).__name__}: {_one_line(error)}" if str(error) else type(error).__name__
        return Failure(str(item), f"unexpected error ({what}): please report it with this file")


def end_batch(failures: Sequence[Failure], n_items: int, what: str = "files") -> None:
    """Report failures and end the command with exit status 1; do nothing if there are none.

    Parameters
    ----------
    failures : sequence of Failure
        In the order of the items.
    n_items : int
        Number of items.
    what : str
        Name of the items, in the plural.

    Raises
    ------
    typer.Exit
        If something failed.
    """
    if not failures:
        return
    if n_items == 1:
        say(f"labcdp: {failure_line(failures[0])}")
    else:
        say(f"labcdp: {len(failures)} of {n_items} {what} failed:")
        for failure in failures:
            say(f"  {failure_line(failure)}")
    raise typer.Exit(1)


def failure_line(failure: Failure) -> str:
    """Return a failure as one line; most messages already name the file."""
    return failure.reason if failure.name in failure.reason else f"{failure.name}: {failure.reason}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
