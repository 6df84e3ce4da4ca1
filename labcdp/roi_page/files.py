"""Where a drawing is saved, and where it is kept meanwhile."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from ..errors import InputError
from ..regions import REGION_SUFFIXES, Shape, load_regions, save_regions
from .shape_edit import ImageSize


@dataclass(frozen=True)
class DrawingFiles:
    """The file a drawing is saved to, and a second one beside it that holds what is not saved yet.

    Parameters
    ----------
    output : Path
        File of regions: .json, .roi or .zip.
    size : (int, int)
        Width and height of the image in pixels.
    """

    output: Path
    size: ImageSize

    def __post_init__(self) -> None:
        if self.output.suffix.lower() not in REGION_SUFFIXES:
            raise InputError(
                f"--output {self.output} has no known end: give a name that ends in {', '.join(REGION_SUFFIXES)}"
            )
        if not self.output.parent.is_dir():
            raise InputError(f"{self.output.parent} is no folder: give --output in a folder that is there")
        if self.output.is_dir():
            raise InputError(f"--output {self.output} is a folder: give the name of a file")

    @property
    def unsaved(self) -> Path:
        """File that holds the drawing while it differs from what was saved; a file of regions like any other."""
        return self.output.with_name(f"{self.output.name}.unsaved.json")

    def keep(self, shapes: tuple[Shape, ...]) -> None:
        """Write what is not saved yet; raises InputError if that is not possible."""
        if shapes:
            save_regions(self.unsaved, shapes, self.size)
        else:
            self.forget()

    def forget(self) -> None:
        """Remove the file of what was not saved: now it is, or nothing is left of it."""
        try:
            self.unsaved.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(
                f"{self.unsaved} cannot be removed ({error.strerror}): remove it, or it is taken for newer"
            ) from error

    def kept(self) -> tuple[Shape, ...]:
        """Shapes that an earlier run drew and did not save; none if there is no such file.

        Raises
        ------
        InputError
            If there is one that cannot be used with this image.
        """
        if not self.unsaved.exists():
            return ()
        try:
            return load_regions(self.unsaved, self.size)
        except InputError as error:
            raise InputError(
                f"{error}; it holds what was drawn and not saved: use the image it was drawn on, or move it away"
            ) from error

    def other(self, name: str) -> Path:
        """Return the file of a name given on the page, in the folder of the output.

        Raises
        ------
        InputError
            If it is no plain file name with a known suffix, or is there already and not the output.
        """
        name = name.strip()
        if not name or Path(name).name != name or name.startswith(".") or not name.isprintable():
            raise InputError(
                f"{name!r} is no plain file name: give one without folders; it goes into {self.output.parent}"
            )
        path = self.output.with_name(name)
        if path.suffix.lower() not in REGION_SUFFIXES:
            raise InputError(f"{name!r} has no known end: give a name that ends in {', '.join(REGION_SUFFIXES)}")
        return path

    def fingerprint(self, path: Path) -> str:
        """SHA-256 of a file, empty if there is none; raises InputError if it cannot be read."""
        try:
            return sha256(path.read_bytes()).hexdigest()
        except FileNotFoundError:
            return ""
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}): check the path") from error

    def save(self, path: Path, shapes: tuple[Shape, ...]) -> str:
        """Write the drawing to a file, whole, and return its fingerprint; raises InputError if it cannot be written."""
        save_regions(path, shapes, self.size)
        return self.fingerprint(path)
