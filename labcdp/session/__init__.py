"""Sessions: one measurement in a folder the user can read, safe against kills and checked when read."""

from ..output.file import StoredFile
from .configuration import (
    ConditionsConfiguration,
    ContrastConfiguration,
    GuessConfiguration,
    Patch,
    PlanConfiguration,
    SessionConfiguration,
    TargetConfiguration,
    example_configuration,
    example_session,
)
from .records import EventRecord, FrameRecord, ReadingRecord, Record, Role
from .store import Session
from .tables import CameraConfiguration, LensConfiguration, MeterCertificate, MeterConfiguration, SourceConfiguration

__all__ = [
    "CameraConfiguration",
    "ConditionsConfiguration",
    "ContrastConfiguration",
    "EventRecord",
    "FrameRecord",
    "GuessConfiguration",
    "LensConfiguration",
    "MeterCertificate",
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
