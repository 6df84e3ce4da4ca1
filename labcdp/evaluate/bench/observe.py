"""From a recorded session to what its frames and readings say."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from math import radians, tan
from typing import TypeAlias

import numpy as np

from ...calibration import AnyCalibration, DarkObservation, PatchObservation
from ...calibration.convert.patch import is_within_response
from ...calibration.frames.defects import DefectMap
from ...calibration.frames.measure import MIN_FRAMES, MeasuredFrames, measure_planes
from ...calibration.frames.observe import dark_observation, patch_observations
from ...calibration.in_session import in_session, other_conditions_findings
from ...calibration.readings import PatchReading, combine_patches
from ...calibration.sensor.response import MIN_EXPOSURES, ResponseCurve, response_from_bracket
from ...calibration.setup import MeterScale, corrected, meter_scale
from ...core.errors import CalibrationError, InputError
from ...core.frame import Frame
from ...core.luminance import LuminanceMap
from ...core.reading import Reading
from ...core.result import Finding
from ...session import FrameRecord, MeterCertificate, PatchConfiguration, ReadingRecord, Session, SessionConfiguration
from .corrections import (
    Corrections,
    DarkFrames,
    PlaneCorrections,
    calibration_corrections,
    calibration_for,
    lens_corrections,
    with_dark_frames,
)
from .recorded import (
    Loader,
    Report,
    by_exposure,
    by_patch,
    frame_loader,
    noted,
    planes_of,
    require_patches,
)

#: Observations by patch, in the target's order.
PatchGroups: TypeAlias = Mapping[str, Sequence[PatchObservation]]


@dataclass(frozen=True)
class ObservedSession:
    """Observations and readings of the patches of a session.

    Parameters
    ----------
    session : Session
        To read frames from.
    configuration : SessionConfiguration
        Bench, target and plan.
    patches_by_plane : dict of (str or None) to dict of str to list of PatchObservation
        By colour plane, None for a monochrome sensor, and by name of the patch in the target's order; one observation
        an exposure.
    darks_by_plane : dict of (str or None) to list of DarkObservation
        By colour plane; one an exposure.
    corrections : dict of (str or None) to Corrections
        What was subtracted, by colour plane.
    readings : dict of str to list of Reading
        By name of the patch, with the correction of the meter's certificate.
    input_sha256 : str
        Hash over the hashes of all frames and the readings, in the order of recording.
    frames_sha256 : frozenset of str
        Hashes of the pixels of the frames, but not of those of simulated cameras.
    first_frames : dict of int to Frame
        Frames that were kept for maps of the target, by their number: the first of each exposure.
    regions_by_plane : dict of (str or None) to list of list of MeasuredFrames
        By colour plane the measured regions of each exposure, if they were kept for another vignetting.
    """

    session: Session
    configuration: SessionConfiguration
    patches_by_plane: Mapping[str | None, PatchGroups]
    darks_by_plane: Mapping[str | None, Sequence[DarkObservation]]
    corrections: PlaneCorrections
    readings: Mapping[str, Sequence[Reading]]
    input_sha256: str
    frames_sha256: frozenset[str]
    first_frames: dict[int, Frame] = field(default_factory=dict)
    regions_by_plane: Mapping[str | None, Sequence[Sequence[MeasuredFrames]]] = field(default_factory=dict, repr=False)

    def with_vignetting(self, corrections: PlaneCorrections) -> ObservedSession:
        """Return the same with corrections that differ in the vignetting; the regions must have been kept."""
        patches = {
            plane: _observed_patches(self.regions_by_plane[plane], self.names, correction, self.configuration, plane)
            for plane, correction in corrections.items()
        }
        return replace(self, patches_by_plane=patches, corrections=corrections)

    def frame(self, record: FrameRecord) -> Frame:
        """Return a frame; those of the whole target are kept, as several maps show them."""
        kept = self.first_frames.get(record.number)
        frame = self.session.load(record) if kept is None else kept
        if record.patch is None:
            self.first_frames[record.number] = frame
        return frame

    @property
    def names(self) -> tuple[str, ...]:
        """Patches that were measured, in the target's order."""
        return tuple(next(iter(self.patches_by_plane.values())))

    @cached_property
    def by_meter(self) -> dict[str, PatchReading]:
        """Patches by the meter, those that have a reading; raises CalibrationError as `combine_patches`."""
        return combine_patches({patch: readings for patch, readings in self.readings.items() if readings})[0]

    @cached_property
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
        return {plane: [o for group in seen.values() for o in group] for plane, seen in self.patches_by_plane.items()}

    @property
    def patches(self) -> PatchGroups:
        """Observations of a monochrome sensor by patch.

        Raises
        ------
        CalibrationError
            If the sensor has colour filters.
        """
        if None not in self.patches_by_plane:
            raise CalibrationError(
                "the session was recorded with colour filters: this works for monochrome frames; use a monochrome "
                "pixel format"
            )
        return self.patches_by_plane[None]

    def observations(self, name: str) -> list[PatchObservation]:
        """Return the observations of a patch in all planes."""
        return [observation for patches in self.patches_by_plane.values() for observation in patches[name]]

    def longest_unsaturated_s(self, calibration: AnyCalibration, *names: str) -> float | None:
        """Longest exposure that saturates none of these patches, within the response if one is; None for none."""
        seen = [
            (plane, o)
            for plane in calibration.planes
            for name in names
            for o in self.patches_by_plane[plane.state.plane][name]
        ]
        saturated = {o.exposure_s for _, o in seen if o.saturated_share > 0}
        beyond = {o.exposure_s for plane, o in seen if not is_within_response(plane, o)}
        unsaturated = {o.exposure_s for _, o in seen} - saturated
        return max((unsaturated - beyond) or unsaturated, default=None)


def frame_maps(observed: ObservedSession, calibration: AnyCalibration) -> Callable[[FrameRecord], LuminanceMap]:
    """Return a function that converts a frame of a session; maps of the whole target are kept."""
    kept: dict[int, LuminanceMap] = {}

    def convert(record: FrameRecord) -> LuminanceMap:
        if record.number in kept:
            return kept[record.number]
        luminance = calibration.to_luminance(observed.frame(record))
        if record.patch is None:
            kept[record.number] = luminance
        return luminance

    return convert


def observe_session(
    session: Session,
    without: Sequence[str] = (),
    report: Report = lambda _done, _total: None,
    corrections: PlaneCorrections | None = None,
    certificate: MeterCertificate | None = None,
    *,
    darks: DarkFrames | None = None,
    keep_regions: bool = False,
) -> ObservedSession:
    """Measure the patches in all frames of a session, each frame loaded once, and return what they say.

    Parameters
    ----------
    session : Session
        To read.
    without : sequence of str
        Patches to leave out, and single readings as ``PATCH:NUMBER``, counted from 1.
    report : callable
        Called with the number of frames read, and of all frames.
    corrections : mapping of (str or None) to Corrections, or None
        What is subtracted from the frames of each plane; None for natural vignetting by the configured lens, and for
        what its dark frames show.
    certificate : MeterCertificate or None
        Of the meter, in the place of that in the configuration; its correction is applied to the readings.
    darks : (mapping of (str or None) to sequence of MeasuredFrames, frozenset of str) or None
        Dark frames and hashes of their pixels, if they have been measured with the defects of the corrections, from
        `with_dark_frames`.
    keep_regions : bool
        Whether to keep the measured regions, for `ObservedSession.with_vignetting`.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If there are no dark frames, or too few frames at an exposure, or the corrections are not for this sensor.
    InputError
        If a region lies outside the image, or `without` names an unknown patch or reading.
    """
    configuration, patches, unread = included(session, without, certificate)
    if not session.frames("dark"):
        raise CalibrationError("the session has no dark frames: cover the lens and resume the acquisition")
    planes = planes_of(session)
    if corrections is None:
        corrections, (darks,) = with_dark_frames(lens_corrections(session), [session])
    if set(corrections) != set(planes):
        has, wants = ("no" if None in group else "a" for group in (planes, corrections))
        raise CalibrationError(
            f"the sensor of the session has {has} colour filter, the corrections are for one that has {wants} colour "
            "filter: use those of this camera"
        )
    defects = {plane: correction.defects for plane, correction in corrections.items()}
    regions = [patch.region() for patch in patches]
    load = frame_loader(report, len(session.frames("light" if darks else None)))
    dark_frames, dark_hashes = darks or _measure_darks(session, planes, defects, load)
    hashes, first_frames = set(dark_hashes), dict[int, Frame]()
    lights: dict[str | None, list[list[MeasuredFrames]]] = {plane: [] for plane in planes}
    for group in by_exposure(session, "light").values():
        for shown, records in by_patch(group).items():
            seen = [region for region in regions if shown in (None, region.name)]
            if seen:
                frames = _first_kept(noted(load(session, records), hashes), records[0], first_frames)
                for plane, measured in measure_planes(frames, planes, seen, defects).items():
                    lights[plane].append(measured)
    names = tuple(region.name for region in regions)
    readings = session_readings(session, configuration, names, unread)
    observed_darks = {
        plane: [dark_observation(dark, corrections[plane].dark_library) for dark in dark_frames[plane]]
        for plane in planes
    }
    seen_patches = {
        plane: _observed_patches(lights[plane], names, correction, configuration, plane)
        for plane, correction in corrections.items()
    }
    return ObservedSession(
        session,
        configuration,
        seen_patches,
        observed_darks,
        corrections,
        readings,
        input_sha256(session),
        frozenset(hashes),
        first_frames,
        lights if keep_regions else {},
    )


def _observed_patches(
    regions: Sequence[Sequence[MeasuredFrames]],
    names: Sequence[str],
    corrections: Corrections,
    configuration: SessionConfiguration,
    plane: str | None,
) -> PatchGroups:
    """Observe the patches of a plane in the measured regions of each exposure."""
    library, patches = corrections.dark_library, {name: list[PatchObservation]() for name in names}
    field_px = field_diameter_px(configuration, plane)
    for measured in regions:
        for observation in patch_observations(measured, corrections.vignetting, library, field_px):
            patches[observation.patch].append(observation)
    return patches


def included(
    session: Session, without: Sequence[str], certificate: MeterCertificate | None
) -> tuple[SessionConfiguration, list[PatchConfiguration], list[ReadingRecord]]:
    """Return configuration, patches and left-out readings of a session; parameters as for `observe_session`."""
    configuration = session.configuration
    if certificate is not None:
        meter = configuration.meter.model_copy(update={"certificate": certificate})
        configuration = configuration.model_copy(update={"meter": meter})
    names, unread = _left_out(without, session)
    return configuration, [patch for patch in configuration.target.patches if patch.name not in names], unread


def _first_kept(frames: Iterable[Frame], first: FrameRecord, kept: dict[int, Frame]) -> Iterator[Frame]:
    """Yield frames, and keep the first one if it shows all of the target, for maps."""
    for number, frame in enumerate(frames):
        if number == 0 and first.patch is None:
            kept[first.number] = frame
        yield frame


def session_readings(
    session: Session, configuration: SessionConfiguration, patches: Collection[str], unread: Sequence[ReadingRecord]
) -> dict[str, list[Reading]]:
    """Return the readings of patches that are not left out, with the correction of the configured certificate."""
    readings: dict[str, list[Reading]] = {}
    for record in session.readings():
        if record.patch in patches and record not in unread:
            readings.setdefault(record.patch, []).append(corrected(record.reading, configuration.meter.certificate))
    return readings


def _left_out(without: Sequence[str], session: Session) -> tuple[list[str], list[ReadingRecord]]:
    """Return the patches and the readings to leave out."""
    known = [patch.name for patch in session.configuration.target.patches]
    of_patches = [name for name in without if name in known or ":" not in name]
    require_patches(of_patches, known, "to leave out")
    unread: list[ReadingRecord] = []
    for text in (name for name in without if name not in of_patches):
        patch, _, number = text.rpartition(":")
        require_patches([patch], known, "to leave out")
        of_patch = [record for record in session.readings() if record.patch == patch]
        if not (number.isdecimal() and 1 <= int(number) <= len(of_patch)):
            n = len(of_patch)
            raise InputError(f"there is no reading {text!r} to leave out: patch {patch!r} has {n}, from 1 on")
        unread.append(of_patch[int(number) - 1])
    return of_patches, unread


def _measure_darks(
    session: Session, planes: Sequence[str | None], defects: Mapping[str | None, DefectMap | None], load: Loader
) -> DarkFrames:
    darks, hashes = {plane: list[MeasuredFrames]() for plane in planes}, set[str]()
    for records in by_exposure(session, "dark").values():
        frames = noted(load(session, records), hashes)
        for plane, measured in measure_planes(frames, planes, defects=defects).items():
            darks[plane] += measured
    return darks, frozenset(hashes)


def calibration_for_frames(session: Session, calibration: AnyCalibration) -> tuple[AnyCalibration, list[Finding]]:
    """Return a calibration for maps of a session's frames, with the dark signal of its dark frames, and what differs.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    """
    if calibration.provenance.comes_from(input_sha256(session)):
        return calibration.at_their_temperature(), []
    first = [session.load(record) for record in session.frames()[:1]]
    calibration = calibration.for_use([frame.timestamp for frame in first], [frame.temperature_c for frame in first])
    groups = by_exposure(session, "dark").values()
    if not groups or min(map(len, groups)) < MIN_FRAMES:
        return calibration, other_conditions_findings(calibration)
    in_part = calibration_for(session, calibration)
    corrections, planes = calibration_corrections(in_part), planes_of(session)
    load = frame_loader(lambda _done, _total: None, len(session.frames("dark")))
    defects = {plane: corrections[plane].defects for plane in planes}
    darks = {
        plane: [dark_observation(dark, corrections[plane].dark_library) for dark in measured]
        for plane, measured in _measure_darks(session, planes, defects, load)[0].items()
    }
    calibration, findings = in_session(in_part, {}, darks)
    return calibration, [*findings, *other_conditions_findings(calibration)]


def field_diameter_px(configuration: SessionConfiguration, plane: str | None) -> float | None:
    """Diameter of the meter's field in pixels of the image, or of one of its planes; None if it is not known."""
    given, lens = configuration.conditions, configuration.lens
    if given is None or given.meter_distance_m is None or given.measuring_field_deg is None:
        return None
    diameter_m = 2 * given.meter_distance_m * tan(radians(given.measuring_field_deg) / 2)
    magnification = lens.focal_length_m / (given.camera_distance_m or given.meter_distance_m)
    # Each second pixel of a row has the same colour.
    step = 1 if plane is None else 2
    return diameter_m * magnification / (configuration.camera.pixel_pitch_m * step)


def input_sha256(session: Session) -> str:
    """Return a hash over the hashes of all frames and the readings, in the order of recording."""
    digest = hashlib.sha256()
    for frame in session.frames():
        digest.update(frame.file.sha256.encode())
    for record in session.readings():
        digest.update(json.dumps([record.patch, record.reading.to_dict()], sort_keys=True).encode())
    return digest.hexdigest()


def session_response(observed: ObservedSession) -> ResponseCurve:
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
    darks = observed.darks_by_plane[None]
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
