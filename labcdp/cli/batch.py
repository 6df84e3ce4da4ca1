"""Many files in one command: one that fails does not stop the others, and all that failed are told at the end."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import typer

from ..errors import LabcdpError
from .terminal import say

_LOGGER = logging.getLogger(__name__)
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Failure:
    """A file that could not be worked on.

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
    """Work on one item after the other.

    What the caller does with a result is outside: a full disk ends the command, and is no failure of the file.

    Parameters
    ----------
    items : iterable
        Such as paths.
    work : callable
        Makes the result of an item.
    name : callable
        What failures call an item.

    Yields
    ------
    item, result or Failure
        A failure where the work raised any error: those of labcdp and of the file system tell what to do, and of what
        nobody foresaw the kind is told, as it should be reported. Ctrl-C ends the command.
    """
    for item in items:
        try:
            yield item, work(item)
        except LabcdpError as error:
            yield item, Failure(name(item), _one_line(error))
        except OSError as error:
            yield item, Failure(name(item), f"it cannot be read ({_one_line(error)}): give a file you can read")
        except MemoryError:
            yield item, Failure(name(item), "there is not enough memory for it: give fewer pixels")
        # One file out of thousands that a library trips over does not cost the results of the others.
        except Exception as error:
            _LOGGER.debug("%s failed", name(item), exc_info=True)
            what = f"{type(error).__name__}: {_one_line(error)}" if str(error) else type(error).__name__
            yield item, Failure(name(item), f"an unforeseen error ({what}): please report it, with this file")


def end_batch(failures: Sequence[Failure], n_items: int, what: str = "files") -> None:
    """Tell what failed, and end the command with exit status 1; do nothing if all went well.

    Parameters
    ----------
    failures : sequence of Failure
        In the order of the items.
    n_items : int
        How many there were.
    what : str
        What they are called, in the plural.

    Raises
    ------
    typer.Exit
        If something failed.
    """
    if not failures:
        return
    if n_items == 1:
        say(f"labcdp: {told(failures[0])}")
    else:
        say(f"labcdp: {len(failures)} of {n_items} {what} failed:")
        for failure in failures:
            say(f"  {told(failure)}")
    raise typer.Exit(1)


def told(failure: Failure) -> str:
    """Tell a failure in one line; most messages name the file themselves."""
    return failure.reason if failure.name in failure.reason else f"{failure.name}: {failure.reason}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
