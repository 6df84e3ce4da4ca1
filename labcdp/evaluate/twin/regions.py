"""The patches of a session: by the meter, as input of the twin, and by the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ...calibration import Calibration, PatchObservation
from ...calibration.readings import combine_readings
from ...core.errors import CalibrationError
from ...core.luminance import Invalid, LuminanceMap
from ...core.roi import Roi
from ...session import Session
from ..bench.observe import ObservedSession
from ..bench.recorded import by_exposure, shows
from .parameters import TwinParameters
from .prediction import TwinRegion


@dataclass(frozen=True)
class RegionError:
    """One common error of all luminances of a calibration, in one region.

    Parameters
    ----------
    source : str
        Source of the error.
    luminance_cd_m2 : float
        Signed error of the region's mean for one standard uncertainty of the source.
    relative : float
        The same over the mean.
    """

    source: str
    luminance_cd_m2: float
    relative: float

    @property
    def of_darkness(self) -> bool:
        """Whether the error is additive (the same luminance for all pixels) rather than relative."""
        return self.source.startswith("dark")


@dataclass(frozen=True, eq=False)
class SeenRegion:
    """A patch as measured by the camera.

    Parameters
    ----------
    luminance_cd_m2 : ndarray of float, shape (n,)
        Calibrated luminance of its pixels in one frame.
    exposure_s : float
        Exposure of the frame.
    frame_number : int
        Its number in the session.
    errors : tuple of RegionError
        Effect of the calibration's common errors on its mean, in the order of the luminance map.
    """

    luminance_cd_m2: NDArray[np.float64]
    exposure_s: float
    frame_number: int
    errors: tuple[RegionError, ...]


def regions_of(
    observed: ObservedSession, calibration: Calibration, twin: TwinParameters, flat_field_rel: float
) -> dict[str, TwinRegion]:
    """Return the patches as input of the twin, by name.

    Parameters
    ----------
    observed : ObservedSession
        The session.
    calibration : Calibration
        Calibration, for its vignetting.
    twin : TwinParameters
        For the dark signal.
    flat_field_rel : float
        Relative standard uncertainty of the vignetting of a region relative to that elsewhere.

    Raises
    ------
    CalibrationError
        If a patch has no reading, or one of 0.
    """
    shape = calibration.state.image_shape
    vignetting = np.ones(shape)
    if calibration.vignetting is not None:
        vignetting = calibration.vignetting.relative_illuminance(shape)
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
        v = np.asarray(roi.select(vignetting), dtype=float)
        uneven_rel = _unevenness_rel(group, twin)
        left, top, right, bottom = roi.bounds
        row, column = twin.noise.row_dsnu_dn.value, twin.noise.column_dsnu_dn.value
        regions[patch.name] = TwinRegion(
            name=patch.name,
            luminance_cd_m2=reading.luminance_cd_m2,
            reading_rel=hypot(reading.random_cd_m2 / reading.luminance_cd_m2, uneven_rel),
            unevenness_rel=uneven_rel,
            vignetting=v,
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
        # At zero signal the relative error of the dark signal is infinite; its error in luminance is that elsewhere.
        with np.errstate(invalid="ignore"):
            absolute = np.broadcast_to(error.relative, values.shape)[sound] * values[sound]
        of_mean = float(np.mean(absolute[np.isfinite(absolute)]))
        errors.append(RegionError(error.source, of_mean, of_mean / mean if mean else 0.0))
    return SeenRegion(values[sound], exposure_s, frame_number, tuple(errors))
