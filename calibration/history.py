"""The history of cameras: their calibrations and verifications over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from math import hypot, sqrt
from typing import Literal

from ..frame import PLANES, CameraIdentity
from .model import Calibration
from .observations import CameraState
from .setup import LensIdentity
from .store import AnyCalibration
from .uncertainty import expanded_half_width
from .verification import Verdict, Verification, VerifiedPlane


@dataclass(frozen=True)
class HistoryPoint:
    """A camera at one time.

    Parameters
    ----------
    kind : {'calibration', 'verification'}
        What measured it.
    source : str
        The file.
    measured : datetime
        Time of the last meter reading.
    responsivity_dn_s_cd_m2 : float or None
        R; of a verification, that of its calibration with the drift it found; None if it found none of this plane.
    random_half_width_rel, half_width_95_rel : float or None
        Relative half width of its 95 % interval without the meter's scale, which points by the same meter share, and
        with it.
    weight : float or None
        Of the plane in the luminance; None for a monochrome sensor, or a verification.
    dark_offset_dn, dark_offset_half_width_dn : float
        Darkness at zero exposure, and its 95 % half width.
    dark_rate_dn_s, dark_rate_half_width_dn_s : float or None
        Its growth per second; None if dark frames have one exposure only.
    k_dn_per_e : float or None
        Overall system gain K; None for a verification, or if it is not known.
    meter : str
        Model and serial number of the meter.
    verdict : {'valid', 'doubtful', 'not valid'} or None
        Of a verification.
    """

    kind: Literal["calibration", "verification"]
    source: str
    measured: datetime
    responsivity_dn_s_cd_m2: float | None
    random_half_width_rel: float | None
    half_width_95_rel: float | None
    weight: float | None
    dark_offset_dn: float
    dark_offset_half_width_dn: float
    dark_rate_dn_s: float | None
    dark_rate_half_width_dn_s: float | None
    k_dn_per_e: float | None
    meter: str
    verdict: Verdict | None


@dataclass(frozen=True)
class CameraHistory:
    """What is known of one camera, or one plane of it, with one lens and setting.

    Parameters
    ----------
    camera : CameraIdentity
        The camera.
    lens : LensIdentity
        The lens.
    gain_db : float
        The gain.
    pixel_format : str
        The pixel format.
    plane : str or None
        The colour plane.
    points : tuple of HistoryPoint
        By time, the earliest first.
    """

    camera: CameraIdentity
    lens: LensIdentity
    gain_db: float
    pixel_format: str
    plane: str | None
    points: tuple[HistoryPoint, ...]

    @property
    def change_rel(self) -> tuple[float, float] | None:
        """Change of the responsivity from the first to the last point, and its 95 % half width; None for one point.

        The scale of the meter cancels if both points have the same.
        """
        known = [
            (p.responsivity_dn_s_cd_m2, p.random_half_width_rel, p.half_width_95_rel, p.meter)
            for p in self.points
            if p.responsivity_dn_s_cd_m2 and p.random_half_width_rel is not None and p.half_width_95_rel is not None
        ]
        if len(known) < 2:
            return None
        (before, *of_first, first_meter), (after, *of_last, last_meter) = known[0], known[-1]
        which = 0 if first_meter == last_meter else 1
        return after / before - 1, hypot(of_first[which], of_last[which])


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
    found = [one for source, c in calibrations.items() for one in _of_any(source, c)]
    found += [
        (replace(v.state, plane=plane.plane), v.lens, _of_verification(source, v, plane))
        for source, v in verifications.items()
        for plane in v.planes
    ]
    for state, lens, point in found:
        order = PLANES.index(state.plane) if state.plane else -1
        key = (str(state.camera), repr(lens), f"{state.gain_db:g}", state.pixel_format, order)
        groups.setdefault(key, (state, lens, []))[2].append(point)
    return tuple(
        CameraHistory(
            camera=state.camera,
            lens=lens,
            gain_db=state.gain_db,
            pixel_format=state.pixel_format,
            plane=state.plane,
            points=tuple(sorted(points, key=lambda point: point.measured)),
        )
        for _, (state, lens, points) in sorted(groups.items(), key=lambda item: item[0])
    )


def _of_any(source: str, calibration: AnyCalibration) -> list[tuple[CameraState, LensIdentity, HistoryPoint]]:
    if isinstance(calibration, Calibration):
        return [(calibration.state, calibration.lens, _of_calibration(source, calibration, None))]
    return [
        (plane.state, plane.lens, _of_calibration(source, plane, weight))
        for plane, weight in zip(calibration.planes, calibration.weights, strict=True)
    ]


def _of_calibration(source: str, calibration: Calibration, weight: float | None) -> HistoryPoint:
    fit, meter = calibration.responsivity, calibration.meter_scale
    k = calibration.noise.k_dn_per_e
    one_exposure = len(calibration.dark.exposures_s) == 1
    return HistoryPoint(
        kind="calibration",
        source=source,
        measured=calibration.provenance.measured,
        responsivity_dn_s_cd_m2=fit.responsivity_dn_s_cd_m2,
        random_half_width_rel=expanded_half_width(0.0, fit.random_rel),
        half_width_95_rel=expanded_half_width(meter.half_width_rel, fit.random_rel),
        weight=weight,
        dark_offset_dn=calibration.dark.offset_dn,
        dark_offset_half_width_dn=_half_width(calibration.dark.offset_variance_dn2),
        dark_rate_dn_s=None if one_exposure else calibration.dark.rate_dn_s,
        dark_rate_half_width_dn_s=None if one_exposure else _half_width(calibration.dark.rate_variance_dn2_s2),
        k_dn_per_e=k if k > 0 else None,
        meter=f"{meter.meter.model} {meter.meter.serial}",
        verdict=None,
    )


def _of_verification(source: str, verification: Verification, plane: VerifiedPlane) -> HistoryPoint:
    dark, drift = plane.dark, plane.drift
    one_exposure = len(dark.exposures_s) == 1
    return HistoryPoint(
        kind="verification",
        source=source,
        measured=verification.measured,
        responsivity_dn_s_cd_m2=None if drift is None else drift.responsivity_dn_s_cd_m2,
        random_half_width_rel=None if drift is None else drift.half_width_95_rel,
        half_width_95_rel=None if drift is None else drift.responsivity_half_width_95_rel,
        weight=None,
        dark_offset_dn=dark.offset_dn,
        dark_offset_half_width_dn=_half_width(dark.offset_variance_dn2),
        dark_rate_dn_s=None if one_exposure else dark.rate_dn_s,
        dark_rate_half_width_dn_s=None if one_exposure else _half_width(dark.rate_variance_dn2_s2),
        k_dn_per_e=None,
        meter=f"{verification.meter.model} {verification.meter.serial}",
        verdict=verification.verdict,
    )


def _half_width(variance: float) -> float:
    return expanded_half_width(0.0, sqrt(variance))
