"""Characterisation of a camera after EMVA 1288, from a data set or from a recorded session."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import hypot, inf, sqrt
from os import PathLike

import numpy as np

from ..calibration.emva import characterise_data_set
from ..calibration.emva.assemble import Nonuniformity, Origin, Stimulus, Transfer, assemble
from ..calibration.emva.dark_current import doubling_temperature, fit_darkness
from ..calibration.emva.nonuniformity import (
    DarkPattern,
    Estimate,
    combined,
    dark_pattern,
    dsnu_e,
    flat_variance,
    prnu_rel,
    spatial_variance,
    widened_by_rounding,
)
from ..calibration.emva.photon_transfer import points_to_fit, system_gain
from ..calibration.emva.result import Characterisation, DarkPoint, Quantity, SaturationLimit, SeriesPoint, SpatialImages
from ..calibration.emva.saturation import Saturation
from ..errors import CalibrationError
from ..session import Session
from .characterise_frames import DarkLevel, PatchLevel, SessionFrames, measure_frames
from .characterise_light import (
    CLIPPED_SHARE,
    patch_deviations,
    patch_linearity,
    photometric_responsivity,
    quantum_efficiency_estimate,
)

#: Darkness farther away in temperature than this, in kelvin, is told.
_SAME_TEMPERATURE_K = 2.0
#: From this share on a point is saturated altogether.
_SATURATED_SHARE = 0.99
#: What is taken for saturation.
_SATURATED = "saturation capacity, mean of the patches that are saturated altogether"
_BRIGHTEST = "brightest unsaturated patch"
#: Share of saturation between which a patch tells PRNU: below, noise hides it.
_PRNU_SHARES = (0.1, 0.9)


def characterise_index(
    path: str | PathLike[str], report: Callable[[int, int], None] = lambda _done, _total: None
) -> Characterisation:
    """Characterise a camera from the index of a data set; see `labcdp.calibration.emva.characterise_data_set`."""
    return characterise_data_set(path, report)


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
    measured = measure_frames(session, report)
    state = measured.state
    reference, flags = _reference(measured)
    darkness = {level.exposure_s: level for level in reference}
    missing = sorted({level.exposure_s for level in measured.patches} - set(darkness))
    if missing:
        listed = ", ".join(f"{value:g} s" for value in missing)
        flags.append(f"there are no dark frames at {listed}: the light frames there were left out")
    usable = [level for level in measured.patches if level.exposure_s in darkness]
    pairs = sorted(
        ((_point(level, darkness[level.exposure_s]), level) for level in usable), key=lambda pair: pair[0].net_dn
    )
    points = [point for point, _ in pairs]
    if not points:
        raise CalibrationError("the session has no light frames with darkness at the same exposure: record both alike")
    darks = [_dark_point(level) for level in reference]
    transfer = _transfer(points, fit_darkness(darks).mean.intercept, state.bit_depth, state.saturation_dn)
    stimulus = _stimulus(session, pairs, transfer, measured)
    spatial, more = _nonuniformity(reference, pairs, darkness, transfer)
    temperatures = [level.temperature_c for level in reference if level.temperature_c is not None]
    origin = Origin(
        source=session.configuration.name,
        camera=str(state.camera) + ("" if state.plane is None else f", plane {state.plane}"),
        simulated=state.camera.simulated,
        bits=state.bit_depth,
        image_shape=state.image_shape,
        gain_db=state.gain_db,
        temperature_c=float(np.mean(temperatures)) if temperatures else None,
        multiple=min(level.statistics.multiple for level in measured.patches),
    )
    doubling = doubling_temperature([_dark_point(level) for level in measured.darks])
    return assemble(origin, points, darks, doubling, transfer, stimulus, spatial, [*flags, *more])


def _reference(measured: SessionFrames) -> tuple[list[DarkLevel], list[str]]:
    """One set of dark frames for each exposure, those nearest to the temperature in the light; and what to mind."""
    known = [level.temperature_c for level in measured.patches if level.temperature_c is not None]
    light_c = float(np.median(known)) if known else None
    chosen: dict[float, DarkLevel] = {}

    def distance_k(level: DarkLevel) -> float:
        return inf if light_c is None or level.temperature_c is None else abs(level.temperature_c - light_c)

    for level in measured.darks:
        best = chosen.get(level.exposure_s)
        if best is None or distance_k(level) < distance_k(best):
            chosen[level.exposure_s] = level
    flags = list(measured.flags)
    farthest = max(chosen.values(), key=distance_k)
    if light_c is not None and _SAME_TEMPERATURE_K < distance_k(farthest) < inf:
        flags.append(
            f"the dark frames at {farthest.exposure_s:g} s were taken at {farthest.temperature_c:.1f} degC, the light "
            f"frames at {light_c:.1f} degC: darkness that is too dark or too bright falsifies all values; record both "
            "when the camera is warm"
        )
    return list(chosen.values()), flags


def _dark_point(level: DarkLevel) -> DarkPoint:
    s = level.statistics
    return DarkPoint(
        level.exposure_s,
        s.mean_dn,
        s.temporal_variance_dn2,
        s.n_pixels,
        s.n_frames,
        level.temperature_c,
        s.spatial_variance_dn2,
    )


def _point(level: PatchLevel, dark: DarkLevel) -> SeriesPoint:
    light, darkness = level.statistics, dark.statistics
    return SeriesPoint(
        label=level.region.name,
        exposure_s=level.exposure_s,
        photons=None,
        mean_dn=light.mean_dn,
        variance_dn2=light.temporal_variance_dn2,
        dark_mean_dn=float(level.region.select(dark.mean_dn).mean()),
        dark_variance_dn2=darkness.temporal_variance_dn2,
        n_pixels=light.n_pixels,
        n_frames=light.n_frames,
        # The mean of darkness is that of the patch's pixels, so it is known no better than they tell.
        dark_n_pixels=light.n_pixels,
        dark_n_frames=darkness.n_frames,
        saturated_share=light.largest_share,
        dark_black_share=darkness.black_share,
    )


def _transfer(points: Sequence[SeriesPoint], black_level_dn: float, bits: int, saturation_dn: float) -> Transfer:
    """Saturation by patches that are saturated altogether, and K over all others, weighted.

    A full pixel holds electrons of light and of darkness: its DN are counted from the black level.

    The points of a session lie far apart and differ in their pixels: weights make the most of them, where the standard
    with its dense series has none.
    """
    clear = [point for point in points if point.saturated_share <= CLIPPED_SHARE]
    if not clear:
        raise CalibrationError("all patches are saturated at all exposures: record shorter exposures")
    fitted = points_to_fit(clear, saturation_dn - clear[0].dark_mean_dn)
    slope = system_gain(fitted, weighted=True)
    full = [point for point in points if point.saturated_share >= _SATURATED_SHARE]
    limit: SaturationLimit = "not reached"
    if not full:
        last = points.index(clear[-1])
        return Transfer(
            Saturation(last, limit), clear[-1].net_dn, clear[-1].net_uncertainty_dn, tuple(fitted), slope, _BRIGHTEST
        )
    end = 2**bits - 1
    level = float(np.mean([point.mean_dn for point in full]))
    limit = "converter" if level > end - 1 else "full well"
    # Rounding hides half a DN; patches at the full well scatter.
    spread = float(np.std([point.mean_dn for point in full], ddof=1)) if len(full) > 1 else 0.0
    saturation = Saturation(points.index(full[-1]), limit)
    return Transfer(saturation, level - black_level_dn, max(spread, 0.5), tuple(fitted), slope, _SATURATED)


def _stimulus(
    session: Session, pairs: Sequence[tuple[SeriesPoint, PatchLevel]], transfer: Transfer, measured: SessionFrames
) -> Stimulus:
    readings: dict[str, list[float]] = {}
    for record in session.readings():
        if record.reading.unit != "%":
            readings.setdefault(record.patch, []).append(record.reading.luminance_cd_m2)
    usable = [pair for pair in pairs if pair[0].saturated_share <= CLIPPED_SHARE]
    configuration = session.configuration
    r = photometric_responsivity(usable, readings, configuration, measured.state)
    qe = None if r is None else quantum_efficiency_estimate(r, transfer.k, configuration)
    return Stimulus(r, qe, patch_linearity(patch_deviations([point for point, _ in usable], transfer.net_dn)))


def _nonuniformity(
    darks: Sequence[DarkLevel],
    pairs: Sequence[tuple[SeriesPoint, PatchLevel]],
    darkness: Mapping[float, DarkLevel],
    transfer: Transfer,
) -> tuple[Nonuniformity, list[str]]:
    k, flags = transfer.k, []
    dsnu_e_s = None
    if len(darks) > 1:
        pattern = dark_pattern(
            [level.mean_dn for level in darks],
            [level.exposure_s for level in darks],
            [level.noise for level in darks],
        )
        variance = spatial_variance(pattern.offset_dn, pattern.offset_noise)
        dsnu_e_s = _rate_spread(pattern, darks, k)
        note = "at zero exposure"
    else:
        variance = spatial_variance(darks[0].mean_dn, darks[0].noise)
        note = f"at {darks[0].exposure_s:g} s, the only exposure of darkness"
    prnu = _prnu(pairs, darkness, transfer.net_dn)
    if prnu is None:
        flags.append(
            f"no patch lies between {_PRNU_SHARES[0]:.0%} and {_PRNU_SHARES[1]:.0%} of saturation, so PRNU is not "
            "known: record longer exposures or more light"
        )
    brightest = max(darks, key=lambda level: level.exposure_s)
    images = SpatialImages(
        brightest.mean_dn,
        None,
        brightest.statistics.n_frames,
        0,
        brightest.statistics.temporal_variance_dn2,
        float("nan"),
    )
    parts = (variance.pixel, variance.column, variance.row)
    shortest = min(darks, key=lambda level: level.exposure_s).statistics
    total, *own = widened_by_rounding(
        (dsnu_e(variance.total, k, note), *(dsnu_e(part, k) for part in parts)),
        k,
        shortest.temporal_variance_dn2,
        shortest.spatial_variance_dn2,
    )
    dsnu_parts = (own[0], own[1], own[2])
    return Nonuniformity(total, dsnu_parts, dsnu_e_s, prnu_rel=prnu, images=images), flags


def _rate_spread(pattern: DarkPattern, darks: Sequence[DarkLevel], k: Quantity) -> Quantity:
    """Spread of the dark currents; rounding changes each exposure's pattern by some part of its step, 1 DN."""
    value = dsnu_e(spatial_variance(pattern.rate_dn_s, pattern.rate_noise).total, k)
    longest = max(darks, key=lambda level: level.exposure_s)
    s = longest.statistics
    (widened,) = widened_by_rounding((value,), k, s.temporal_variance_dn2, s.spatial_variance_dn2)
    by_rounding = sqrt(widened.standard_uncertainty**2 - value.standard_uncertainty**2) / longest.exposure_s
    return Quantity(value.value, hypot(value.standard_uncertainty, by_rounding), "e-/s", value.note)


def _prnu(
    pairs: Sequence[tuple[SeriesPoint, PatchLevel]], darkness: Mapping[float, DarkLevel], saturation_net_dn: float
) -> Quantity | None:
    """PRNU of the patches, each at its brightest exposure below saturation: other exposures show the same pixels."""
    low, high = (share * saturation_net_dn for share in _PRNU_SHARES)
    chosen = {
        point.label: (point, level)
        for point, level in pairs
        if low <= point.net_dn <= high and point.saturated_share == 0 and level.mean_dn.size >= 4 * 6
    }
    estimates = []
    for point, level in chosen.values():
        dark = darkness[level.exposure_s]
        shape = dark.mean_dn.shape
        window_rows, window_columns = level.region.window((shape[0], shape[1]))
        rows, columns = np.nonzero(level.region.mask((shape[0], shape[1])))
        values = level.mean_dn - level.region.select(dark.mean_dn)
        noise = point.variance_dn2 / point.n_frames + dark.noise.pixel
        found = flat_variance(values, rows + window_rows.start, columns + window_columns.start, noise)
        estimates.append(Estimate(found.value / point.net_dn**2, found.uncertainty / point.net_dn**2))
    if not estimates:
        return None
    note = f"within {len(estimates)} patches, slow gradients taken off; holds the patches' own texture, too"
    return prnu_rel(combined(estimates), Estimate(0.0, 0.0), 1.0, note)
