"""Missing parts of a session's plan, in units that are checked and, if necessary, repeated as a whole."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from ..core.dn import pixel_format
from ..core.errors import InputError, SessionError
from ..core.reading import Reading
from ..core.result import Finding, warning
from ..drivers.camera import Camera, CameraNotFoundError, CameraSettingError
from ..drivers.camera_settings import CameraSetup, Region, Trigger
from ..drivers.meter import Meter
from ..session import CameraConfiguration, EventRecord, FrameRecord, ReadingRecord, Session, SessionConfiguration
from ..session.configuration import SAME_EXPOSURE_REL

#: Kind of the event that records the check of a unit.
CHECK = "check"


@dataclass(frozen=True)
class Unit:
    """A part of a plan that is taken, checked and, if necessary, repeated as a whole.

    Parameters
    ----------
    kind : {'light', 'patch', 'readings', 'dark'}
        All light frames of patches seen together; frames and readings of one patch shown alone; readings of one
        patch; all dark frames.
    patch : str or None
        Name of the patch, for units of one patch.
    """

    kind: Literal["light", "patch", "readings", "dark"]
    patch: str | None = None

    @property
    def name(self) -> str:
        """Name for the user."""
        if self.kind == "patch":
            return f"patch {self.patch}"
        return f"readings of {self.patch}" if self.kind == "readings" else f"{self.kind} frames"


@dataclass(frozen=True)
class Remaining:
    """Missing parts of a session's plan.

    Parameters
    ----------
    exposures_known : bool
        Whether exposures are planned or found; if not, no frames are counted.
    light : dict of (str or None, float) to int
        Missing light frames by patch shown alone (None for all together) and exposure in seconds; complete ones are
        left out.
    dark : dict of float to int
        Missing dark frames by exposure in seconds; complete ones are left out.
    readings : dict of str to int
        Missing readings by patch; complete ones are left out.
    """

    exposures_known: bool
    light: dict[tuple[str | None, float], int]
    dark: dict[float, int]
    readings: dict[str, int]

    @property
    def frames(self) -> int:
        """Number of missing frames."""
        return sum(self.light.values()) + sum(self.dark.values())

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return self.exposures_known and not (self.light or self.dark or self.readings)


def one_by_one(configuration: SessionConfiguration) -> bool:
    """Whether patches are shown one after another."""
    return configuration.target.presentation == "one by one"


def units(configuration: SessionConfiguration) -> list[Unit]:
    """List the units of a plan in the order they are taken."""
    names = [patch.name for patch in configuration.target.patches]
    if one_by_one(configuration):
        return [*(Unit("patch", name) for name in names), Unit("dark")]
    # Readings before and after the light frames belong to the unit of these frames.
    alone = names[1:] if configuration.plan.drift_check else names
    return [Unit("light"), *(Unit("readings", name) for name in alone), Unit("dark")]


def readings_wanted(configuration: SessionConfiguration) -> dict[str, int]:
    """Count the readings of each patch: twice as many where the meter is read before and after the frames."""
    n = configuration.plan.readings_per_patch
    names = [patch.name for patch in configuration.target.patches]
    twice = names if one_by_one(configuration) else names[:1] if configuration.plan.drift_check else []
    return {name: 2 * n if name in twice else n for name in names}


def shown_patches(configuration: SessionConfiguration) -> list[str | None]:
    """Patches shown one by one, or None for all together."""
    if one_by_one(configuration):
        return [patch.name for patch in configuration.target.patches]
    return [None]


def remaining(session: Session) -> Remaining:
    """Compare the recorded data with the plan.

    Examples
    --------
    >>> from labcdp.acquire import remaining
    >>> from labcdp.session import Session, example_session
    >>> remaining(Session.open(example_session())).complete
    True
    """
    configuration = session.configuration
    plan, exposures_s = configuration.plan, session.exposures_s
    read = Counter(record.patch for record in session.readings())
    lacking = {name: n - read[name] for name, n in readings_wanted(configuration).items()}
    light, dark = session.frames("light"), session.frames("dark")
    return Remaining(
        exposures_known=exposures_s is not None,
        light={
            (patch, exposure_s): n
            for patch in shown_patches(configuration)
            for exposure_s in exposures_s or ()
            if (n := plan.frames_per_exposure - len(frames_at(light, exposure_s, patch))) > 0
        },
        dark={
            exposure_s: n
            for exposure_s in exposures_s or ()
            if (n := plan.dark_frames_per_exposure - len(frames_at(dark, exposure_s, None))) > 0
        },
        readings={name: n for name, n in lacking.items() if n > 0},
    )


def frames_at(records: Sequence[FrameRecord], exposure_s: float, patch: str | None) -> list[FrameRecord]:
    """Frames of an exposure, within a camera's rounding, and of the shown patch."""
    return [r for r in records if r.patch == patch and same_exposure(r.exposure_s, exposure_s)]


def same_exposure(one_s: float, other_s: float) -> bool:
    """Whether two exposures are the same camera setting."""
    return abs(one_s / other_s - 1) <= SAME_EXPOSURE_REL


def records_of(session: Session, unit: Unit) -> list[FrameRecord | ReadingRecord]:
    """List the valid frames and readings of a unit."""
    first = session.configuration.target.patches[0].name
    frames: list[FrameRecord] = []
    patches: list[str | None] = [unit.patch]
    if unit.kind in ("light", "patch"):
        frames = [r for r in session.frames("light") if r.patch == unit.patch]
    elif unit.kind == "dark":
        frames = session.frames("dark")
    if unit.kind == "light":
        # Readings before and after are compared by the check of the light.
        patches = [first] if session.configuration.plan.drift_check else []
    readings = [r for r in session.readings() if r.patch in patches]
    return [*frames, *readings]


def forget(session: Session, names: Sequence[str]) -> None:
    """Let parts of a session no longer count, so that they are taken again.

    Parameters
    ----------
    session : Session
        Open for writing.
    names : sequence of str
        Patches, ``light frames`` or ``dark frames``. A patch that is shown together with others means its readings, and
        the light frames too where the meter is read before and after them.

    Raises
    ------
    InputError
        If there is no such part; then nothing is changed.

    Examples
    --------
    >>> import shutil
    >>> from labcdp.acquire import forget, remaining
    >>> from labcdp.session import Session, example_session
    >>> copy = shutil.copytree(example_session(), "copy")
    >>> with Session.open(copy, writable=True) as session:
    ...     forget(session, ["dark frames"])
    ...     remaining(session).complete
    False
    """
    planned = units(session.configuration)
    parts = {unit.patch or unit.name: unit for unit in planned}
    parts = {session.configuration.target.patches[0].name: planned[0]} | parts
    for name in names:
        if name not in parts:
            raise InputError(f"there is no {name!r} to take again: give one of {', '.join(parts)}")
    for name in names:
        if records := records_of(session, parts[name]):
            session.supersede(records, "retaken on request")


def before_and_after(session: Session, patch: str) -> tuple[list[Reading], list[Reading]]:
    """Split the readings of a patch into those before its frames and those after."""
    n = session.configuration.plan.readings_per_patch
    readings = [r.reading for r in session.readings() if r.patch == patch]
    return readings[:n], readings[n:]


def was_checked(session: Session, unit: Unit) -> bool:
    """Whether a unit was checked since its last record."""
    checks = [r for r in session.records if isinstance(r, EventRecord) and r.kind == CHECK]
    last_check = max((r.sequence for r in checks if r.content["unit"] == unit.name), default=0)
    return last_check > max((r.sequence for r in records_of(session, unit)), default=0)


def repeated_units(session: Session) -> list[str]:
    """Names of the units that were repeated after a check.

    Examples
    --------
    >>> from labcdp.acquire import repeated_units
    >>> from labcdp.session import Session, example_session
    >>> repeated_units(Session.open(example_session()))
    []
    """
    checks = [r for r in session.records if isinstance(r, EventRecord) and r.kind == CHECK]
    return [r.content["unit"] for r in checks if r.content["repeat"]]


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
        expected, actual = getattr(wanted, name), getattr(camera.identity, name)
        if expected is not None and expected != actual:
            of, do = "camera", "connect that camera"
            if camera.identity.simulated:
                of, do = "simulated camera", "describe that one for --simulated-bench (labcdp init simulated-bench)"
            raise CameraNotFoundError(
                f"the {of}'s {name} is {actual!r}, the configuration says {expected!r}: {do} or correct camera.{name}"
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
        packet_resend=configured.packet_resend,
    )
    camera.prepare(setup)
    return setup


#: Ratio of a target contrast to that of the patches' nominal luminances from which it is probably mistyped.
_DOUBTFUL_RATIO = 10.0


def contrast_findings(configuration: SessionConfiguration) -> tuple[Finding, ...]:
    """Find target contrasts far above those that the nominal luminances of their patches have."""
    nominal = {patch.name: patch.nominal_luminance_cd_m2 for patch in configuration.target.patches}
    findings = []
    for pair in configuration.contrasts:
        bright, dark = nominal[pair.bright], nominal[pair.dark]
        if bright is None or dark is None:
            continue
        expected = max(bright, dark) / min(bright, dark) - 1
        if pair.contrast >= _DOUBTFUL_RATIO * expected:
            names = f"{pair.bright} / {pair.dark}"
            findings.append(warning("target-contrast-doubtful", names, contrast=pair.contrast, nominal=expected))
    return tuple(findings)


def certificate_findings(configuration: SessionConfiguration, now: datetime) -> tuple[Finding, ...]:
    """Find a certificate of the meter that says nothing about readings at a time: calibrate would refuse them."""
    certificate = configuration.meter.certificate
    if certificate is None or certificate.holds_at(now):
        return ()
    named = {"number": certificate.number, "date": f"{certificate.date}", "today": f"{now:%Y-%m-%d}"}
    return (warning("certificate-later", configuration.meter.model, **named),)


def check_room(camera: Camera, session: Session) -> None:
    """Refuse a plan whose remaining frames do not fit on the disk.

    Raises
    ------
    SessionError
        With required space, free space, and number of frames that fit.
    """
    settings = camera.settings
    bits = pixel_format(session.configuration.plan.pixel_format).bit_depth
    bytes_per_pixel = 1 if bits <= 8 else 2 if bits <= 16 else 4
    frame_bytes = settings.width * settings.height * bytes_per_pixel + _FILE_BYTES
    n = remaining(session).frames
    free = shutil.disk_usage(session.path).free
    if n * frame_bytes > free:
        raise SessionError(
            f"the plan still needs {n} frames of {frame_bytes / 1e6:.3g} MB, {n * frame_bytes / 1e9:.4g} GB in all, "
            f"but {session.path} has room for {free // frame_bytes} ({free / 1e9:.3g} GB free): free the disk, or plan "
            "fewer frames"
        )
