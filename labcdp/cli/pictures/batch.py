"""Process many files; one that fails does not stop the others, and all failures are reported at the end."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import typer

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


def worked_through(
    items: Iterable[_Item], work: Callable[[_Item], _Result], name: Callable[[_Item], str] = str
) -> Iterator[tuple[_Item, _Result | Failure]]:
    """Process one item after the other.

    What the caller does with a result is outside: a full disk ends the command, and is no failure of the file.

    Parameters
    ----------
    items : iterable
        Such as paths.
    work : callable
        Makes the result of an item.
    name : callable
        Name of an item in failures.

    Yields
    ------
    item, result or Failure
        A failure if the work raised any error; unexpected errors are given with their type. Ctrl-C ends the command.
    """
    for item in items:
        try:
            yield item, work(item)
        except LabcdpError as error:
            yield item, Failure(name(item), _one_line(error))
        except OSError as error:
            yield (
                item,
                Failure(name(item), f"it cannot be read ({_one_line(error)}): check the file and its permissions"),
            )
        except MemoryError:
            yield item, Failure(name(item), "not enough memory: use fewer pixels")
        # An error of a library in one of thousands of files must not lose the results of the others.
        except Exception as error:
            _LOGGER.debug("%s failed", name(item), exc_info=True)
            what = f"{type(error).__name__}: {_one_line(error)}" if str(error) else type(error).__name__
            yield item, Failure(name(item), f"unexpected error ({what}): please report it with this file")


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
