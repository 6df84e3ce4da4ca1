"""From a recorded session to what its frames and readings say."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from math import radians, tan

import numpy as np

from ...calibration import AnyCalibration, DarkObservation, PatchObservation, observe_dark, observe_patches
from ...calibration.convert.patch import is_within_response
from ...calibration.frames.measure import MIN_FRAMES, plane_region
from ...calibration.frames.statistics import MAX_CLIPPED_SHARE
from ...calibration.in_session import in_session, of_other_conditions
from ...calibration.sensor.response import MIN_EXPOSURES, ResponseCurve, response_from_bracket
from ...calibration.setup import MeterScale, corrected, meter_scale
from ...core.errors import CalibrationError, InputError
from ...core.frame import Frame
from ...core.reading import Reading
from ...core.result import Finding
from ...core.roi import Roi
from ...session import FrameRecord, MeterCertificate, ReadingRecord, Session, SessionConfiguration
from .corrections import (
    Corrections,
    PlaneCorrections,
    calibration_for,
    corrections_of,
    corrections_of_lens,
    with_dark_frames,
)
from .recorded import Report, SessionReader, by_exposure, by_patch, planes_of, require_patches


@dataclass(frozen=True)
class ObservedPlane:
    """What the frames of one plane say: all pixels of a monochrome sensor, or those of one colour.

    Parameters
    ----------
    patches : dict of str to list of PatchObservation
        By name of the patch, in the target's order; one observation an exposure.
    darks : list of DarkObservation
        One an exposure.
    corrections : Corrections
        What was subtracted.
    """

    patches: Mapping[str, Sequence[PatchObservation]]
    darks: Sequence[DarkObservation]
    corrections: Corrections


@dataclass(frozen=True)
class ObservedSession:
    """What the frames and readings of a session say about its patches.

    Parameters
    ----------
    session : Session
        To read frames from.
    configuration : SessionConfiguration
        Bench, target and plan.
    planes : dict of (str or None) to ObservedPlane
        By colour plane; one entry for None if the sensor is monochrome.
    readings : dict of str to list of Reading
        By name of the patch, with the correction of the meter's certificate.
    input_sha256 : str
        Hash over the hashes of all frames and the readings, in the order of recording.
    frames_sha256 : frozenset of str
        Hashes of the pixels of the frames.
    """

    session: Session
    configuration: SessionConfiguration
    planes: Mapping[str | None, ObservedPlane]
    readings: Mapping[str, Sequence[Reading]]
    input_sha256: str
    frames_sha256: frozenset[str]

    @property
    def names(self) -> tuple[str, ...]:
        """Patches that were measured, in the target's order."""
        return tuple(next(iter(self.planes.values())).patches)

    @property
    def meter_scale(self) -> MeterScale:
        """The meter with its certificate; raises CalibrationError as `labcdp.calibration.setup.meter_scale`."""
        meter = self.configuration.meter
        return meter_scale(self.readings, meter.certificate, meter.f1_prime, self.configuration.source.spectrum)

    @property
    def times(self) -> list[datetime]:
        """Times of all readings of the meter, the first one first."""
        return sorted(reading.timestamp for group in self.readings.values() for reading in group)

    @property
    def by_plane(self) -> dict[str | None, list[PatchObservation]]:
        """Observations of all patches by colour plane."""
        return {name: [o for group in seen.patches.values() for o in group] for name, seen in self.planes.items()}

    @property
    def darks_by_plane(self) -> dict[str | None, Sequence[DarkObservation]]:
        """Dark observations by colour plane."""
        return {name: seen.darks for name, seen in self.planes.items()}

    @property
    def monochrome(self) -> ObservedPlane:
        """The one plane of a monochrome sensor.

        Raises
        ------
        CalibrationError
            If the sensor has colour filters.
        """
        if None not in self.planes:
            raise CalibrationError(
                "the session was recorded with colour filters: this works for monochrome frames; use a monochrome "
                "pixel format"
            )
        return self.planes[None]

    def of_patch(self, name: str) -> list[PatchObservation]:
        """Observations of a patch in all planes."""
        return [observation for plane in self.planes.values() for observation in plane.patches[name]]

    def longest_unsaturated_s(self, calibration: AnyCalibration, *names: str) -> float | None:
        """Longest exposure that saturates none of these patches, within the response if one is; None for none."""
        seen = [
            (plane, o)
            for plane in calibration.planes
            for name in names
            for o in self.planes[plane.state.plane].patches[name]
        ]
        saturated = {o.exposure_s for _, o in seen if o.saturated_share > 0}
        beyond = {o.exposure_s for plane, o in seen if not is_within_response(plane, o)}
        unsaturated = {o.exposure_s for _, o in seen} - saturated
        return max((unsaturated - beyond) or unsaturated, default=None)

    @property
    def patches(self) -> Mapping[str, Sequence[PatchObservation]]:
        """Observations of a monochrome sensor by patch; raises CalibrationError as `monochrome`."""
        return self.monochrome.patches


def observe_session(
    session: Session,
    without: Sequence[str] = (),
    report: Report = lambda _done, _total: None,
    corrections: PlaneCorrections | None = None,
    certificate: MeterCertificate | None = None,
) -> ObservedSession:
    """Measure the patches in all frames of a session; one frame at a time is held.

    Parameters
    ----------
    session : Session
        To read.
    without : sequence of str
        Patches to leave out, and single readings as ``PATCH:NUMBER``, counted from 1.
    report : callable
        Called with the number of frames read, and of all frames; those of a sensor with colour filters are read once
        for each plane.
    corrections : mapping of (str or None) to Corrections, or None
        What is subtracted from the frames of each plane; None for natural vignetting by the configured lens, and for
        what its dark frames show.
    certificate : MeterCertificate or None
        Of the meter, in the place of that in the configuration; its correction is applied to the readings.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If there are no dark frames, or too few frames at an exposure, or the corrections are not for this sensor.
    InputError
        If a region lies outside the image, or `without` names an unknown patch or reading.
    """
    configuration = session.configuration
    if certificate is not None:
        meter = configuration.meter.model_copy(update={"certificate": certificate})
        configuration = configuration.model_copy(update={"meter": meter})
    patches = configuration.target.patches
    without, unread = _left_out(without, session)
    if not session.frames("dark"):
        raise CalibrationError("the session has no dark frames: cover the lens and resume the acquisition")
    planes = planes_of(session)
    if corrections is None:
        corrections = with_dark_frames(corrections_of_lens(session), [session])
    if set(corrections) != set(planes):
        has, wants = ("no" if None in group else "a" for group in (planes, corrections))
        raise CalibrationError(
            f"the sensor of the session has {has} colour filter, the corrections are for one that has {wants} colour "
            "filter: use those of this camera"
        )
    reader = SessionReader(report, len(planes) * len(session.frames()))
    frames = partial(reader.frames, session)
    regions = [patch.region() for patch in patches if patch.name not in without]
    seen = {plane: _observe_plane(session, frames, plane, regions, corrections[plane]) for plane in planes}
    readings: dict[str, list[Reading]] = {}
    for record in session.readings():
        if record.patch not in without and record not in unread:
            readings.setdefault(record.patch, []).append(corrected(record.reading, configuration.meter.certificate))
    return ObservedSession(
        session, configuration, seen, readings, input_sha256(session), frozenset(reader.frames_sha256)
    )


def _left_out(without: Sequence[str], session: Session) -> tuple[list[str], list[ReadingRecord]]:
    """Return the patches and the readings to leave out."""
    known = [patch.name for patch in session.configuration.target.patches]
    of_patches = [name for name in without if name in known or ":" not in name]
    require_patches(of_patches, known, "to leave out")
    unread: list[ReadingRecord] = []
    for text in (name for name in without if name not in of_patches):
        patch, _, number = text.rpartition(":")
        require_patches([patch], known, "to leave out")
        own = [record for record in session.readings() if record.patch == patch]
        if not (number.isdecimal() and 1 <= int(number) <= len(own)):
            raise InputError(f"there is no reading {text!r} to leave out: patch {patch!r} has {len(own)}, from 1 on")
        unread.append(own[int(number) - 1])
    return of_patches, unread


def _observe_plane(
    session: Session,
    read: Callable[[Sequence[FrameRecord], str | None], Iterator[Frame]],
    plane: str | None,
    regions: Sequence[Roi],
    corrections: Corrections,
) -> ObservedPlane:
    library, defects = corrections.dark_library, corrections.defects
    # Each second pixel of a row has the same colour.
    field_px = _field_px(session.configuration, 1 if plane is None else 2)
    observed = partial(
        observe_patches,
        vignetting=corrections.vignetting,
        defects=defects,
        dark_library=library,
        field_px=field_px,
    )
    darks = _observe_darks(session, read, plane, corrections)
    patches: dict[str, list[PatchObservation]] = {region.name: [] for region in regions}
    own = {region.name: region if plane is None else plane_region(region) for region in regions}
    for group in by_exposure(session, "light").values():
        for shown, records in by_patch(group).items():
            seen = [region for name, region in own.items() if shown in (None, name)]
            if seen:
                frames = read(records, plane)
                found = observed(frames, seen) if len(records) >= MIN_FRAMES else _of_one_frame(observed, frames, seen)
                for observation in found:
                    patches[observation.patch].append(observation)
    return ObservedPlane(patches, darks, corrections)


def _observe_darks(
    session: Session,
    read: Callable[[Sequence[FrameRecord], str | None], Iterator[Frame]],
    plane: str | None,
    corrections: Corrections,
) -> list[DarkObservation]:
    defects, library = corrections.defects, corrections.dark_library
    groups = by_exposure(session, "dark").values()
    return [observe_dark(read(group, plane), defects=defects, dark_library=library) for group in groups]


def for_frames_of(session: Session, calibration: AnyCalibration) -> tuple[AnyCalibration, list[Finding]]:
    """Return a calibration for maps of a session's frames, with the dark signal of its dark frames, and what differs.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    """
    if calibration.provenance.comes_from(input_sha256(session)):
        return calibration.at_their_temperature(), []
    first = [session.load(record) for record in session.frames()[:1]]
    calibration = calibration.for_use([one.timestamp for one in first], [one.temperature_c for one in first])
    groups = by_exposure(session, "dark").values()
    if not groups or min(map(len, groups)) < MIN_FRAMES:
        return calibration, of_other_conditions(calibration)
    own = calibration_for(session, calibration)
    read = partial(SessionReader(lambda _done, _total: None, len(session.frames("dark"))).frames, session)
    corrections = corrections_of(own)
    darks = {plane: _observe_darks(session, read, plane, corrections[plane]) for plane in planes_of(session)}
    calibration, findings = in_session(own, {}, darks)
    return calibration, [*findings, *of_other_conditions(calibration)]


def _field_px(configuration: SessionConfiguration, step: int) -> float | None:
    """Diameter of the meter's field in every `step`-th pixel of the image; None if it is not known."""
    given, lens = configuration.conditions, configuration.lens
    if given is None or given.meter_distance_m is None or given.measuring_field_deg is None:
        return None
    diameter_m = 2 * given.meter_distance_m * tan(radians(given.measuring_field_deg) / 2)
    magnification = lens.focal_length_m / (given.camera_distance_m or given.meter_distance_m)
    return diameter_m * magnification / (configuration.camera.pixel_pitch_m * step)


def _of_one_frame(
    observed: Callable[[Sequence[Frame], Sequence[Roi]], list[PatchObservation]],
    frames: Iterable[Frame],
    regions: Sequence[Roi],
) -> list[PatchObservation]:
    """Measure patches in the only frame of an exposure: possible if all are saturated, and so left out by the fit.

    Saturated frames are identical, and an import keeps one of identical pictures.
    """
    (frame,) = frames
    twice = observed([frame, frame], regions)
    if all(o.saturated_share > MAX_CLIPPED_SHARE for o in twice):
        return [replace(o, frame_means_dn=o.frame_means_dn[:1]) for o in twice]
    return observed([frame], regions)  # says what is missing


def input_sha256(session: Session) -> str:
    """Return a hash over the hashes of all frames and the readings, in the order of recording."""
    digest = hashlib.sha256()
    for frame in session.frames():
        digest.update(frame.file.sha256.encode())
    for record in session.readings():
        digest.update(json.dumps([record.patch, record.reading.to_dict()], sort_keys=True).encode())
    return digest.hexdigest()


def response_of_session(observed: ObservedSession) -> ResponseCurve:
    """Find the response from a session's light frames, a bracket of the target that stood still.

    Where patches were shown one by one, their frames are laid side by side.

    Parameters
    ----------
    observed : ObservedSession
        Of a monochrome sensor.

    Raises
    ------
    CalibrationError
        If the sensor has colour filters, the session has too few exposures, or as `response_from_bracket`.
    SessionError
        If a file is missing or altered.
    """
    darks = observed.monochrome.darks
    groups = by_exposure(observed.session, "light")
    if len(groups) < MIN_EXPOSURES:
        there = ", ".join(f"{1e3 * t:g} ms" for t in groups)
        raise CalibrationError(
            f"the session has light frames at {len(groups)} exposure{'s' if len(groups) > 1 else ''} ({there}): the "
            f"response by a bracket needs {MIN_EXPOSURES} or more; record more exposures, a factor of 1.5 to 2.5 apart"
        )
    frames = [frame for records in groups.values() for frame in _scenes(observed.session, records)]
    return response_from_bracket(frames, float(np.mean([dark.mean_dn for dark in darks])))


def _scenes(session: Session, records: Sequence[FrameRecord]) -> list[Frame]:
    """Frames of all that was shown at one exposure."""
    shown = [[session.load(record) for record in group] for group in by_patch(records).values()]
    together = zip(*shown, strict=False)  # as many as there are of each
    return [parts[0].with_pixels(np.concatenate([part.dn for part in parts])) for parts in together]
