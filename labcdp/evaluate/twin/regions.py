"""Patches of a session: input of the twin, luminance by the camera, and signals in DN."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ...calibration import Calibration, PatchObservation
from ...calibration.colour.patches import nonuniformity_rel
from ...calibration.frames.rounding import DITHERED_DN2, ROUNDING_DN2
from ...core.dn import Response
from ...core.luminance import Invalid, LuminanceMap
from ...core.roi import Roi
from ..bench.observe import ObservedSession, frame_maps
from ..bench.recorded import frames_showing
from ..bench.rows import read_patch
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
    def is_additive(self) -> bool:
        """Whether the error is additive (the same luminance for all pixels) rather than relative."""
        return self.source.startswith("dark")


@dataclass(frozen=True, eq=False)
class CameraPatch:
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
        reading, roi = read_patch(observed, patch.name), patch.region()
        v = np.asarray(roi.select(vignetting), dtype=float)
        uneven = nonuniformity_rel([calibration], {None: group})
        left, top, right, bottom = roi.bounds
        lines = (twin.row_dsnu_dn.value, bottom - top), (twin.column_dsnu_dn.value, right - left)
        regions[patch.name] = TwinRegion(
            name=patch.name,
            luminance_cd_m2=reading.luminance_cd_m2,
            reading_rel=hypot(reading.random_cd_m2 / reading.luminance_cd_m2, uneven),
            nonuniformity_rel=uneven,
            vignetting=v,
            darkness_dn=hypot(twin.dark.nonuniformity_dn, *(dsnu_dn / sqrt(max(n, 1)) for dsnu_dn, n in lines)),
            flat_field_rel=flat_field_rel,
        )
    return regions


def seen_regions(
    observed: ObservedSession, calibration: Calibration, exposure_s: float, names: set[str]
) -> dict[str, CameraPatch]:
    """Return the calibrated luminance of patches in the first frame of an exposure that shows them, by name."""
    rois = {patch.name: patch.region() for patch in observed.configuration.target.patches if patch.name in names}
    maps = frame_maps(observed, calibration)
    return {
        name: _seen_region(maps(record), rois[name], exposure_s, record.number)
        for name, record in frames_showing(observed.session, exposure_s, rois).items()
    }


def _seen_region(luminance: LuminanceMap, roi: Roi, exposure_s: float, frame_number: int) -> CameraPatch:
    values = np.asarray(luminance.select(roi), dtype=float)
    sound = (luminance.scaled(roi).select(luminance.invalid) & Invalid.DEFECT.value) == 0
    mean = float(values[sound].mean())
    errors = []
    for error in luminance.common_of(roi):
        # At zero signal the relative error of the dark signal is infinite; its error in luminance is that elsewhere.
        with np.errstate(invalid="ignore"):
            absolute = np.broadcast_to(error.relative, values.shape)[sound] * values[sound]
        mean_error = float(np.mean(absolute[np.isfinite(absolute)]))
        errors.append(RegionError(error.source, mean_error, mean_error / mean if mean else 0.0))
    return CameraPatch(values[sound], exposure_s, frame_number, tuple(errors))


#: Kinds of signal, as they are called in tables.
KINDS = {"mean_dn": "mean", "temporal_dn": "temporal noise", "spatial_dn": "fixed pattern"}
#: A value with its standard uncertainty.
Value = tuple[float, float]


@dataclass(frozen=True)
class TwinPatch:
    """Signal of a patch in an exposure that does not saturate it, predicted and measured.

    Parameters
    ----------
    name : str
        Name of the patch.
    luminance_cd_m2 : float
        By the meter.
    exposure_s : float
        The exposure.
    predicted, measured : dict of str to (float, float)
        By the twin and by the camera, by the names of `KINDS`: mean DN; temporal noise of a pixel; standard deviation
        from pixel to pixel without temporal noise.
    """

    name: str
    luminance_cd_m2: float
    exposure_s: float
    predicted: Mapping[str, Value]
    measured: Mapping[str, Value]

    @property
    def z(self) -> dict[str, float | None]:
        """Measured less predicted value (variance for noise), in standard uncertainties of the difference, by kind.

        None for noise less than the converter's step: its variance depends on where between two DN the mean lies.
        """
        dithered = min(signals["temporal_dn"][0] for signals in (self.predicted, self.measured)) ** 2 >= DITHERED_DN2
        z_by_kind: dict[str, float | None] = {}
        for kind in KINDS:
            both = [self.predicted[kind], self.measured[kind]]
            if kind != "mean_dn":
                # Squares, their uncertainty with the second-order term for values near 0.
                both = [(value**2, max(2 * value * u, u**2)) for value, u in both]
            (predicted, u), (measured, v) = both
            z = (measured - predicted) / hypot(u, v) if hypot(u, v) > 0 else 0.0
            z_by_kind[kind] = z if dithered or kind == "mean_dn" else None
        return z_by_kind


def twin_patch(twin: TwinParameters, region: TwinRegion, o: PatchObservation, response: Response) -> TwinPatch:
    """Compare the signal of a patch in one exposure.

    Parameters
    ----------
    twin : TwinParameters
        The camera, without the patterns that the frames of `o` were corrected for.
    region : TwinRegion
        The patch as input of the twin.
    o : PatchObservation
        The patch as measured by the camera.
    response : Response
        Response of the camera.
    """
    predicted = predicted_signal(twin, region, o.exposure_s, response)
    return TwinPatch(region.name, region.luminance_cd_m2, o.exposure_s, predicted, _measured_signal(o, twin))


def predicted_signal(
    twin: TwinParameters, region: TwinRegion, exposure_s: float, response: Response
) -> dict[str, Value]:
    """Predict mean, temporal noise and fixed pattern of a patch in a frame, in DN.

    A measured mean and pattern are those of DN / V over the mean of 1 / V, as at the harmonic mean of V; the temporal
    variance is averaged as it is, so that its photons are those at the arithmetic mean.
    """
    dark_dn = twin.dark_dn(exposure_s)
    on_axis = twin.responsivity.value * exposure_s * region.luminance_cd_m2
    harmonic = 1 / float((1 / region.vignetting).mean())
    net_dn, light_dn = response.inverse([on_axis * v for v in (harmonic, float(region.vignetting.mean()))])
    rel = hypot(twin.responsivity.u_known / twin.responsivity.value, region.reading_rel, region.flat_field_rel)
    light_u_dn = rel * on_axis * harmonic / float(response.slope(net_dn))
    mean_u = hypot(light_u_dn, twin.dark_standard_uncertainty_dn(exposure_s), region.darkness_dn)
    k, read = twin.k_dn_per_e, twin.read_noise_dn
    above_dn = float(light_dn) + twin.dark_current_e_s.value * k.value * exposure_s
    temporal = sqrt(read.value**2 + ROUNDING_DN2 + k.value * above_dn)
    temporal_u = hypot(2 * read.value * read.u_known, above_dn * k.u_known, k.value * light_u_dn) / (2 * temporal)
    parts = [(pattern, 1.0) for pattern in (twin.dsnu_dn, twin.row_dsnu_dn, twin.column_dsnu_dn)]
    parts += [(twin.dsnu_dn_s, exposure_s), (twin.prnu_rel, float(net_dn))]
    spatial = hypot(*(part.value * factor for part, factor in parts))
    in_square = hypot(*(part.value * part.u_known * factor**2 for part, factor in parts))
    least = hypot(*(part.u_known * factor for part, factor in parts))
    return {
        "mean_dn": (dark_dn + float(net_dn), mean_u),
        "temporal_dn": (temporal, temporal_u),
        "spatial_dn": (spatial, min(in_square / spatial, least) if spatial > 0 else least),
    }


def _measured_signal(o: PatchObservation, twin: TwinParameters) -> dict[str, Value]:
    """Measured mean, temporal noise and fixed pattern, each with its standard uncertainty."""
    temporal = o.temporal_variance_dn2
    pattern = max(o.fixed_pattern_variance_dn2(twin.dark_dn(o.exposure_s)), 0.0) / o.mean_inverse_v**2
    mean_u = sqrt(temporal / (o.n_pixels * o.n_frames) + pattern / o.n_pixels)
    dof = o.dof
    by_noise = temporal / o.n_frames * sqrt(2 / dof)
    pattern_u = hypot((pattern + temporal / o.n_frames) * sqrt(2 / o.n_pixels), by_noise)
    spatial = sqrt(pattern)
    return {
        "mean_dn": (o.net_dn_at_pixel(0.0), mean_u),
        "temporal_dn": (sqrt(temporal), sqrt(temporal / (2 * dof))),
        "spatial_dn": (spatial, min(pattern_u / (2 * spatial), sqrt(pattern_u)) if spatial > 0 else sqrt(pattern_u)),
    }
