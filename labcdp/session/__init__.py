"""Sessions: one measurement in a folder the user can read, safe against kills and checked when read."""

from .configuration import (
    ConditionsConfiguration,
    ContrastConfiguration,
    PatchConfiguration,
    PlanConfiguration,
    SessionConfiguration,
    TargetConfiguration,
    example_configuration,
    example_session,
)
from .records import EventRecord, FrameRecord, ReadingRecord, Role
from .store import Session
from .tables import CameraConfiguration, LensConfiguration, MeterCertificate, MeterConfiguration, SourceConfiguration

__all__ = [
    "CameraConfiguration",
    "ConditionsConfiguration",
    "ContrastConfiguration",
    "EventRecord",
    "FrameRecord",
    "LensConfiguration",
    "MeterCertificate",
    "MeterConfiguration",
    "PatchConfiguration",
    "PlanConfiguration",
    "ReadingRecord",
    "Role",
    "Session",
    "SessionConfiguration",
    "SourceConfiguration",
    "TargetConfiguration",
    "example_configuration",
    "example_session",
]
