"""Vignetting and defects of a camera from a session that shows it uniform light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...calibration.defects import find_defects
from ...calibration.flat.field import MeasuredVignetting, measure_vignetting
from ...calibration.frames.measure import MeasuredFrames, measure_whole
from ...core.errors import CalibrationError
from ...core.response import Response
from ...core.vignetting import AnyVignetting
from ...session import Session
from .corrections import Corrections
from .recorded import Report, SessionReader, by_exposure, lens_of, planes_of


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

    lights: Mapping[str | None, Sequence[MeasuredFrames]]
    darks: Mapping[str | None, Sequence[MeasuredFrames]]
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
        planes = planes_of(session)
        reader = SessionReader(report, len(planes) * len(session.frames()))
        lights, darks = (
            {plane: [measure_whole(reader.frames(session, records, plane)) for records in groups] for plane in planes}
            for groups in (by_exposure(session, "light").values(), by_exposure(session, "dark").values())
        )
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
            unclipped = [light for light in lights if light.statistics.clipped.mean() < 0.01] or lights
            # Hot pixels show best in the longest dark signal, dead ones in the brightest light.
            defects = find_defects(
                max(self.darks[plane], key=lambda s: s.exposure_s).statistics,
                max(unclipped, key=lambda s: s.statistics.mean_dn).statistics,
            )
            findings = (vignetting.reason, *vignetting.findings)
            result[plane] = Corrections(vignetting.chosen, defects, findings=findings)
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
        If camera, image size, region of the sensor, pixel format, lens or f-number differ.
    """
    mine, theirs = (one.load(one.frames()[0]) for one in (session, flat))
    readouts = (mine.readout, theirs.readout)
    for what, a, b in (
        ("camera", str(mine.camera), str(theirs.camera)),
        ("image size", f"{mine.shape[1]} x {mine.shape[0]}", f"{theirs.shape[1]} x {theirs.shape[0]}"),
        ("region of the sensor", *(str(one) if all(readouts) else "" for one in readouts)),
        ("pixel format", mine.pixel_format, theirs.pixel_format),
        ("lens", str(lens_of(session.configuration)), str(lens_of(flat.configuration))),
    ):
        if a != b:
            raise CalibrationError(
                f"the {what} of the flat field's session is {b}, that of the session {a}: record the flat field with "
                "the same camera and lens"
            )
