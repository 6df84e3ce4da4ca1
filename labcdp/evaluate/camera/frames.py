"""Measurements in the frames of a session: dark signal, linearity, responsivity and QE of its camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, inf, sqrt
from typing import TypeVar

import numpy as np

from ...calibration import CameraState, fit
from ...calibration.emva.result import SeriesPoint, columns
from ...calibration.emva.transfer import Deviations, in_range
from ...calibration.frames.measure import MeasuredFrames, measure_planes
from ...calibration.frames.observe import dark_observation, patch_observations
from ...calibration.frames.statistics import MAX_CLIPPED_SHARE
from ...calibration.uncertainty import expanded_rel
from ...core.clock import exposure_text
from ...core.errors import CalibrationError, InputError
from ...core.quantity import Quantity
from ...core.reading import Reading
from ...core.result import Finding, info
from ...session import FrameRecord, Session, SessionConfiguration
from ..bench.calibrate import session_setup
from ..bench.corrections import natural_vignetting, photons_per_cd_m2_s, pixel_area_m2
from ..bench.recorded import by_exposure, by_patch, frame_loader, planes_of

_Point = TypeVar("_Point", bound=SeriesPoint)
#: Colour plane of a Bayer sensor that is characterised: of the planes the one with the most light from any source.
COLOUR_PLANE = "Gr"
#: Dark frames of one exposure whose temperatures differ by more, in kelvin, are taken apart.
_SAME_TEMPERATURE_K = 1.0


@dataclass(frozen=True, eq=False)
class SessionFrames:
    """All frames of a session, measured.

    Parameters
    ----------
    state : CameraState
        Camera and settings, of the colour plane if there is one.
    darks : list of MeasuredFrames
        In rising order of exposure, then of temperature.
    patches : list of MeasuredFrames
        By region, in rising order of exposure.
    findings : tuple of Finding
        Findings about frames that were left out.
    """

    state: CameraState
    darks: Sequence[MeasuredFrames]
    patches: Sequence[MeasuredFrames]
    findings: tuple[Finding, ...]


def measure_session(session: Session, report: Callable[[int, int], None]) -> SessionFrames:
    """Measure the frames of a session, one at a time.

    Parameters
    ----------
    session : Session
        To read.
    report : callable
        Called with the number of frames read, and of all frames.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If there are no dark frames, fewer than two frames of all that is alike, or the camera or its settings change.
    InputError
        If a patch lies outside the image.
    """
    records, findings = _frames_of_one_gain(session.frames())
    load = frame_loader(report, len(records))
    plane = None if planes_of(session) == (None,) else COLOUR_PLANE
    patches = [patch.region() for patch in session.configuration.target.patches]
    darks = [
        measure_planes(load(session, group), (plane,))[plane][0]
        for exposure in by_exposure(records, "dark").values()
        for group in _by_temperature(exposure)
        if len(group) > 1
    ]
    if not darks:
        raise CalibrationError(
            "the session has no exposure with at least 2 dark frames: cover the lens and resume the acquisition"
        )
    levels = []
    for exposure in by_exposure(records, "light").values():
        for shown, group in by_patch(exposure).items():
            if len(group) > 1:
                seen = [patch for patch in patches if shown in (None, patch.name)]
                levels += measure_planes(load(session, group), (plane,), seen)[plane]
    for level in (*darks[1:], *levels):
        darks[0].state.require(
            level.state, "the dark frames", f"the set of frames at {exposure_text(level.exposure_s)}"
        )
    return SessionFrames(darks[0].state, darks, levels, tuple(findings))


def _frames_of_one_gain(records: Sequence[FrameRecord]) -> tuple[list[FrameRecord], list[Finding]]:
    """Frames of the gain that has the most: all quantities belong to one gain."""
    gains = Counter(record.gain_db for record in records)
    if not gains:
        raise CalibrationError("the session has no frames: start the acquisition")
    gain_db, _ = gains.most_common(1)[0]
    others = sorted(gains.keys() - {gain_db})
    kept = [record for record in records if record.gain_db == gain_db]
    return kept, [info("other-gains-left-out", gain_db=gain_db, left_out_db=others)] if others else []


def _by_temperature(records: Sequence[FrameRecord]) -> list[list[FrameRecord]]:
    """Split frames where the temperature has changed; those without a temperature come together."""
    groups: dict[float, list[FrameRecord]] = {}
    for record in sorted(records, key=lambda frame: (_temperature(frame), frame.sequence)):
        temperature, first = _temperature(record), next(reversed(groups), -inf)
        near = temperature <= first + _SAME_TEMPERATURE_K
        groups.setdefault(first if near else temperature, []).append(record)
    return [*groups.values()]


def _temperature(record: FrameRecord) -> float:
    """Temperature of the device; infinite if it is not known."""
    value = record.metadata.get("temperature_c")
    return inf if value is None else float(value)


#: Half widths of what is engraved on a lens: the f-number, and its transmittance. Judged.
_F_NUMBER_REL, _TRANSMITTANCE_REL = 0.05, 0.1


@dataclass(frozen=True)
class SessionPoint(SeriesPoint):
    """A point of a session's series: a patch at one exposure, with its measured luminance."""

    light: MeasuredFrames


def unsaturated(points: Sequence[_Point]) -> list[_Point]:
    """Points whose clipped values do not matter."""
    return [point for point in points if point.light.saturated_share <= MAX_CLIPPED_SHARE]


def patch_deviations(points: Sequence[SeriesPoint], saturation_net_dn: float) -> Deviations | None:
    """Compare each patch with its own line over the exposure; None if no patch has two exposures.

    The signal of each patch from 5 to 95 % of saturation, at two exposures at least, is compared with the line y = b t
    through the dark signal that minimises the relative deviations. The exposures of a session are few, so the line has
    no intercept, unlike the one of the standard.

    Parameters
    ----------
    points : sequence of SeriesPoint
        Saturated ones are left out.
    saturation_net_dn : float
        Signal above dark signal at saturation.
    """
    patches: dict[str, list[SeriesPoint]] = {}
    for point in unsaturated(in_range(points, saturation_net_dn)):
        patches.setdefault(point.label, []).append(point)
    several = [points_of_patch for points_of_patch in patches.values() if len(points_of_patch) > 1]
    rows = []
    for points_of_patch in several:
        y, t, u = columns(points_of_patch, "net_dn", "exposure_s", "net_uncertainty_dn")
        noise = u / y
        weights = (t / y) ** 2 / np.sum((t / y) ** 2)
        slope = float(np.sum(t / y) / np.sum((t / y) ** 2))
        left = np.sqrt(noise**2 * (1 - 2 * weights) + np.sum((weights * noise) ** 2))
        rows.append([y, y / (slope * t) - 1, left])
    note = f"over the exposure, {len(several)} patches; u by noise, black level and lamp"
    if not rows:
        return None
    net, deviation, u = np.concatenate(rows, axis=1)
    return Deviations(net, deviation, u, note)


def photometric_responsivity(
    measured: SessionFrames,
    readings: Mapping[str, Sequence[Reading]],
    configuration: SessionConfiguration,
) -> tuple[Quantity | None, list[Finding]]:
    """Responsivity R on the optical axis by the calibration that the frames and readings of a session give.

    Parameters
    ----------
    measured : SessionFrames
        Of the session.
    readings : mapping of str to sequence of Reading
        Luminances by the meter, by patch, with the correction of its certificate.
    configuration : SessionConfiguration
        For lens, pixel pitch and meter; vignetting is cos^4 of the off-axis angle.

    Returns
    -------
    Quantity or None
        In DN / (cd m^-2 s), with the meter's scale error in its uncertainty; None without readings, or if they give no
        calibration.
    list of Finding
        Why there is none.
    """
    if not readings:
        return None, []
    vignetting = natural_vignetting(configuration, measured.state)
    seen = patch_observations(measured.patches, vignetting)
    observations = [observation for observation in seen if observation.patch in readings]
    darks = [dark_observation(dark) for dark in measured.darks]
    try:
        calibration = fit(observations, darks, readings, session_setup(configuration, "0" * 64))
    except CalibrationError as error:
        return None, [info("no-responsivity", reason=f"{error}")]
    responsivity, scale = calibration.responsivity, calibration.meter_scale
    r = responsivity.responsivity_dn_s_cd_m2
    u = r * hypot(responsivity.random_rel, scale.common_rel)
    expanded = r * expanded_rel([scale], responsivity.random_rel, responsivity.dof or inf)
    note = f"from the calibration with the meter over {len(calibration.residuals)} patches, on the optical axis"
    return Quantity(r, u, "DN/(cd m^-2 s)", note, coverage=expanded / u), []


def quantum_efficiency_estimate(
    responsivity: Quantity, k: Quantity, configuration: SessionConfiguration, state: CameraState
) -> Quantity | None:
    """Estimate QE from lens data: electrons over photons per pixel, cd/m^2 and second.

    Returns
    -------
    Quantity or None
        None for a spectrum that is not known. QE is a mean over the spectrum. Half widths of 5 % of the f-number and
        10 % of the transmittance are assumed.
    """
    lens = configuration.lens
    transmittance = 1.0 if lens.transmittance is None else lens.transmittance
    area_m2 = pixel_area_m2(configuration.camera.pixel_pitch_m, state.readout)
    try:
        photons = photons_per_cd_m2_s(configuration.source.spectrum, lens.f_number, transmittance, area_m2)
    except InputError:
        return None
    expected_photons = Quantity(photons, photons * hypot(2 * _F_NUMBER_REL, _TRANSMITTANCE_REL) / sqrt(3), "photons")
    transmittance_text = (
        "taken as 1, so that it is part of this value" if lens.transmittance is None else f"{transmittance:g}"
    )
    note = (
        f"estimated from lens data, no photons were measured: f/{lens.f_number:g}, transmittance {transmittance_text}, "
        f"mean over {configuration.source.spectrum}"
    )
    return responsivity.over(expected_photons, "DN/photon").over(k, "1", note)
