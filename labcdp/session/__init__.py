"""Sessions: one measurement in a folder a person can read, safe against kills and checked when read."""

from .bench_tables import (
    CameraConfiguration,
    LensConfiguration,
    MeterConfiguration,
    SourceConfiguration,
)
from .configuration import (
    ContrastConfiguration,
    GuessConfiguration,
    Patch,
    PlanConfiguration,
    SessionConfiguration,
    TargetConfiguration,
)
from .examples import example_configuration, example_session
from .files import StoredFile
from .records import EventRecord, FrameRecord, ReadingRecord, Record, Role
from .store import Session

__all__ = [
    "CameraConfiguration",
    "ContrastConfiguration",
    "EventRecord",
    "FrameRecord",
    "GuessConfiguration",
    "LensConfiguration",
    "MeterConfiguration",
    "Patch",
    "PlanConfiguration",
    "ReadingRecord",
    "Record",
    "Role",
    "Session",
    "SessionConfiguration",
    "SourceConfiguration",
    "StoredFile",
    "TargetConfiguration",
    "example_configuration",
    "example_session",
]
