"""What is recorded of a finished video, so that it is not evaluated again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from ...core.disk import open_regular, read_json, validated_as
from ...core.disk.text import results_json
from ...core.errors import InputError
from ...output import ResultsFolder
from ...output.file import is_temporary
from ...output.file_list import read_list

#: Name of the record in the folder of a video's results.
RECORD = "finished.json"


class _Record(BaseModel):
    """Content of a record: hashes of video and settings, and the results."""

    model_config = ConfigDict(extra="forbid")
    video: str
    settings: str
    values: dict[str, Any]


class NotSeenError(InputError):
    """A computer does not see the video that another one sees under the same path."""


@dataclass(frozen=True)
class ArchiveTask:
    """A video of an archive.

    Parameters
    ----------
    video : Path
        File, or folder of images or of a session.
    folder : Path
        For its results; no other video's.
    part : str
        Which part of the evaluation, such as a pair of regions; empty for the only one.
    seen : tuple of (str, int, int)
        Name, size and time of change (in ns) of the video, or of each file in its folder; none if it is not there.
    """

    video: Path
    folder: Path
    part: str = ""
    seen: tuple[tuple[str, int, int], ...] = ()

    @classmethod
    def of(cls, video: Path, folder: Path, part: str = "") -> ArchiveTask:
        """Look at a video; one that cannot be looked at will fail when it is evaluated."""
        try:
            return cls(video, folder, part, tuple(_files(video)))
        except OSError:
            return cls(video, folder, part)

    def require_visible(self) -> None:
        """Make sure that this computer sees the video that was seen where the archive was begun.

        Raises
        ------
        NotSeenError
            If it is missing, cannot be read, or is of another size.
        """
        if not self.seen:
            return
        remedy = "put the videos where all workers see them under the same path"
        try:
            here = tuple(_files(self.video))
            first = self.video if self.video.is_file() else self.video / here[0][0]
            with open_regular(first) as file:
                file.read(1)
        except (OSError, IndexError) as error:
            reason = error.strerror if isinstance(error, OSError) else "empty folder"
            raise NotSeenError(f"{self.video} cannot be read ({reason}): {remedy}") from error
        if [entry[:2] for entry in here] != [entry[:2] for entry in self.seen]:
            raise NotSeenError(f"{self.video} differs between the worker and this computer: {remedy}")


def finished_values(task: ArchiveTask, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what is recorded of a video, or None if it is to be evaluated.

    It is to be evaluated if there is no record, or one of another video, of other settings or another version of
    labcdp, or if a file of the results is missing or of another size.
    """
    try:
        record = validated_as(_Record, read_json(task.folder / RECORD, "a record of a finished video"))
        same = record.video == _seen(task) and record.settings == _hash(settings)
        listed = read_list(task.folder)
        files = () if listed is None else listed.files
        whole = bool(files) and all((task.folder / one.name).stat().st_size == one.size for one in files)
    except (OSError, ValueError):
        return None
    return record.values if same and whole and task.seen else None


def record_finished(
    task: ArchiveTask, settings: Mapping[str, Any], values: Mapping[str, Any], results: ResultsFolder
) -> None:
    """Add the record of a finished video to its results; raises InputError if it cannot be written."""
    record = {"video": _seen(task), "settings": _hash(settings), "values": dict(values)}
    results.add({RECORD: results_json(record).encode()})


def _files(path: Path) -> Iterator[tuple[str, int, int]]:
    """Names, sizes and times of change of a file, or of all files in a folder, in order."""
    paths = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
    for one in paths:
        if not is_temporary(one):
            state = one.stat()
            name = one.relative_to(path).as_posix() if one != path else one.name
            yield name, state.st_size, state.st_mtime_ns


def _seen(task: ArchiveTask) -> str:
    part = [task.part] if task.part else []
    return hashlib.sha256(results_json([str(task.video), *part, *task.seen]).encode()).hexdigest()


def _hash(settings: Mapping[str, Any]) -> str:
    text = results_json({"settings": settings, "labcdp": version("labcdp")})
    return hashlib.sha256(text.encode()).hexdigest()
