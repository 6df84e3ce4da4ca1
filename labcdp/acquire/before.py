"""Checks before the start, and a start that is refused leaves nothing behind."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import LabcdpError, SessionError
from ..core.pixel_format import pixel_format
from ..drivers.camera import Camera, CameraNotFoundError, CameraSettingError
from ..drivers.camera_settings import CameraSetup, Region, Trigger
from ..drivers.meter import Meter
from ..session import CameraConfiguration, EventRecord, Session, SessionConfiguration
from ..session.records import SIMULATED_BENCH
from .steps import remaining

#: Records with which every session begins.
_OF_A_NEW_SESSION = ("session", "readme", SIMULATED_BENCH)


@contextmanager
def no_bare_session(path: Path) -> Iterator[None]:
    """Remove a session that failed before its first record, unless it was there before.

    Parameters
    ----------
    path : Path
        Folder of the session, which the block creates or resumes, and closes.
    """
    new = not holds_something(path)
    try:
        yield
    except LabcdpError:
        if new and holds_something(path):
            session = Session.open(path)
            if all(isinstance(one, EventRecord) and one.kind in _OF_A_NEW_SESSION for one in session.records):
                session.remove()
        raise


def holds_something(path: Path) -> bool:
    """Whether there is anything at a path but an empty folder."""
    return path.exists() and not (path.is_dir() and not any(path.iterdir()))


#: Most bytes of a frame beyond its pixels: header, description, and its line in the journal.
_FILE_BYTES = 8192
#: Relative tolerance of a camera's exposure limits, against rounding of units.
_RANGE_REL = 1e-9


def check_devices(camera: Camera, meter: Meter, configuration: SessionConfiguration) -> None:
    """Refuse devices that differ from the configuration.

    Raises
    ------
    CameraNotFoundError
        If vendor, model or serial number of the camera differ.
    SessionError
        If the meter is of another model.
    """
    wanted = configuration.camera
    for name in ("vendor", "model", "serial"):
        expected, found = getattr(wanted, name), getattr(camera.identity, name)
        if expected is not None and expected != found:
            raise CameraNotFoundError(
                f"the camera's {name} is {found!r}, the configuration says {expected!r}: connect that camera or "
                f"correct camera.{name}"
            )
    if meter.identity.model != configuration.meter.model:
        raise SessionError(
            f"the meter is a {meter.identity.model}, the configuration says {configuration.meter.model}: connect "
            "that meter or correct meter.model"
        )


def check_plan(camera: Camera, configuration: SessionConfiguration) -> None:
    """Refuse settings and regions impossible for the camera as it is prepared.

    Raises
    ------
    CameraSettingError
        If the pixel format is unknown, or an exposure is outside the camera's range.
    InputError
        If a region of the target lies outside the camera's image or contains no pixel.
    """
    settings = camera.settings
    for patch in configuration.target.patches:
        patch.region().mask((settings.height, settings.width))
    pixel_format(configuration.plan.pixel_format)
    shortest_s, longest_s = camera.exposure_range_s
    for exposure_s in configuration.plan.exposures_s or ():
        if not shortest_s * (1 - _RANGE_REL) <= exposure_s <= longest_s * (1 + _RANGE_REL):
            raise CameraSettingError(
                f"plan.exposures_s has {exposure_s:g} s, the camera takes {shortest_s:g} to {longest_s:g} s: give an "
                "exposure within"
            )


def prepare_camera(camera: Camera, configured: CameraConfiguration) -> CameraSetup:
    """Apply the settings of the configuration's ``[camera]``, and return them; raises CameraSettingError."""
    region, trigger = configured.region, configured.trigger
    setup = CameraSetup(
        binning=configured.binning,
        region=None if region is None else Region(*region),
        frame_rate_hz=configured.frame_rate_hz,
        black_level=configured.black_level,
        trigger=None if trigger is None else Trigger(trigger),
        features=configured.features or {},
    )
    camera.prepare(setup)
    return setup


def check_room(camera: Camera, session: Session) -> None:
    """Refuse a plan whose remaining frames do not fit on the disk.

    Raises
    ------
    SessionError
        With required space, free space, and number of frames that fit.
    """
    settings = camera.settings
    bytes_per_pixel = 1 if pixel_format(session.configuration.plan.pixel_format).bit_depth <= 8 else 2
    frame_bytes = settings.width * settings.height * bytes_per_pixel + _FILE_BYTES
    n = remaining(session).frames
    free = shutil.disk_usage(session.path).free
    if n * frame_bytes > free:
        raise SessionError(
            f"the plan still needs {n} frames of {frame_bytes / 1e6:.3g} MB, {n * frame_bytes / 1e9:.4g} GB in all, "
            f"but {session.path} has room for {free // frame_bytes} ({free / 1e9:.3g} GB free): free the disk, or plan "
            "fewer frames"
        )
