"""Files of a drawing: the output, its lock, and the backup of unsaved changes."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from ...core.disk import file_sha256
from ...core.errors import InputError
from ...output.file import lock, require_replaceable
from ...regions import REGION_SUFFIXES, ImageSize, Shape, load_regions, save_regions
from ...report.text import printable
from .drawing import Drawing, History


@dataclass(frozen=True)
class DrawingFiles:
    """The output file of a drawing, and a backup next to it with unsaved changes.

    Parameters
    ----------
    output : Path
        Region file: .json, .roi or .zip.
    size : (int, int)
        Width and height of the image in pixels.
    """

    output: Path
    size: ImageSize

    def __post_init__(self) -> None:
        if self.output.suffix.lower() not in REGION_SUFFIXES:
            raise InputError(
                f"--output {self.output} has an unknown suffix: give a name that ends in {', '.join(REGION_SUFFIXES)}"
            )
        if not self.output.parent.is_dir():
            raise InputError(f"{self.output.parent} is not a folder: give --output in an existing folder")
        if self.output.is_dir():
            raise InputError(f"--output {self.output} is a folder: give the name of a file")

    @property
    def unsaved(self) -> Path:
        """Backup of a drawing with unsaved changes, itself a region file."""
        return self.output.with_name(f"{self.output.name}.unsaved.json")

    def keep(self, shapes: tuple[Shape, ...]) -> None:
        """Write the backup, or remove it for no shapes; raises InputError if that is not possible."""
        if shapes:
            save_regions(self.unsaved, shapes, self.size, force=True)
            return
        require_replaceable(self.unsaved)
        try:
            self.unsaved.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(
                f"{self.unsaved} cannot be removed ({error.strerror}): remove it, or it is taken for newer"
            ) from error

    def kept(self) -> tuple[Shape, ...]:
        """Return shapes that an earlier run did not save; empty without a backup.

        Raises
        ------
        InputError
            If the backup cannot be used with this image.
        """
        if not self.unsaved.exists():
            return ()
        try:
            return load_regions(self.unsaved, self.size)
        except InputError as error:
            raise InputError(
                f"{error}; it contains an unsaved drawing: use the image it was drawn on, or move the file away"
            ) from error

    def beside(self, name: str, suffixes: tuple[str, ...] = REGION_SUFFIXES) -> Path:
        """Return the path for a file name given on the page, in the folder of the output.

        Raises
        ------
        InputError
            If it is not a plain file name that ends in one of `suffixes`.
        """
        name = name.strip()
        if not name or Path(name).name != name or name.startswith(".") or not name.isprintable():
            raise InputError(
                f"{name!r} is not a plain file name: give one without folders; it is written to {self.output.parent}"
            )
        if Path(name).suffix.lower() not in suffixes:
            raise InputError(f"{name!r} has an unknown suffix: give a name that ends in {', '.join(suffixes)}")
        return self.output.with_name(name)

    def fingerprint(self, path: Path) -> str:
        """SHA-256 of a file, empty if there is none; raises InputError if it cannot be read."""
        return file_sha256(path, "a file of regions") if path.exists() else ""

    def save(self, path: Path, shapes: tuple[Shape, ...]) -> str:
        """Write the drawing atomically and return the file's fingerprint; raises InputError if it cannot be written."""
        save_regions(path, shapes, self.size, force=True)
        return self.fingerprint(path)


@dataclass(frozen=True)
class Start:
    """Initial state of a workspace.

    Parameters
    ----------
    history : History
        The drawing.
    saved : tuple of Shape
        Content of the output file; empty if there is none.
    read : tuple of Shape
        Content of another file read at the start; it counts as saved there until changed.
    proposals : tuple of Shape
        Proposals to be confirmed.
    stored : str
        Fingerprint of the output when it was read; empty if there was none.
    kept : tuple of Shape
        Shapes that an earlier run did not save, with which the drawing resumes.
    """

    history: History
    saved: tuple[Shape, ...] = ()
    read: tuple[Shape, ...] = ()
    proposals: tuple[Shape, ...] = ()
    stored: str = ""
    kept: tuple[Shape, ...] = ()

    @classmethod
    def of(cls, files: DrawingFiles, read: tuple[Shape, ...] = (), proposals: tuple[Shape, ...] = ()) -> Start:
        """Return the drawing of `read`, else of the output, changed to what an earlier run did not save.

        Raises
        ------
        InputError
            If a file is not of this image.
        """
        # Taken before reading, so that later changes are noticed.
        stored = files.fingerprint(files.output)
        saved = load_regions(files.output, files.size) if stored else ()
        kept = files.kept()
        history = History(Drawing.of(files.size, read or saved))
        if kept:
            history = history.changed(Drawing.of(files.size, kept))
        return cls(history, saved, read, proposals, stored, kept)


#: Upper limit of the size of a lock file's content.
_MOST_BYTES = 400

#: First line of a lock file.
_OURS = b"process "


@contextmanager
def locked(output: Path) -> Iterator[Callable[[str], None]]:
    """Lock a region file for this process by a hidden file in the same folder, which is removed at the end.

    Parameters
    ----------
    output : Path
        Region file; it need not exist.

    Yields
    ------
    callable
        Publishes the address of this process's page to other processes.

    Raises
    ------
    InputError
        If another process holds the lock, or it cannot be created.

    Notes
    -----
    The kernel releases the lock when the process ends, so a file left by a killed process locks nothing. Where
    there are no locks, as on some network file systems, nothing is locked.
    """
    path = output.with_name(f".{output.name}.lock")
    descriptor = _taken(path, output)
    try:
        _tell(descriptor, f"process {os.getpid()}")
        yield lambda where: _tell(descriptor, f"process {os.getpid()}, {where}")
    finally:
        # Remove it while locked: afterwards it may belong to another process.
        with suppress(OSError):
            path.unlink()
        os.close(descriptor)


def _taken(path: Path, output: Path) -> int:
    """Descriptor of the locked lock file."""
    while True:
        with ExitStack() as otherwise:
            try:
                descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
                otherwise.callback(os.close, descriptor)
                is_file = stat.S_ISREG(os.fstat(descriptor).st_mode)
                lock(descriptor)
                if not is_file or os.pread(descriptor, len(_OURS), 0) not in (b"", _OURS):
                    raise FileExistsError(errno.EEXIST, "it is not a lock file of labcdp")
                # Else it was removed by its previous holder in the meantime.
                if _is_still(path, descriptor):
                    otherwise.pop_all()
                    return descriptor
            except BlockingIOError as error:
                holder = printable(os.pread(descriptor, _MOST_BYTES, 0).decode(errors="replace")) or "another process"
                raise InputError(
                    f"{output} is in use by another labcdp ({holder}): end that one first, or give another region file"
                ) from error
            except OSError as error:
                raise InputError(
                    f"{output} cannot be locked ({path.name}: {error.strerror}): give one in another folder"
                ) from error


def _is_still(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _tell(descriptor: int, text: str) -> None:
    with suppress(OSError):  # disk full: the lock holds without content
        os.pwrite(descriptor, text.encode(), 0)
        os.ftruncate(descriptor, len(text.encode()))
