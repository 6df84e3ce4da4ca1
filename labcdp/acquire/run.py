"""Run the plan of a session: light frames, readings, dark frames; what is there already is not taken again."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass

from ..drivers.camera import Camera, CameraNotFoundError, IncompleteFrameError
from ..drivers.meter import Meter
from ..errors import SessionError
from ..session import Role, Session, SessionConfiguration
from ..session.configuration import SAME_EXPOSURE_REL
from .operator import Operator

_log = logging.getLogger(__name__)

#: A frame that arrives incomplete is taken again this often before giving up.
_ATTEMPTS = 3


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Parameters
    ----------
    step : str
        What is being taken, for a person.
    done, total : int
        Frames or readings of this kind, those recorded earlier included.
    """

    step: str
    done: int
    total: int


@dataclass(frozen=True)
class Remaining:
    """What a session still lacks of its plan.

    Parameters
    ----------
    light, dark : dict of float to int
        Frames by exposure in seconds; complete exposures are left out.
    readings : dict of str to int
        Readings by patch; complete patches are left out.
    """

    light: dict[float, int]
    dark: dict[float, int]
    readings: dict[str, int]

    @property
    def complete(self) -> bool:
        """Whether nothing is lacking."""
        return not (self.light or self.dark or self.readings)


def remaining(session: Session) -> Remaining:
    """Compare what is recorded with the plan."""
    plan = session.configuration.plan
    read = Counter(record.patch for record in session.readings())
    patches = [patch.name for patch in session.configuration.target.patches]
    lacking = {name: plan.readings_per_patch - read[name] for name in patches}
    return Remaining(
        light=_lacking_frames(session, "light", plan.frames_per_exposure),
        dark=_lacking_frames(session, "dark", plan.dark_frames_per_exposure),
        readings={name: n for name, n in lacking.items() if n > 0},
    )


def _lacking_frames(session: Session, role: Role, wanted: int) -> dict[float, int]:
    recorded = [float(record.metadata["exposure_s"]) for record in session.frames(role)]
    lacking = {}
    for exposure_s in session.configuration.plan.exposures_s:
        n = wanted - sum(abs(t / exposure_s - 1) <= SAME_EXPOSURE_REL for t in recorded)
        if n > 0:
            lacking[exposure_s] = n
    return lacking


def check_devices(camera: Camera, meter: Meter, configuration: SessionConfiguration) -> None:
    """Refuse devices the configuration does not name, and regions the camera does not see.

    Raises
    ------
    CameraNotFoundError
        If vendor, model or serial number of the camera differ.
    SessionError
        If the meter is another model.
    InputError
        If a region of the target lies outside the camera's image or holds no pixel.
    """
    wanted = configuration.camera
    for name in ("vendor", "model", "serial"):
        expected, found = getattr(wanted, name), getattr(camera.identity, name)
        if expected is not None and expected != found:
            raise CameraNotFoundError(
                f"the camera's {name} is {found!r}, the configuration says {expected!r}: connect that camera or "
                f"correct camera.{name}"
            )
    settings = camera.settings
    for patch in configuration.target.patches:
        patch.region().mask((settings.height, settings.width))
    if meter.identity.model != configuration.meter.model:
        raise SessionError(
            f"the meter is a {meter.identity.model}, the configuration says {configuration.meter.model}: connect "
            "that meter or correct meter.model"
        )


def acquire(
    session: Session,
    camera: Camera,
    meter: Meter,
    operator: Operator,
    report: Callable[[Progress], None] = lambda _progress: None,
) -> None:
    """Record what the session lacks of its plan.

    Every frame and reading is on the disk before the next is taken: whatever stops the run, calling this again
    takes only the rest.

    Parameters
    ----------
    session : Session
        Open for writing.
    camera, meter : Camera, Meter
        Open.
    operator : Operator
        Does what is done by hand.
    report : callable
        Called after each frame and reading.

    Raises
    ------
    DeviceError
        If a device fails; what was recorded before stays.
    SessionError
        If something cannot be recorded.
    """
    check_devices(camera, meter, session.configuration)
    rest = remaining(session)
    if rest.complete:
        return
    session.add_event("devices", {"camera": asdict(camera.identity), "meter": asdict(meter.identity)})
    if rest.light:
        operator.uncover_lens()
        _frames(session, camera, "light", rest.light, report)
    if rest.readings:
        _readings(session, meter, operator, rest.readings, report)
    if rest.dark:
        operator.cover_lens()
        _frames(session, camera, "dark", rest.dark, report)
        operator.uncover_lens()
    session.add_event("complete", {})


def _frames(
    session: Session, camera: Camera, role: Role, lacking: dict[float, int], report: Callable[[Progress], None]
) -> None:
    plan = session.configuration.plan
    each = plan.frames_per_exposure if role == "light" else plan.dark_frames_per_exposure
    total = each * len(plan.exposures_s)
    done = total - sum(lacking.values())
    report(Progress(f"{role} frames", done, total))
    for exposure_s, n in lacking.items():
        applied = camera.configure(exposure_s=exposure_s, gain_db=plan.gain_db, pixel_format=plan.pixel_format)
        if abs(applied.exposure_s / exposure_s - 1) > SAME_EXPOSURE_REL:
            raise SessionError(
                f"the camera applied {applied.exposure_s:g} s where the plan asks for {exposure_s:g} s: put an "
                "exposure it can keep into plan.exposures_s"
            )
        for _ in range(n):
            _one_frame(session, camera, role)
            done += 1
            report(Progress(f"{role} frames", done, total))


def _one_frame(session: Session, camera: Camera, role: Role) -> None:
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            frame = camera.snap()
        except IncompleteFrameError as error:
            session.add_event("refused frame", {"role": role, "reason": str(error)})
            if attempt == _ATTEMPTS:
                raise
            _log.warning("%s; taking it again", error)
        else:
            session.add_frame(frame, role)
            return


def _readings(
    session: Session,
    meter: Meter,
    operator: Operator,
    lacking: dict[str, int],
    report: Callable[[Progress], None],
) -> None:
    configuration = session.configuration
    total = configuration.plan.readings_per_patch * len(configuration.target.patches)
    done = total - sum(lacking.values())
    report(Progress("meter readings", done, total))
    for patch, n in lacking.items():
        operator.point_meter(patch)
        for _ in range(n):
            session.add_reading(meter.measure(), patch)
            done += 1
            report(Progress("meter readings", done, total))
