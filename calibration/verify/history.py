"""The history of cameras: their calibrations and verifications over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from math import hypot, inf, sqrt

from ...core.frame import PLANES
from ..colour.model import AnyCalibration
from ..frames.observations import CameraState
from ..model import Calibration
from ..sensor.dark import DarkModel
from ..setup import LensIdentity, MeterScale
from ..uncertainty import expanded_half_width, expanded_rel, scales_apart
from .result import Verdict, Verification, VerifiedPlane


@dataclass(frozen=True)
class HistoryPoint:
    """State of a camera at one time.

    Parameters
    ----------
    source : str
        The file.
    measured : datetime
        Time of the last meter reading.
    responsivity : (float, float, float) or None
        R, and its relative U (95 %) without and with the meter's scale. Of a verification, that of its calibration with
        the deviation it found; None if it found none of this plane.
    dark : DarkModel
        The dark signal.
    meter : MeterScale
        The meter with its certificate.
    weight : float or None
        Of the plane in the luminance; None for a monochrome sensor, or a verification.
    k_dn_per_e : float or None
        Overall system gain K; None for a verification, or if it is not known.
    verdict : {'conform', 'undecided', 'not conform'} or None
        Of a verification; None for a calibration.
    frames_sha256 : frozenset of str
        Hashes of the pixels of the frames; empty if they are not known.
    """

    source: str
    measured: datetime
    responsivity: tuple[float, float, float] | None
    dark: DarkModel
    meter: MeterScale
    weight: float | None = None
    k_dn_per_e: float | None = None
    verdict: Verdict | None = None
    frames_sha256: frozenset[str] = frozenset()

    def is_measured_with(self, other: HistoryPoint) -> bool:
        """Whether both are calibrations, or both verifications, with the same last reading or some same frames."""
        if (self.verdict is None) != (other.verdict is None):
            return False
        return self.measured == other.measured or not self.frames_sha256.isdisjoint(other.frames_sha256)

    @property
    def dark_offset_dn(self) -> tuple[float, float]:
        """Dark signal at zero exposure, and its U (95 %)."""
        return self.dark.offset_dn, expanded_half_width(0.0, sqrt(self.dark.offset_variance_dn2))

    @property
    def dark_rate_dn_s(self) -> tuple[float, float] | None:
        """Its growth per second, and U (95 %); None if dark frames have one exposure only."""
        if len(self.dark.exposures_s) == 1:
            return None
        return self.dark.rate_dn_s, expanded_half_width(0.0, sqrt(self.dark.rate_variance_dn2_s2))


@dataclass(frozen=True)
class CameraHistory:
    """History of one camera, or one plane of it, with one lens and setting.

    Parameters
    ----------
    state : CameraState
        Camera, gain, pixel format and colour plane.
    lens : LensIdentity
        The lens.
    points : tuple of HistoryPoint
        By time, the earliest first.
    """

    state: CameraState
    lens: LensIdentity
    points: tuple[HistoryPoint, ...]

    @property
    def plane(self) -> str | None:
        """The colour plane; None for a monochrome sensor."""
        return self.state.plane

    @property
    def n_measurements(self) -> int:
        """Number of measurements: calibrations with the same last reading or frames are one, whatever their fit."""
        first: list[HistoryPoint] = []
        for point in self.points:
            if not any(point.is_measured_with(earlier) for earlier in first):
                first.append(point)
        return len(first)

    @property
    def change_rel(self) -> tuple[float, float] | None:
        """Change of the responsivity from the first to the last point, with U (95 %); None for one measurement.

        The scale of the meter cancels if it is one meter in one state of adjustment, but for half of a step of it.
        """
        known = [(p, p.responsivity, p.meter) for p in self.points if p.responsivity]
        others = [of for of in known[1:] if not of[0].is_measured_with(known[0][0])]
        if not others:
            return None
        (_, before, first_meter), (_, after, last_meter) = known[0], others[-1]
        which = 1 if first_meter.is_as_in(last_meter) else 2
        return after[0] / before[0] - 1, hypot(before[which], after[which])


def histories(
    calibrations: Mapping[str, AnyCalibration], verifications: Mapping[str, Verification]
) -> tuple[CameraHistory, ...]:
    """Sort calibrations and verifications by camera, lens, f-number, gain, pixel format and plane, and by time.

    Parameters
    ----------
    calibrations, verifications : mapping of str
        By the name of their file.

    Returns
    -------
    tuple of CameraHistory
        In the order of cameras, lenses, settings and planes.
    """
    groups: dict[tuple[str | int, ...], tuple[CameraState, LensIdentity, list[HistoryPoint]]] = {}
    points = [
        (plane.state, plane.lens, _calibration_point(source, plane, weight if plane.state.plane else None))
        for source, c in calibrations.items()
        for plane, weight in zip(c.planes, c.weights, strict=True)
    ]
    points += [
        (replace(v.state, plane=plane.plane), v.lens, _verification_point(source, v, plane))
        for source, v in verifications.items()
        for plane in v.planes
    ]
    for state, lens, point in points:
        order = PLANES.index(state.plane) if state.plane else -1
        key = (str(state.camera), repr(lens), f"{state.gain_db:g}", state.pixel_format, order)
        groups.setdefault(key, (state, lens, []))[2].append(point)
    return tuple(
        CameraHistory(state, lens, tuple(sorted(points, key=lambda point: point.measured)))
        for _, (state, lens, points) in sorted(groups.items(), key=lambda item: item[0])
    )


def _calibration_point(source: str, calibration: Calibration, weight: float | None) -> HistoryPoint:
    fit, meter, k = calibration.responsivity, calibration.meter_scale, calibration.noise.k_dn_per_e
    kinds = scales_apart(meter, meter), (meter,)
    own_rel, whole_rel = (expanded_rel(scales, fit.random_rel, fit.dof or inf) for scales in kinds)
    responsivity = fit.responsivity_dn_s_cd_m2, own_rel, whole_rel
    made = calibration.provenance
    measured, frames = made.measured, frozenset(made.frames_sha256)
    return HistoryPoint(
        source, measured, responsivity, calibration.dark, meter, weight, k if k > 0 else None, frames_sha256=frames
    )


def _verification_point(source: str, verification: Verification, plane: VerifiedPlane) -> HistoryPoint:
    drift, responsivity = plane.drift, None
    if drift is not None:
        responsivity = drift.responsivity_dn_s_cd_m2, drift.responsivity_own_rel, drift.responsivity_expanded_rel
    measured, meter, verdict = verification.measured, verification.meter, verification.verdict
    frames = frozenset(verification.frames_sha256)
    return HistoryPoint(source, measured, responsivity, plane.dark, meter, verdict=verdict, frames_sha256=frames)
