"""Corrections of frames before patches are measured: vignetting, defects and the dark pattern."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod

from ...calibration import AnyCalibration, Calibration
from ...calibration.frames.defects import DefectMap
from ...calibration.frames.measure import MeasuredFrames, measure_planes, plane_of, plane_offset_px
from ...calibration.frames.observations import CameraState
from ...calibration.sensor.dark_library import DarkLibrary, dark_library
from ...calibration.sensor.defects import find_defects
from ...calibration.sensor.flat_field import MeasuredVignetting, measure_vignetting
from ...core.dn import Response
from ...core.errors import CalibrationError
from ...core.frame import Frame, Readout
from ...core.photometry import axial_illuminance_per_cd_m2, photon_radiance_per_cd_m2
from ...core.result import Finding, info
from ...core.vignetting import AnyVignetting, Cos4Vignetting
from ...session import Role, Session, SessionConfiguration
from .recorded import (
    NO_LIGHT,
    Loader,
    Report,
    by_exposure,
    configured_lens,
    frame_loader,
    noted,
    planes_of,
    settings_frame,
)

#: Corrections by colour plane; None stands for a monochrome sensor.
PlaneCorrections = Mapping[str | None, "Corrections"]
#: Measured frames by colour plane.
PlaneFrames = Mapping[str | None, Sequence[MeasuredFrames]]
#: Dark frames of a session, one an exposure, and hashes of the pixels of its frames.
DarkFrames = tuple[PlaneFrames, frozenset[str]]


@dataclass(frozen=True)
class Corrections:
    """Corrections for the frames of one plane.

    Parameters
    ----------
    vignetting : Cos4Vignetting, RadialVignetting, FlatField or None
        Vignetting; None for none.
    defects : DefectMap or None
        Pixels that are left out of regions.
    dark_library : DarkLibrary or None
        Dark pattern.
    findings : tuple of Finding
        What was found when they were measured.
    """

    vignetting: AnyVignetting | None
    defects: DefectMap | None = None
    dark_library: DarkLibrary | None = None
    findings: tuple[Finding, ...] = ()


def pixel_area_m2(pixel_pitch_m: float, readout: Readout | None) -> float:
    """Area of a sensor with this pitch that a pixel of its frames sums or averages."""
    return pixel_pitch_m**2 * (1 if readout is None else prod(readout.binning))


def photons_per_cd_m2_s(spectrum: str, f_number: float, transmittance: float, area_m2: float) -> float:
    """Photons that a pixel on the axis gets in a second from 1 cd/m^2 far away; InputError for an unknown spectrum."""
    return photon_radiance_per_cd_m2(spectrum) * axial_illuminance_per_cd_m2(f_number, transmittance, 0.0) * area_m2


def natural_vignetting(configuration: SessionConfiguration, state: CameraState) -> Cos4Vignetting:
    """Natural vignetting of the configured lens: what is known without a flat field."""
    # The pixels of one colour are two pitches apart.
    readout = state.readout or Readout()
    apart = readout.pitches * (1 if state.plane is None else 2)
    pitch_m, axis_px = apart * configuration.camera.pixel_pitch_m, readout.axis_px(state.image_shape)
    if any(beside := plane_offset_px(state)):
        height, width = state.image_shape
        middle_px = axis_px or (width / 2, height / 2)
        axis_px = middle_px[0] - beside[0], middle_px[1] - beside[1]
    lens = configuration.lens
    return Cos4Vignetting(lens.focal_length_m, pitch_m, axis_px, lens.vignetting_rel)


def calibration_for(session: Session, calibration: AnyCalibration) -> AnyCalibration:
    """Return a calibration for the part of the sensor that the frames of a session show."""
    frames = session.frames()
    if not frames or frames[0].metadata.get("readout") is None:
        return calibration
    states = _states(session)
    planes = tuple(plane.in_region(states.get(plane.state.plane, plane.state)) for plane in calibration.planes)
    return planes[0] if isinstance(calibration, Calibration) else replace(calibration, planes=planes)


def _states(session: Session) -> dict[str | None, CameraState]:
    first = settings_frame(session)
    return {plane: CameraState.of(plane_of(first, plane)) for plane in planes_of(session)}


def calibration_corrections(calibration: AnyCalibration) -> dict[str | None, Corrections]:
    """Corrections of each plane of a calibration: its patches are measured with nothing else."""
    return {
        plane.state.plane: Corrections(plane.vignetting, plane.defects, plane.dark_library)
        for plane in calibration.planes
    }


def lens_corrections(session: Session) -> dict[str | None, Corrections]:
    """Natural vignetting of the session's lens for each plane: what is known without a measurement."""
    states = _states(session)
    return {plane: Corrections(natural_vignetting(session.configuration, state)) for plane, state in states.items()}


def with_dark_frames(
    corrections: PlaneCorrections, sessions: Sequence[Session], report: Report = lambda _done, _total: None
) -> tuple[dict[str | None, Corrections], list[DarkFrames]]:
    """Add what the dark frames of sessions show: hot and noisy pixels, and the pattern of the dark signal.

    The pattern is added only where taking it off leaves less than it removes at an exposure of the light frames, and
    only if all sessions have one gain, as it grows with the gain.

    Parameters
    ----------
    corrections : mapping of (str or None) to Corrections
        By colour plane, None for a monochrome sensor; those of another source of dark frames are replaced.
    sessions : sequence of Session
        Sessions of one camera; dark frames at several temperatures determine the temperature dependence.
    report : callable
        Called with the number of frames read, and of all.

    Returns
    -------
    dict of (str or None) to Corrections
        By colour plane.
    list of (dict of (str or None) to list of MeasuredFrames, frozenset of str)
        Of each session its dark frames by plane, one an exposure, without the defect pixels, and the hashes of their
        pixels.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If there are no light frames, or frames of one exposure differ in camera or setting.
    """
    light_s = sorted({t for session in sessions for t in by_exposure(session, "light")})
    if not light_s:
        raise CalibrationError(NO_LIGHT)
    load = frame_loader(report, sum(len(session.frames("dark")) for session in sessions))
    groups = [(n, group) for n, session in enumerate(sessions) for group in by_exposure(session, "dark").values()]
    order = sorted(range(len(groups)), key=lambda k: (len(groups[k][1]) < 2, -groups[k][1][0].exposure_s))
    planes, known, hashes = [*corrections], dict(corrections), [set[str]() for _ in sessions]
    measured: dict[int, dict[str | None, list[MeasuredFrames]]] = {}
    # Hot pixels show best in the longest dark signal, whose frames are measured again without them.
    for k in order:
        number, records = groups[k]
        frames: Iterable[Frame] = noted(load(sessions[number], records), hashes[number])
        if not measured and len(records) > 1:
            frames = [*frames]
            whole = measure_planes(frames, planes)
            known = {plane: _without_defects(correction, whole[plane][0]) for plane, correction in corrections.items()}
        measured[k] = measure_planes(
            frames, planes, defects={plane: correction.defects for plane, correction in known.items()}
        )
    darks: list[dict[str | None, list[MeasuredFrames]]] = [{plane: [] for plane in planes} for _ in sessions]
    for k, (number, _) in enumerate(groups):
        for plane in planes:
            darks[number][plane] += measured[k][plane]
    result: dict[str | None, Corrections] = {}
    for plane, correction in known.items():
        library, findings = _library([dark for of in darks for dark in of[plane]], correction.defects, light_s)
        result[plane] = replace(correction, dark_library=library, findings=(*correction.findings, *findings))
    return result, [(planes, frozenset(keys)) for planes, keys in zip(darks, hashes, strict=True)]


def _without_defects(corrections: Corrections, dark: MeasuredFrames) -> Corrections:
    """Add hot and noisy pixels of repeated dark frames."""
    hot = find_defects(dark)
    if hot.n_pixels == 0:
        return corrections
    defects = hot if corrections.defects is None else corrections.defects.joined(hot)
    return replace(
        corrections, defects=defects, findings=(*corrections.findings, info("hot-pixels", count=hot.n_pixels))
    )


def _library(
    darks: Sequence[MeasuredFrames], defects: DefectMap | None, light_s: Sequence[float]
) -> tuple[DarkLibrary | None, list[Finding]]:
    if not any(dark.n_frames > 1 for dark in darks) or len({dark.state.gain_db for dark in darks}) > 1:
        return None, []
    library = dark_library(darks, defects)
    worth = [t for t in light_s if library.worth_applying(t)]
    return library if worth else None, library.verdict(max(worth or light_s))


def _measured(session: Session, load: Loader, role: Role) -> dict[str | None, list[MeasuredFrames]]:
    """Measure the frames of a role, by plane, one an exposure."""
    planes = planes_of(session)
    measured: dict[str | None, list[MeasuredFrames]] = {plane: [] for plane in planes}
    for group in by_exposure(session, role).values():
        for plane, frames in measure_planes(load(session, group), planes).items():
            measured[plane] += frames
    return measured


@dataclass(frozen=True, eq=False)
class UniformLight:
    """Frames of a uniform source, by colour plane, None for a monochrome sensor.

    Parameters
    ----------
    lights, darks : mapping of (str or None) to list of MeasuredFrames
        One for each exposure.
    source_nonuniformity_rel : float
        Relative standard uncertainty of the source's uniformity.
    """

    lights: PlaneFrames
    darks: PlaneFrames
    source_nonuniformity_rel: float

    @classmethod
    def read(
        cls, session: Session, source_nonuniformity_rel: float, report: Report = lambda _done, _total: None
    ) -> UniformLight:
        """Read a session recorded as any other, with a uniform source that fills the image instead of the target.

        Parameters
        ----------
        session : Session
            The session.
        source_nonuniformity_rel : float
            Relative standard uncertainty of the source's uniformity.
        report : callable
            Called with the number of frames read, and of all.

        Raises
        ------
        CalibrationError
            If frames of one exposure differ in camera or setting.
        SessionError
            If a file is missing or altered.
        """
        load = frame_loader(report, len(session.frames()))
        lights, darks = (_measured(session, load, role) for role in ("light", "dark"))
        return cls(lights, darks, source_nonuniformity_rel)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of a plane."""
        return next(iter(self.lights.values()))[0].state.image_shape

    @property
    def corrections(self) -> dict[str | None, Corrections]:
        """Vignetting of a linear camera, and defects; raises CalibrationError as `measure_vignetting`."""
        result = {}
        for plane, lights in self.lights.items():
            vignetting = self._vignetting(plane, Response())
            unclipped = [light for light in lights if light.clipped.mean() < 0.01] or lights
            # Hot pixels show best in the longest dark signal, dead ones in the brightest light.
            defects = find_defects(
                max(self.darks[plane], key=lambda s: s.exposure_s),
                max(unclipped, key=lambda s: s.mean_dn),
            )
            result[plane] = Corrections(vignetting.chosen, defects, findings=vignetting.findings)
        return result

    def linearised(self, responses: Mapping[str | None, Response]) -> dict[str | None, AnyVignetting]:
        """Vignetting of a camera with these responses."""
        return {plane: self._vignetting(plane, response).chosen for plane, response in responses.items()}

    def _vignetting(self, plane: str | None, response: Response) -> MeasuredVignetting:
        return measure_vignetting(self.lights[plane], self.darks[plane], self.source_nonuniformity_rel, response)


def require_same_optics(session: Session, flat: Session) -> None:
    """Refuse a flat field of another camera or lens.

    Raises
    ------
    CalibrationError
        If camera, image size, binning or part of the sensor, pixel format, lens or f-number differ.
    """
    mine, theirs = (settings_frame(each) for each in (session, flat))
    lens, other = (configured_lens(each.configuration) for each in (session, flat))
    for what, a, b in (
        ("camera", str(mine.camera), str(theirs.camera)),
        ("image size", f"{mine.shape[1]} x {mine.shape[0]}", f"{theirs.shape[1]} x {theirs.shape[0]}"),
        *Readout.compared(mine.readout, theirs.readout),
        ("pixel format", mine.pixel_format, theirs.pixel_format),
        ("lens", str(lens), str(lens if other.is_as_in(lens) else other)),
    ):
        if a != b:
            raise CalibrationError(
                f"the {what} of the flat field's session is {b}, that of the session {a}: record the flat field with "
                "the same camera and lens"
            )
