"""Sessions: one measurement in a folder the user can read, safe against kills and checked when read."""

from .bench_tables import CameraConfiguration, LensConfiguration, SourceConfiguration
from .configuration import (
    ConditionsConfiguration,
    ContrastConfiguration,
    GuessConfiguration,
    Patch,
    PlanConfiguration,
    SessionConfiguration,
    TargetConfiguration,
)
from .examples import example_configuration, example_session
from .files import StoredFile
from .meter_tables import MeterCertificate, MeterConfiguration
from .records import EventRecord, FrameRecord, ReadingRecord, Record, Role
from .store import Session

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
