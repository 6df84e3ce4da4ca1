"""Process many files; one that fails does not stop the others."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from ...core.computer import Processes, usable_cores
from ...core.disk import real_path
from ...core.errors import LabcdpError
from ..terminal import say

_LOGGER = logging.getLogger(__name__)
_Result = TypeVar("_Result")


def each_once(paths: Sequence[Path], what: str = "file") -> list[Path]:
    """Return the paths without those of the same file as another one, and say so."""
    found: dict[Path, Path] = {}
    for path in paths:
        first = found.setdefault(real_path(path), path)
        if first is not path:
            say(f"Note: {path} is the same {what} as {first} and is evaluated once")
    return list(found.values())


def worked_through(paths: Sequence[Path], work: Callable[[Path], _Result]) -> Iterator[tuple[int, _Result | None, str]]:
    """Process files, on all cores if there are enough of them.

    What the caller does with a result is outside: a full disk ends the command, and is no failure of the file.

    Parameters
    ----------
    paths : sequence of Path
        The files.
    work : callable
        Makes the result of a file; can be sent to another process.

    Yields
    ------
    number of the file, its result or None, and why there is none
        As they come. Whatever the work raises is a reason, in one line; unexpected errors are given with their type.
        Ctrl-C ends the command.
    """
    numbered = list(enumerate(paths))
    # A process takes about as long to start as two pictures.
    n_processes = min(usable_cores(), len(paths) // 2)
    if n_processes < 2:
        yield from ((number, *_worked((number, path), work)) for number, path in numbered)
        return
    for (number, _), answer, error in Processes[tuple[int, Path]](n_processes).run(_worked, numbered, work):
        yield (number, None, _one_line(error)) if answer is None else (number, *answer)


def _worked(numbered: tuple[int, Path], work: Callable[[Path], _Result]) -> tuple[_Result | None, str]:
    path = numbered[1]
    try:
        return work(path), ""
    except LabcdpError as error:
        return None, _one_line(error)
    except OSError as error:
        return None, f"it cannot be read ({_one_line(error)}): check the file and its permissions"
    except MemoryError:
        return None, "not enough memory: use fewer pixels"
    # An error of a library in one of thousands of files must not lose the results of the others.
    except Exception as error:
        _LOGGER.debug("%s failed", path, exc_info=True)
        what = f"{type(error).__name__}: {_one_line(error)}" if str(error) else type(error).__name__
        return None, f"unexpected error ({what}): please report it with this file"


def _one_line(error: BaseException | None) -> str:
    return " ".join(str(error).split())
