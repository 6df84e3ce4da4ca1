"""What a session holds, in the order it was recorded: frames, readings and events."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal, get_args

from ..frame import CameraIdentity
from ..reading import Reading
from .files import StoredFile
from .journal_text import Entry

Role = Literal["light", "dark"]
ROLES: tuple[Role, ...] = get_args(Role)

#: Kind of the event that takes frames and readings out of what counts.
SUPERSEDED = "superseded"
#: Kind of the event that says which exposures were found where the plan has none.
EXPOSURES = "exposures"


@dataclass(frozen=True)
class FrameRecord:
    """A recorded frame without its pixels, which `Session.load` reads.

    Parameters
    ----------
    sequence : int
        Line of the journal.
    time : datetime
        When it was recorded.
    number : int
        Number of the frame in the session.
    role : {'light', 'dark'}
        Whether the target was seen, or the sensor was kept dark.
    shape : (int, int)
        Height and width in pixels.
    metadata : dict
        The frame's ``metadata()``.
    file : StoredFile
        Where the pixels are.
    patch : str or None
        The patch that was before the camera, where patches are shown one by one; None for all of the target.
    """

    sequence: int
    time: datetime
    number: int
    role: Role
    shape: tuple[int, int]
    metadata: dict[str, Any]
    file: StoredFile
    patch: str | None = None

    @property
    def exposure_s(self) -> float:
        """Exposure time in seconds, as applied."""
        return float(self.metadata["exposure_s"])

    @property
    def gain_db(self) -> float:
        """Analogue gain in decibels."""
        return float(self.metadata["gain_db"])

    @property
    def pixel_format(self) -> str:
        """GenICam name of the pixel format."""
        return str(self.metadata["pixel_format"])

    @property
    def camera(self) -> CameraIdentity:
        """Who took it."""
        return CameraIdentity(**self.metadata["camera"])


@dataclass(frozen=True)
class ReadingRecord:
    """A recorded reading of the luminance meter.

    Parameters
    ----------
    sequence : int
        Line of the journal.
    time : datetime
        When it was recorded.
    patch : str
        The patch of the target the meter looked at.
    reading : Reading
        The reading.
    """

    sequence: int
    time: datetime
    patch: str
    reading: Reading


@dataclass(frozen=True)
class EventRecord:
    """Anything else worth keeping: how the session was set up, a warning, a step done.

    Parameters
    ----------
    sequence : int
        Line of the journal.
    time : datetime
        When it was recorded.
    kind : str
        What happened.
    content : dict
        More about it.
    file : StoredFile or None
        The file it belongs to.
    """

    sequence: int
    time: datetime
    kind: str
    content: dict[str, Any]
    file: StoredFile | None = None


Record = FrameRecord | ReadingRecord | EventRecord


def frame_content(
    number: int, role: Role, shape: tuple[int, int], metadata: dict[str, Any], patch: str | None
) -> dict[str, Any]:
    """Content of a frame's line in the journal."""
    height, width = shape
    content = {"number": number, "role": role, "width": width, "height": height, "frame": metadata}
    return content if patch is None else content | {"patch": patch}


def superseded(records: Iterable[Record]) -> frozenset[int]:
    """Journal lines of the frames and readings that were taken again and no longer count."""
    lines: set[int] = set()
    for one in records:
        if isinstance(one, EventRecord) and one.kind == SUPERSEDED:
            lines.update(one.content["lines"])
    return frozenset(lines)


def reading_content(patch: str, reading: Reading) -> dict[str, Any]:
    """Content of a reading's line in the journal."""
    return {"patch": patch, "reading": reading.to_dict()}


def record(entry: Entry) -> Record:
    """Make the record of a line of the journal."""
    makers: dict[str, Callable[[Entry], Record]] = {"frame": frame_record, "reading": reading_record}
    return makers.get(entry.kind, event_record)(entry)


def frame_record(entry: Entry) -> FrameRecord:
    """Make the record of a frame's line."""
    content = entry.content
    assert entry.file is not None
    return FrameRecord(
        sequence=entry.sequence,
        time=entry.time,
        number=content["number"],
        role=content["role"],
        shape=(content["height"], content["width"]),
        metadata=content["frame"],
        file=entry.file,
        patch=content.get("patch"),
    )


def reading_record(entry: Entry) -> ReadingRecord:
    """Make the record of a reading's line."""
    reading = Reading.from_dict(entry.content["reading"])
    return ReadingRecord(entry.sequence, entry.time, entry.content["patch"], reading)


def event_record(entry: Entry) -> EventRecord:
    """Make the record of any other line."""
    return EventRecord(entry.sequence, entry.time, entry.kind, entry.content, entry.file)
