"""Records of a session in their order: frames, readings and events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from itertools import pairwise
from math import isclose
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PlainValidator

from ..core.companding import Companding
from ..core.disk import shortened, validated_as
from ..core.errors import InputError, SessionError
from ..core.frame import CameraIdentity, Frame, checked_metadata
from ..core.reading import Reading
from ..output.file import StoredFile
from .journal import Entry

Role = Literal["light", "dark"]
_Made = TypeVar("_Made")
ROLES: tuple[Role, ...] = get_args(Role)

#: Kind of the event that takes frames and readings out of what counts.
SUPERSEDED = "superseded"
#: Kind of the event that says which exposures were found where the plan has none.
EXPOSURES = "exposures"
#: Kinds of the events after which some exposures of the camera are missing.
REFUSED, CAMERA_LOST, CAMERA_RETURNED = "refused frame", "camera lost", "camera lost and back"
LOSSES = (REFUSED, CAMERA_LOST, CAMERA_RETURNED)
#: Kind of the event that says which simulated bench it is.
SIMULATED_BENCH = "simulated bench"
#: By how much the clocks of camera and computer may differ over the frames.
_CLOCKS_REL, _CLOCKS_S = 0.05, 0.25


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
    height, width : int
        Size in pixels.
    metadata : dict
        The frame's ``metadata()``.
    file : StoredFile
        Where the pixels are.
    patch : str or None
        The patch that was before the camera, where patches are shown one by one; None for all of the target.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> record = Session.open(example_session()).frames("dark")[0]
    >>> record.role
    'dark'
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    sequence: int
    time: datetime
    number: Annotated[int, Field(ge=1)]
    role: Role
    height: Annotated[int, Field(ge=1)]
    width: Annotated[int, Field(ge=1)]
    metadata: Annotated[dict[str, Any], Field(alias="frame"), AfterValidator(checked_metadata)]
    file: StoredFile
    patch: str | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.height, self.width

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
        """Camera."""
        return CameraIdentity(**self.metadata["camera"])

    def without_pixels(self, curve: Companding | None = None) -> Frame:
        """Return the frame with its settings and all pixels 0.

        Parameters
        ----------
        curve : Companding or None
            The curve that its session states, None for none.

        Raises
        ------
        SessionError
            If the settings cannot be of a frame.
        """
        pixel = np.zeros((), np.uint16)
        pixel.flags.writeable = False
        try:
            return Frame.from_metadata(np.broadcast_to(pixel, self.shape), self.metadata, curve)
        except InputError as error:
            raise SessionError(f"the session's journal does not describe frame {self.number} ({error})") from error


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

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> record = Session.open(example_session()).readings()[0]
    >>> record.patch
    'P01'
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    sequence: int
    time: datetime
    patch: str
    reading: Annotated[Reading, PlainValidator(Reading.from_dict)]


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
        Kind of the event.
    content : dict
        More about it.
    file : StoredFile or None
        The file it belongs to.

    Examples
    --------
    >>> from labcdp.session import EventRecord, Session, example_session
    >>> events = [r for r in Session.open(example_session()).records if isinstance(r, EventRecord)]
    >>> events[-1].kind
    'complete'
    """

    sequence: int
    time: datetime
    kind: str
    content: dict[str, Any]
    file: StoredFile | None = None


Record = FrameRecord | ReadingRecord | EventRecord


def frame_times_s(records: Sequence[FrameRecord]) -> list[float]:
    """Return the times of frames in seconds after the first one.

    They are those of the camera's clock if it runs on through all of them, and as fast as the computer's; else when the
    frames were recorded, which is later by how long they took to arrive.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> from labcdp.session.records import frame_times_s
    >>> [round(time_s, 3) for time_s in frame_times_s(Session.open(example_session()).frames("light"))]
    [0.0, 0.259, 0.426, 0.559, 0.692, 0.826]
    """
    recorded_s = [(record.time - records[0].time).total_seconds() for record in records]
    stamps_ns = [int(record.metadata["camera_timestamp_ns"]) for record in records]
    if stamps_ns and stamps_ns[0] > 0 and all(first < second for first, second in pairwise(stamps_ns)):
        by_camera_s = [1e-9 * (stamp_ns - stamps_ns[0]) for stamp_ns in stamps_ns]
        first, last = (datetime.fromisoformat(str(records[at].metadata["timestamp"])) for at in (0, -1))
        if isclose(by_camera_s[-1], (last - first).total_seconds(), rel_tol=_CLOCKS_REL, abs_tol=_CLOCKS_S):
            return by_camera_s
    return recorded_s


def counting(records: Sequence[Record]) -> list[Record]:
    """Return the records without the frames and readings that were taken again."""
    events = [event for event in records if isinstance(event, EventRecord) and event.kind == SUPERSEDED]
    left_out = {line for event in events for line in event.content["lines"]}
    return [record for record in records if record.sequence not in left_out]


def record(entry: Entry) -> Record:
    """Make the record of a line of the journal."""
    match entry.kind:
        case "frame":
            return frame_record(entry)
        case "reading":
            return reading_record(entry)
    return event_record(entry)


def frame_record(entry: Entry) -> FrameRecord:
    """Make the record of a frame's line."""
    made = _checked(FrameRecord, entry, file=None if entry.file is None else asdict(entry.file), **_line_fields(entry))
    # The parts of the line itself, as a copy of each would take half as much memory again.
    return replace(made, time=entry.time, metadata=entry.content["frame"], file=entry.file or made.file)


def reading_record(entry: Entry) -> ReadingRecord:
    """Make the record of a reading's line."""
    return _checked(ReadingRecord, entry, **_line_fields(entry))


def event_record(entry: Entry) -> EventRecord:
    """Make the record of any other line."""
    if entry.kind in _EVENT_CONTENTS:
        _checked(_EVENT_CONTENTS[entry.kind], entry)
    return EventRecord(entry.sequence, entry.time, entry.kind, entry.content, entry.file)


def _line_fields(entry: Entry) -> dict[str, Any]:
    return {"sequence": entry.sequence, "time": entry.time.isoformat()}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _SupersededContent(_Strict):
    lines: list[int]
    reason: str
    # Their files are known to be missing or altered.
    damaged: bool = False


class _ExposuresContent(BaseModel):
    # Findings of the search are stored with them.
    exposures_s: list[Annotated[float, Field(gt=0)]] = Field(min_length=1)


class _SessionContent(_Strict):
    format: int
    compress: bool
    versions: dict[str, str]


_EVENT_CONTENTS: dict[str, type[BaseModel]] = {
    "session": _SessionContent,
    SUPERSEDED: _SupersededContent,
    EXPOSURES: _ExposuresContent,
}


def _checked(kind: type[_Made], entry: Entry, **where: Any) -> _Made:
    try:
        if where.keys() & entry.content.keys():
            raise InputError(f"its content has one of {', '.join(where)}")
        return validated_as(kind, entry.content | where)
    except InputError as error:
        raise SessionError(
            f"line {entry.sequence} of the journal is not a record of a {shortened(entry.kind)} ({error}): use the "
            "labcdp "
            "that wrote it, or restore the journal from a copy of the session"
        ) from error
