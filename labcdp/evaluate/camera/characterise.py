"""Characterisation of a camera after EMVA 1288 from a recorded session."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from ...calibration.emva.assemble import Transfer, assemble, with_findings, with_frame_changes
from ...calibration.emva.quantities import (
    combined,
    dark_pattern_variances,
    dsnu_e,
    dsnu_parts,
    fit_dark_current,
    flat_variance,
    rounding_of_spread_dn,
    spread,
)
from ...calibration.emva.result import Characterisation, SaturationLimit, SeriesPoint
from ...calibration.emva.transfer import Saturation, points_to_fit, system_gain
from ...calibration.fitting.full_well import SAFE_SHARE, plateau_dn
from ...calibration.frames.measure import MeasuredFrames
from ...calibration.frames.observations import CameraState, DarkObservation
from ...calibration.frames.observe import dark_observation
from ...calibration.setup import corrected
from ...core.clock import exposure_text
from ...core.errors import CalibrationError
from ...core.quantity import Quantity
from ...core.reading import Reading
from ...core.result import Finding, unique, warning
from ...session import Session
from ..bench.corrections import natural_vignetting
from .frames import (
    SessionFrames,
    SessionPoint,
    measure_session,
    patch_deviations,
    photometric_responsivity,
    quantum_efficiency_estimate,
    unsaturated,
)
from .general import GeneralCharacterisation, dark_noise, model_findings, session_model

#: Dark signal farther away in temperature than this, in kelvin, is reported.
_SAME_TEMPERATURE_K = 2.0
#: From this share on a point is saturated altogether.
_SATURATED_SHARE = 0.99
#: Share of a full well from which a point is full.
_FULL_SHARE = 0.98
#: Definition of saturation used.
_SATURATED = "saturation capacity, mean of the patches that are completely saturated"
_BRIGHTEST = "brightest unsaturated patch"
#: Range of signals, as shares of saturation, for PRNU; below, noise dominates.
_PRNU_SHARES = (0.1, 0.9)


def characterise_session(
    session: Session, report: Callable[[int, int], None] = lambda _done, _total: None
) -> Characterisation:
    """Characterise the camera of a recorded session.

    Dark frames give read noise, dark current and DSNU; all patches at all exposures together give photon transfer,
    their brightest unsaturated exposures PRNU, the exposures of each patch linearity, the readings of the meter the
    responsivity. The photons are not known: the quantum efficiency is an estimate from the data of the lens.

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
        If there are too few frames or exposures, the camera changes, or the noise does not grow with the signal.
    InputError
        If a patch lies outside the image.
    """
    return _linear(session, measure_session(session, report))


def characterise_camera(
    session: Session, report: Callable[[int, int], None] = lambda _done, _total: None
) -> Characterisation | GeneralCharacterisation:
    """Characterise the camera of a session after EMVA 1288 Linear, or General where values are merged of captures.

    Parameters and errors are those of `characterise_session`; without meter readings there is no General.
    """
    measured = measure_session(session, report)
    return _general(session, measured) if measured.state.has_hand_overs else _linear(session, measured)


def _series(
    measured: SessionFrames,
) -> tuple[list[SessionPoint], dict[float, MeasuredFrames], list[DarkObservation], list[Finding]]:
    """Return points in rising order of signal, dark frames by exposure with their observations, and findings."""
    reference, findings = _reference(measured)
    darks = [dark_observation(level) for level in reference.values()]
    missing = sorted({level.exposure_s for level in measured.patches} - set(reference))
    if missing:
        findings.append(warning("no-dark-frames-at", exposures_s=missing))
    usable = [level for level in measured.patches if level.exposure_s in reference]
    if not usable:
        raise CalibrationError("the session has no light and dark frames at the same exposure: record both")
    changed = with_frame_changes([_point(level, reference[level.exposure_s]) for level in usable], darks)
    return sorted(changed, key=lambda point: point.net_dn), reference, darks, findings


def _general(session: Session, measured: SessionFrames) -> GeneralCharacterisation:
    """Characterise after EMVA 1288 General alone."""
    points, _, darks, findings = _series(measured)
    state, noise = measured.state, dark_noise(darks)
    vignetting = natural_vignetting(session.configuration, state)
    model = session_model(points, _luminances(session), vignetting, noise.value)
    dark = fit_dark_current(darks)
    return GeneralCharacterisation(
        source=session.configuration.name,
        camera=_camera(state),
        simulated=state.camera.simulated,
        state=state,
        temperature_c=dark.model.temperature_c,
        black_level_dn=dark.black_level_dn,
        dark_noise_dn=noise,
        model=model,
        darks=tuple(darks),
        findings=unique([*findings, *model_findings(model)]),
    )


def _camera(state: CameraState) -> str:
    return str(state.camera) + ("" if state.plane is None else f", plane {state.plane}")


def _luminances(session: Session) -> dict[str, list[Reading]]:
    """Return readings of luminance by patch, with the correction of the meter's certificate."""
    readings: dict[str, list[Reading]] = {}
    for record in session.readings():
        if record.reading.unit != "%":
            luminance = corrected(record.reading, session.configuration.meter.certificate)
            readings.setdefault(record.patch, []).append(luminance)
    return readings


def _linear(session: Session, measured: SessionFrames) -> Characterisation:
    """Characterise after EMVA 1288 Linear, with General beside it where there are readings."""
    state = measured.state
    in_order, reference, darks, findings = _series(measured)
    points = _full_marked(in_order)
    dark = fit_dark_current(darks)
    transfer = _transfer(points, dark.black_level_dn.value, state.bit_depth, state.saturation_dn)
    quantities, more = _nonuniformity(reference, points, transfer)
    sensitivity, meter_findings = _sensitivity(session, points, transfer, measured)
    quantities |= sensitivity
    every = fit_dark_current([dark_observation(level) for level in measured.darks])
    quantities["doubling_temperature_c"] = every.doubling_temperature_c()
    origin = {
        "source": session.configuration.name,
        "camera": _camera(state),
        "simulated": state.camera.simulated,
        "bits": state.bit_depth,
        "image_shape": state.image_shape,
        "gain_db": state.gain_db,
        "temperature_c": dark.model.temperature_c,
    }
    characterisation = with_findings(
        assemble(origin, points, darks, transfer, quantities), [*findings, *more, *meter_findings]
    )
    with suppress(CalibrationError):
        vignetting = natural_vignetting(session.configuration, state)
        model = session_model(points, _luminances(session), vignetting, characterisation.dark_noise_dn.value)
        characterisation = replace(characterisation, general=model)
    return characterisation


def _reference(measured: SessionFrames) -> tuple[dict[float, MeasuredFrames], list[Finding]]:
    """Dark frames by exposure, those nearest to the temperature in the light; and findings."""
    known = [level.temperature_c for level in measured.patches if level.temperature_c is not None]
    light_c = float(np.median(known)) if known else None

    def distance_k(level: MeasuredFrames) -> float:
        return inf if light_c is None or level.temperature_c is None else abs(level.temperature_c - light_c)

    exposures_s = dict.fromkeys(level.exposure_s for level in measured.darks)
    levels_by_exposure = {t: [level for level in measured.darks if level.exposure_s == t] for t in exposures_s}
    chosen = {t: min(levels, key=distance_k) for t, levels in levels_by_exposure.items()}
    findings = list(measured.findings)
    farthest = max(chosen.values(), key=distance_k)
    if light_c is not None and _SAME_TEMPERATURE_K < distance_k(farthest) < inf:
        temperatures = {"dark_c": farthest.temperature_c, "light_c": light_c}
        findings.append(warning("dark-frames-of-other-temperature", exposure_s=farthest.exposure_s, **temperatures))
    return chosen, findings


def _point(level: MeasuredFrames, dark: MeasuredFrames) -> SessionPoint:
    assert level.region is not None
    # The mean of dark signal is that of the patch's pixels, with their uncertainty.
    mean_dn = float(dark.image_dn[level.window][level.used].mean(dtype=float))
    below = replace(dark.level, mean_dn=mean_dn, n_pixels=level.n_pixels)
    return SessionPoint(level.region.name, level.exposure_s, None, level, below)


def _full_marked(points: Sequence[SessionPoint]) -> list[SessionPoint]:
    """Mark points of pixels that are full below the stated saturation as saturated, and leave out those near it."""
    usable = [point for point in unsaturated(points) if point.net_dn > 0]
    shortest = {p.label: p for p in sorted(usable, key=lambda p: -p.exposure_s)}
    promised = [shortest[p.label].net_dn * p.exposure_s / shortest[p.label].exposure_s for p in usable]
    level = plateau_dn([p.net_dn for p in usable], promised, promised)
    if level is None:
        return list(points)
    full = _FULL_SHARE * level
    return [
        replace(p, light=replace(p.light, saturated_share=1.0)) if p.net_dn >= full else p
        for p in points
        if not SAFE_SHARE * level < p.net_dn < full
    ]


def _transfer(points: Sequence[SeriesPoint], black_level_dn: float, bits: int, saturation_dn: float) -> Transfer:
    """Saturation by patches that are completely saturated, and K over all others, weighted.

    A full pixel holds electrons of light and of dark signal: its DN are counted from the black level.

    The points of a session lie far apart and differ in their pixels: weights make the most of them, where the standard
    with its dense series has none.
    """
    clear = unsaturated(points)
    if not clear:
        raise CalibrationError("all patches are saturated at all exposures: record shorter exposures")
    full = [point for point in points if point.light.saturated_share >= _SATURATED_SHARE]
    full_dn = [point.light.mean_dn for point in full]
    fitted = points_to_fit(clear, min([saturation_dn, *full_dn]) - clear[0].dark.mean_dn)
    last = clear[-1]
    saturation = Saturation(points.index(last), "not reached", last.net_dn, last.net_uncertainty_dn, _BRIGHTEST)
    if full:
        level = float(np.mean(full_dn))
        limit: SaturationLimit = "converter" if level > 2**bits - 2 else "full well"
        # Rounding hides half a DN; patches at the full well scatter.
        u = max(float(np.std(full_dn, ddof=1)) if len(full) > 1 else 0.0, 0.5)
        saturation = Saturation(points.index(full[-1]), limit, level - black_level_dn, u, _SATURATED)
    return Transfer(saturation, fitted, system_gain(fitted, weighted=True))


def _sensitivity(
    session: Session, points: Sequence[SessionPoint], transfer: Transfer, measured: SessionFrames
) -> tuple[dict[str, Any], list[Finding]]:
    configuration, state, readings = session.configuration, measured.state, _luminances(session)
    r, findings = photometric_responsivity(measured, readings, configuration)
    efficiency = None if r is None else quantum_efficiency_estimate(r, transfer.k, configuration, state)
    line = patch_deviations(unsaturated(points), transfer.saturation.net_dn)
    return {"responsivity": r, "quantum_efficiency": efficiency, **(line.errors() if line else {})}, findings


def _nonuniformity(
    darks: Mapping[float, MeasuredFrames], points: Sequence[SessionPoint], transfer: Transfer
) -> tuple[dict[str, Any], list[Finding]]:
    k, longest_s = transfer.k, max(darks)
    variance, *growth = dark_pattern_variances([*darks.values()], [*darks])
    note = f"at {exposure_text(longest_s)}, the only exposure of the dark frames"
    values: dict[str, Any] = {"spatial": (darks[longest_s],)}
    if growth:
        # Rounding changes each exposure's pattern by some part of its step, 1 DN.
        rounding_e_s = rounding_of_spread_dn(darks[longest_s]) / k.value / longest_s
        values["dsnu_e_s"], note = dsnu_e(growth[0].total, k, rounding_e_s, unit="e-/s"), "at zero exposure"
    values["prnu_rel"] = _prnu(points, darks, transfer.saturation.net_dn)
    low, high = _PRNU_SHARES
    unknown = values["prnu_rel"] is None
    findings = [warning("prnu-unknown", lowest_share=low, highest_share=high)] if unknown else []
    return values | dsnu_parts(variance, k, darks[min(darks)], note), findings


def _prnu(
    points: Sequence[SessionPoint], darks: Mapping[float, MeasuredFrames], saturation_net_dn: float
) -> Quantity | None:
    """PRNU of the patches, each at its brightest exposure below saturation: other exposures show the same pixels."""
    low, high = (share * saturation_net_dn for share in _PRNU_SHARES)
    chosen = {
        point.label: point
        for point in points
        if low <= point.net_dn <= high and point.light.saturated_share == 0 and point.light.n_pixels >= 4 * 6
    }
    estimates = []
    for point in chosen.values():
        dark, s = darks[point.exposure_s], point.light
        net = (s.image_dn.astype(float) - dark.image_dn[s.window])[s.used]
        noise = s.temporal_variance_dn2 / s.n_frames + dark.temporal_variance_dn2 / dark.n_frames
        rows, columns = np.nonzero(s.used)
        net_variance = flat_variance(net, rows, columns, noise)
        estimates.append(Quantity(net_variance.value / point.net_dn**2, net_variance.u / point.net_dn**2))
    if not estimates:
        return None
    note = f"within {len(estimates)} patches, slow gradients subtracted; includes the patches' own texture"
    return spread(combined(estimates), 1.0, "1", note)
