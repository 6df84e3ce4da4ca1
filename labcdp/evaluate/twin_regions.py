"""The patches of a session: as the meter told them to the twin, and as the camera saw them."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt

import numpy as np

from ..calibration import Calibration, PatchObservation
from ..calibration.readings import combine_readings
from ..errors import CalibrationError
from ..luminance import Invalid, LuminanceMap
from ..roi import Roi
from ..session import Session
from .observe import ObservedSession
from .recorded import by_exposure, shows
from .twin_compare import RegionError, SeenRegion
from .twin_parameters import TwinParameters
from .twin_prediction import TwinRegion


def regions_of(
    observed: ObservedSession, calibration: Calibration, twin: TwinParameters, flat_field_rel: float
) -> dict[str, TwinRegion]:
    """Return the patches as the twin is told of them, by name.

    Parameters
    ----------
    observed : ObservedSession
        The session.
    calibration : Calibration
        For the fall-off.
    twin : TwinParameters
        For the darkness.
    flat_field_rel : float
        Relative standard uncertainty of the fall-off of a region against that elsewhere.

    Raises
    ------
    CalibrationError
        If a patch has no reading, or one of 0.
    """
    shape = calibration.state.image_shape
    fall_off = np.ones(shape)
    if calibration.vignetting is not None:
        fall_off = calibration.vignetting.relative_illuminance(shape)
    regions = {}
    for patch in observed.configuration.target.patches:
        group = observed.patches.get(patch.name)
        if not group:
            continue
        reading, _ = combine_readings(patch.name, observed.readings.get(patch.name, []))
        if reading.luminance_cd_m2 == 0:
            raise CalibrationError(
                f"patch {patch.name!r} reads 0 cd/m^2, below the meter's range: leave it out with --without "
                f"{patch.name!r}"
            )
        roi = patch.region()
        v = np.asarray(roi.select(fall_off), dtype=float)
        uneven_rel = _unevenness_rel(group, twin)
        left, top, right, bottom = roi.bounds
        row, column = twin.noise.row_dsnu_dn.value, twin.noise.column_dsnu_dn.value
        regions[patch.name] = TwinRegion(
            name=patch.name,
            luminance_cd_m2=reading.luminance_cd_m2,
            reading_rel=hypot(reading.random_cd_m2 / reading.luminance_cd_m2, uneven_rel),
            unevenness_rel=uneven_rel,
            fall_off=v,
            darkness_dn=hypot(
                twin.dark.nonuniformity_dn, row / sqrt(max(bottom - top, 1)), column / sqrt(max(right - left, 1))
            ),
            flat_field_rel=flat_field_rel,
        )
    return regions


def _unevenness_rel(group: Sequence[PatchObservation], twin: TwinParameters) -> float:
    """Slow changes of the light across a patch, at the exposure that shows them best."""
    fitting = [o for o in group if o.saturated_share == 0]
    if not fitting:
        return 0.0
    o = max(fitting, key=lambda one: one.exposure_s)
    dark_dn = twin.dark_dn(o.exposure_s)
    net_dn = o.net_dn(dark_dn)
    return sqrt(o.nonuniformity_variance_dn2(dark_dn)) / net_dn if net_dn > 0 else 0.0


def seen_regions(
    session: Session, observed: ObservedSession, calibration: Calibration, exposure_s: float, names: set[str]
) -> dict[str, SeenRegion]:
    """Return the calibrated luminance of patches in the first frame of an exposure that shows them, by name."""
    records = by_exposure(session, "light")[exposure_s]
    rois = {patch.name: patch.region() for patch in observed.configuration.target.patches if patch.name in names}
    maps: dict[int, LuminanceMap] = {}
    seen = {}
    for name, roi in rois.items():
        record = next(r for r in records if shows(r, name))
        if record.number not in maps:
            maps[record.number] = calibration.to_luminance(session.load(record))
        seen[name] = _seen_region(maps[record.number], roi, exposure_s, record.number)
    return seen


def _seen_region(luminance: LuminanceMap, roi: Roi, exposure_s: float, frame_number: int) -> SeenRegion:
    values = np.asarray(luminance.select(roi), dtype=float)
    sound = (luminance.scaled(roi).select(luminance.invalid) & Invalid.DEFECT.value) == 0
    mean = float(values[sound].mean())
    errors = []
    for error in luminance.common_of(roi):
        # At zero signal an error of the darkness is infinite relative to it; its luminance is what it is elsewhere.
        with np.errstate(invalid="ignore"):
            absolute = np.broadcast_to(error.relative, values.shape)[sound] * values[sound]
        of_mean = float(np.mean(absolute[np.isfinite(absolute)]))
        errors.append(RegionError(error.source, of_mean, of_mean / mean if mean else 0.0))
    return SeenRegion(values[sound], exposure_s, frame_number, tuple(errors))
