"""Regular files of a limited size, and what messages quote of them: little, and printable."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from io import BufferedRandom, BufferedReader
from os import PathLike
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory
from typing import TypeAlias

from ..errors import InputError, printable

#: Name of the journal in the folder of a session, by which it is known.
SESSION_JOURNAL = "journal.jsonl"
#: Characters of an input in a message.
MOST_QUOTED = 100
#: Most digits of a whole number; more indicate damage, and parsing time is quadratic.
MOST_DIGITS = 40


def shortened(text: str, most: int = MOST_QUOTED) -> str:
    """Return the text, printable, and cut if it is long."""
    # Cut first: escaping text of many megabytes takes long.
    text = printable(text[: most + 1])
    return text if len(text) <= most else f"{text[: most - 3]}..."


def quoted(value: object) -> str:
    """Return a value as messages show it: as JSON has it, and short."""
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple) and len(value) > 4:
        return f"a list of {len(value)}"
    if isinstance(value, str | bytes):
        value = value[: MOST_QUOTED + 1]
    if isinstance(value, list | tuple):
        value = type(value)(map(_short, value))
    return shown(value)


def _short(value: object) -> object:
    return value if isinstance(value, float) else _Shown(quoted(value))


class _Shown(str):
    """A text whose repr is itself."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def shown(value: object) -> str:
    """Return a value as messages about parameters show it: as Python writes it, and short."""
    if isinstance(value, int) and abs(value) >= 10**MOST_DIGITS:
        return f"a number of more than {MOST_DIGITS} digits"
    return shortened(repr(value))


def suggestion(name: object, known: Iterable[str], instead: str = "known here are") -> str:
    """Say which known name is most like one that is not known, or else all that there are."""
    names = list(known)
    close = get_close_matches(str(name)[:MOST_QUOTED], names, n=1)
    return f"did you mean {close[0]}?" if close else f"{instead} {', '.join(names)}"


def reason(error: BaseException) -> str:
    """Return why something failed as one short line: of an error of the system its text, of others the first line."""
    if isinstance(error, OSError) and error.strerror:
        return shortened(error.strerror)
    if isinstance(error, RecursionError):
        return "nested too deep"
    first = next(iter(str(error).strip().splitlines()), "")
    return shortened(first) if first else type(error).__name__


@contextmanager
def damage_reported(text: str, remedy: str = "") -> Iterator[None]:
    """Turn what a library raises of damaged data, which is nearly anything, into InputError with its reason."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        raise InputError(f"{text} ({reason(error)}){remedy}") from error


AnyPath: TypeAlias = str | PathLike[str]

#: What a path leads to where it is no regular file.
FILE_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
#: What is read of a file that does not say its size.
_UNSIZED_BYTES = 2**20
# A pipe without a writer would block, a terminal become that of this process. Windows needs to know that it is no text.
_FLAGS = sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_NONBLOCK", "O_NOCTTY", "O_BINARY"))


def open_regular(path: AnyPath, writable: bool = False) -> BufferedReader | BufferedRandom:
    """Open a regular file, for reading or, made if it is not there, for reading and writing.

    Raises
    ------
    OSError
        If that is not possible, or it is a folder, pipe, device or socket; its ``strerror`` says so.
    """
    # A device does things when it is opened: a rewound tape, a reset board.
    _require_regular(path, missing_is_good=writable)
    flags = _FLAGS | (os.O_RDWR | os.O_CREAT if writable else os.O_RDONLY)
    number = os.open(path, flags, 0o666)
    file = os.fdopen(number, "r+b") if writable else os.fdopen(number, "rb")
    try:
        _require_kind(os.fstat(file.fileno()).st_mode, path)
    except BaseException:
        file.close()
        raise
    return file


def _require_regular(path: AnyPath, missing_is_good: bool) -> None:
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        if missing_is_good:
            return
        raise
    except ValueError as error:
        raise OSError(errno.EINVAL, "its name holds a null character", str(path)) from error
    _require_kind(mode, path)


def _require_kind(mode: int, path: AnyPath) -> None:
    if not stat.S_ISREG(mode):
        kind = FILE_KINDS.get(stat.S_IFMT(mode))
        not_file = (
            "it is a folder" if kind == "a folder" else f"it is {kind}, not a file" if kind else "it is not a file"
        )
        raise OSError(errno.EINVAL, not_file, str(path))


def read_at_most(path: AnyPath, most_bytes: int) -> bytes:
    """Read a regular file; raises OSError as `open_regular`, or if it is larger."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size <= most_bytes:
            # Files of /proc have no size. Memory is allocated for the maximum.
            data = file.read(max(size, _UNSIZED_BYTES) + 1)
            if len(data) <= max(size, _UNSIZED_BYTES):
                return data
            raise OSError(errno.EBUSY, "it grows while it is read", str(path))
    raise OSError(errno.EFBIG, f"it is larger than {_size(most_bytes)}", str(path))


def _size(n_bytes: int) -> str:
    return f"{n_bytes // 2**20} MiB" if n_bytes >= 2**20 else f"{n_bytes} bytes"


def read_bytes(path: AnyPath, what: str, most_bytes: int, error: type[InputError] = InputError) -> bytes:
    """Read a regular file.

    Parameters
    ----------
    path : path
        The file.
    what : str
        What to give instead, for messages: "a chain file".
    most_bytes : int
        Size from which a file is refused.
    error : type of InputError
        What is raised.

    Raises
    ------
    InputError
        If it cannot be read, is no regular file, or is larger.
    """
    with reading(path, what, error):
        return read_at_most(path, most_bytes)


@contextmanager
def reading(path: AnyPath, what: str, error: type[InputError] = InputError) -> Iterator[None]:
    """Turn an OSError into an InputError that names the file or folder, and what to give instead."""
    try:
        yield
    except OSError as caught:
        raise error(f"{path} cannot be read ({reason(caught)}): give {what}") from caught


def read_text(path: AnyPath, what: str, most_bytes: int, error: type[InputError] = InputError) -> str:
    """Read a file of UTF-8 text, with a byte order mark or not; raises as `read_bytes`, or if it is no text."""
    data = read_bytes(path, what, most_bytes, error)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as caught:
        raise error(f"{path} is not UTF-8 text (byte {caught.start}): give {what}, saved as UTF-8") from caught


def file_sha256(path: AnyPath, what: str) -> str:
    """Return the hash of a regular file, which is read in pieces; raises InputError as `require_regular`."""
    with reading(path, what), open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_regular(path: AnyPath, what: str) -> int:
    """Return the size in bytes of a file that a library opens by its name.

    Raises
    ------
    InputError
        If it cannot be read or is no regular file.
    """
    with reading(path, what), open_regular(path) as file:
        return os.fstat(file.fileno()).st_size


def plain_name(name: str) -> str:
    """Return the name of a file for another one that is written: what cannot be printed as its digits."""
    return name if name.isprintable() else printable(name).replace("\\", "-")


def shell_word(path: AnyPath) -> str:
    r"""Return a path as a shell takes it, in one printable line: what cannot be printed as in ``$'Pr\\xfcf.png'``."""
    text = os.fspath(path)
    if text.isprintable():
        return quote(text)
    marks = {"\\": "\\\\", "'": "\\'"}
    return f"$'{''.join(marks.get(one) or printable(one) for one in text)}'"


#: What libraries take for patterns, numbers and protocols in a name, on systems that allow them.
_MARKS = frozenset("%*?:|") if os.name == "posix" else frozenset()


@contextmanager
def named_plainly(path: AnyPath) -> Iterator[Path]:
    """Give a name of a file, there or to be made, to libraries that take UTF-8 only, or patterns: a link if need be."""
    full = os.path.abspath(path)
    if full.isprintable() and not _MARKS.intersection(full):
        yield Path(path)
        return
    with TemporaryDirectory(prefix="labcdp-") as folder:
        link = Path(folder, f"file{plain_name(Path(path).suffix)}")
        link.symlink_to(full)
        yield link


def real_path(path: AnyPath) -> Path:
    """Return the path with symbolic links followed; those that lead in a circle stay."""
    return Path(os.path.realpath(path))


def is_file(path: AnyPath) -> bool:
    """Whether there is a regular file; False also for names that no file can have."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False
