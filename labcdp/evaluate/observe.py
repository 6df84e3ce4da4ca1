"""From a recorded session to what its frames and readings say, and to a calibration."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..calibration import (
    Calibration,
    DarkObservation,
    LensIdentity,
    PatchObservation,
    Setup,
    fit,
    observe_dark,
    observe_patches,
)
from ..errors import CalibrationError, InputError
from ..frame import Frame
from ..luminance import Cos4Vignetting
from ..reading import Reading
from ..session import FrameRecord, Role, Session, SessionConfiguration


@dataclass(frozen=True)
class ObservedSession:
    """What the frames and readings of a session say about its patches.

    Parameters
    ----------
    configuration : SessionConfiguration
        Bench, target and plan.
    patches : dict of str to list of PatchObservation
        By name of the patch, in the target's order; one observation an exposure.
    darks : list of DarkObservation
        One an exposure.
    readings : dict of str to list of Reading
        By name of the patch.
    vignetting : Cos4Vignetting
        Fall-off that was taken off.
    input_sha256 : str
        Hash over the hashes of all frames and the readings, in the order of recording.
    """

    configuration: SessionConfiguration
    patches: Mapping[str, Sequence[PatchObservation]]
    darks: Sequence[DarkObservation]
    readings: Mapping[str, Sequence[Reading]]
    vignetting: Cos4Vignetting
    input_sha256: str


def vignetting_of(configuration: SessionConfiguration) -> Cos4Vignetting:
    """Natural fall-off of the configured lens; without a flat field nothing better is known."""
    return Cos4Vignetting(configuration.lens.focal_length_m, configuration.camera.pixel_pitch_m)


def lens_of(configuration: SessionConfiguration) -> LensIdentity:
    """Return the configured lens as a calibration keeps it."""
    lens = configuration.lens
    return LensIdentity(lens.model, lens.serial, lens.focal_length_m, lens.f_number)


def observe_session(
    session: Session,
    without: Sequence[str] = (),
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> ObservedSession:
    """Measure the patches in all frames of a session; one frame at a time is held.

    Parameters
    ----------
    session : Session
        To read.
    without : sequence of str
        Patches to leave out.
    report : callable
        Called with the number of frames read, and of all frames.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If there are no dark frames, or too few frames at an exposure.
    InputError
        If a region lies outside the image, or `without` names an unknown patch.
    """
    configuration = session.configuration
    names = [patch.name for patch in configuration.target.patches]
    unknown = sorted(set(without) - set(names))
    if unknown:
        raise InputError(f"there is no patch {unknown[0]!r} to leave out: choose from {', '.join(names)}")
    regions = [patch.region() for patch in configuration.target.patches if patch.name not in without]
    vignetting = vignetting_of(configuration)
    total = len(session.frames())
    done = 0

    def frames(records: Sequence[FrameRecord]) -> Iterator[Frame]:
        nonlocal done
        for record in records:
            yield session.load(record)
            done += 1
            report(done, total)

    darks = [observe_dark(frames(group)) for group in by_exposure(session, "dark").values()]
    if not darks:
        raise CalibrationError("the session has no dark frames: cover the lens and go on with the acquisition")
    patches: dict[str, list[PatchObservation]] = {region.name: [] for region in regions}
    for group in by_exposure(session, "light").values():
        for shown, records in by_patch(group).items():
            seen = [region for region in regions if shown in (None, region.name)]
            for observation in observe_patches(frames(records), seen, vignetting) if seen else ():
                patches[observation.patch].append(observation)
    readings: dict[str, list[Reading]] = {}
    for record in session.readings():
        if record.patch not in without:
            readings.setdefault(record.patch, []).append(record.reading)
    return ObservedSession(configuration, patches, darks, readings, vignetting, _input_sha256(session))


def by_exposure(session: Session, role: Role) -> dict[float, list[FrameRecord]]:
    """Frames of a role by exposure in seconds, shortest first."""
    groups: dict[float, list[FrameRecord]] = {}
    for record in session.frames(role):
        groups.setdefault(record.exposure_s, []).append(record)
    return dict(sorted(groups.items()))


def by_patch(records: Sequence[FrameRecord]) -> dict[str | None, list[FrameRecord]]:
    """Frames by the patch that was before the camera; None stands for the whole target."""
    groups: dict[str | None, list[FrameRecord]] = {}
    for record in records:
        groups.setdefault(record.patch, []).append(record)
    return groups


def shows(record: FrameRecord, patch: str) -> bool:
    """Whether a patch can be seen in a frame."""
    return record.patch in (None, patch)


def calibrate_session(observed: ObservedSession) -> Calibration:
    """Calibrate a camera from what a session says.

    Raises
    ------
    CalibrationError
        As `labcdp.calibration.fit`, and if a patch of the target cannot be used at any exposure: it has to be
        left out by name, so that nobody relies on it.
    """
    setup = Setup(
        lens=lens_of(observed.configuration),
        source_spectrum=observed.configuration.source.spectrum,
        input_sha256=observed.input_sha256,
    )
    observations = [observation for group in observed.patches.values() for observation in group]
    calibration = fit(observations, observed.darks, observed.readings, setup)
    used = {row.patch for row in calibration.residuals}
    unused = [name for name in observed.patches if name not in used]
    if unused:
        reasons = "; ".join(w for w in calibration.warnings if f"patch {unused[0]!r}" in w)
        raise CalibrationError(
            f"patch {unused[0]!r} cannot be used at any exposure ({reasons}): acquire it with other exposures, or "
            f"leave it out with --without {unused[0]!r}"
        )
    return calibration


def _input_sha256(session: Session) -> str:
    digest = hashlib.sha256()
    for frame in session.frames():
        digest.update(frame.file.sha256.encode())
    for record in session.readings():
        digest.update(json.dumps([record.patch, record.reading.to_dict()], sort_keys=True).encode())
    return digest.hexdigest()
