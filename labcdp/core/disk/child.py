"""Reading in a process of its own, for libraries that a damaged file can make loop for ever or crash."""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
from contextlib import suppress
from typing import Any

from ..errors import InputError
from .quoting import reason

#: Time a file has, and its size adds.
_SECONDS, _BYTES_PER_SECOND = 8, 10_000_000
_PROGRAM = "from labcdp.core.disk.child import _work; _work()"


def read_in_child(reader: str, data: bytes, most_bytes: int = 2**32) -> Any:
    """Have a function read bytes in a child process that is killed when it takes too long.

    Parameters
    ----------
    reader : str
        Module and name of the function, ``package.module:function``; it takes the bytes.
    data : bytes
        The file.
    most_bytes : int
        Memory in addition to that of Python and its libraries.

    Returns
    -------
    object
        What the function returns; it is pickled in between.

    Raises
    ------
    InputError
        If the function raises anything, crashes, or needs more time or memory.
    """
    # Of the processor; in all it may be more, as other programs run too.
    seconds = _SECONDS + len(data) // _BYTES_PER_SECOND
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", _PROGRAM, reader, str(seconds), str(most_bytes)]
    try:
        done = subprocess.run(  # noqa: S603 (our own interpreter and arguments)
            command, input=data, capture_output=True, timeout=10 * seconds, env=environment, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise InputError("it is not read in a reasonable time: it is damaged") from error
    if done.returncode != 0:
        raise InputError("it is damaged, or larger than the memory: the library that reads it stopped")
    succeeded, result = pickle.loads(done.stdout)  # noqa: S301 (written by `_work`)
    if not succeeded:
        raise InputError(result)
    return result


def _work() -> None:
    """Be the child: read bytes from standard input, and write the pickled result to standard output."""
    reader, seconds, most_bytes = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    # Libraries write where they like: not between our bytes.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    module, _, name = reader.partition(":")
    read = getattr(importlib.import_module(module), name)
    data = sys.stdin.buffer.read()
    _limit(seconds, most_bytes + len(data))
    try:
        result = True, read(data)
    # Damage can surface as almost any error of the libraries.
    except Exception as error:
        result = False, reason(error)
    pickle.dump(result, out, pickle.HIGHEST_PROTOCOL)
    out.close()


def _limit(seconds: int, most_bytes: int) -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource

        with open("/proc/self/statm", encoding="ascii") as file:
            taken = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_AS, (taken + most_bytes, resource.RLIM_INFINITY))
