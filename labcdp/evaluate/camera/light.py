"""What the light of a session says about its camera: linearity, responsivity and an estimate of QE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, pi, sqrt
from typing import NamedTuple

import numpy as np

from ...calibration import CameraState
from ...calibration.emva.linearity import in_range
from ...calibration.emva.result import Quantity
from ...calibration.emva.series import SeriesPoint
from ...calibration.frames.measure import MeasuredFrames
from ...calibration.signal_limits import MAX_CLIPPED_SHARE
from ...core.errors import InputError
from ...core.spectral.photometry import photon_radiance_per_cd_m2
from ...session import SessionConfiguration
from ..bench.corrections import natural_vignetting, pixel_area_m2

#: Half widths of what is engraved on a lens: the f-number, and its transmittance. Judged.
_F_NUMBER_REL, _TRANSMITTANCE_REL = 0.05, 0.1
#: Relative error of a reading without the meter's scale: digits and repeatability. An estimate, widened by the scatter.
_READING_REL = 0.003


class PatchDeviation(NamedTuple):
    """How far one patch at one exposure departs from the patch's line; relative, with its standard uncertainty."""

    point: SeriesPoint
    deviation_rel: float
    uncertainty_rel: float


def patch_deviations(points: Sequence[SeriesPoint], saturation_net_dn: float) -> list[PatchDeviation]:
    """Compare each patch with its own line over the exposure.

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
    for point in in_range(points, saturation_net_dn):
        if point.light.saturated_share <= MAX_CLIPPED_SHARE:
            patches.setdefault(point.label, []).append(point)
    rows: list[PatchDeviation] = []
    for own in patches.values():
        if len(own) < 2:
            continue
        y, t = np.array([point.net_dn for point in own]), np.array([point.exposure_s for point in own])
        noise = np.array([point.net_uncertainty_dn for point in own]) / y
        weights = (t / y) ** 2 / np.sum((t / y) ** 2)
        slope = float(np.sum(t / y) / np.sum((t / y) ** 2))
        left = np.sqrt(noise**2 * (1 - 2 * weights) + np.sum((weights * noise) ** 2))
        rows += map(PatchDeviation, own, (y / (slope * t) - 1).tolist(), left.tolist())
    return rows


def patch_linearity(rows: Sequence[PatchDeviation]) -> tuple[Quantity | None, Quantity | None, Quantity | None]:
    """Lowest, highest and mean absolute deviation of `patch_deviations`; None without any."""
    if not rows:
        return None, None, None
    patches = len({row.point.label for row in rows})
    note = f"over the exposure, {patches} patches; u by noise, black level and lamp"
    low, high = (choose(rows, key=lambda row: row.deviation_rel) for choose in (min, max))
    mean = float(np.mean([abs(row.deviation_rel) for row in rows]))
    u_mean = sqrt(sum(row.uncertainty_rel**2 for row in rows)) / len(rows)
    return (
        Quantity(low.deviation_rel, low.uncertainty_rel, "1", note),
        Quantity(high.deviation_rel, high.uncertainty_rel, "1", note),
        Quantity(mean, u_mean, "1", note),
    )


def photometric_responsivity(
    pairs: Sequence[tuple[SeriesPoint, MeasuredFrames]],
    readings: Mapping[str, Sequence[float]],
    configuration: SessionConfiguration,
    state: CameraState,
) -> Quantity | None:
    """Responsivity R on the optical axis: (mean - mean_dark) / (t V L), mean over the patches.

    Parameters
    ----------
    pairs : sequence of (SeriesPoint, MeasuredFrames)
        Unsaturated points.
    readings : mapping of str to sequence of float
        Luminance in cd/m^2 by the meter, by patch.
    configuration : SessionConfiguration
        For lens and pixel pitch; V is cos^4 of the off-axis angle.
    state : CameraState
        For the image's shape and the colour plane.

    Returns
    -------
    Quantity or None
        In DN / (cd m^-2 s); None without readings. The standard uncertainty is the scatter of the patches over the root
        of their number, and does not hold the meter's scale error.
    """
    v_image = natural_vignetting(configuration, state).relative_illuminance(state.image_shape)
    values, weights = [], []
    for name, luminances in readings.items():
        own = [pair for pair in pairs if pair[0].label == name and pair[0].net_dn > 0]
        luminance = float(np.mean(luminances))
        if not own or luminance <= 0:
            continue
        # The brightest exposure below saturation knows the patch best.
        point, level = max(own, key=lambda pair: pair[0].net_dn)
        v = float(v_image[level.window][level.statistics.used].mean())
        values.append(point.net_dn / (point.exposure_s * v * luminance))
        noise_rel = hypot(point.net_uncertainty_dn / point.net_dn, _READING_REL / sqrt(len(luminances)))
        weights.append(1 / noise_rel**2)
    if not values:
        return None
    mean = float(np.average(values, weights=weights))
    relative = 1 / sqrt(sum(weights))
    if len(values) > 1:
        chi_squared = float(np.sum(np.array(weights) * (np.array(values) / mean - 1) ** 2))
        relative *= max(1.0, sqrt(chi_squared / (len(values) - 1)))
    note = f"by the meter over {len(values)} patches, on the optical axis; u without the meter's scale error"
    return Quantity(mean, relative * mean, "DN/(cd m^-2 s)", note)


def quantum_efficiency_estimate(
    responsivity: Quantity, k: Quantity, configuration: SessionConfiguration, state: CameraState
) -> Quantity | None:
    """Estimate QE from lens data: electrons over photons per pixel, cd/m^2 and second.

    Photons are pi / (4 F^2) times transmittance, area of a pixel and photons s^-1 m^-2 sr^-1 per cd/m^2 of the
    spectrum: the illuminance behind a lens focused far away is E = pi tau L / (4 F^2).

    Returns
    -------
    Quantity or None
        None for a spectrum that is not known. QE is a mean over the spectrum. Half widths of 5 % of the f-number and
        10 % of the transmittance are assumed.
    """
    lens = configuration.lens
    try:
        radiance = photon_radiance_per_cd_m2(configuration.source.spectrum)
    except InputError:
        return None
    transmittance = 1.0 if lens.transmittance is None else lens.transmittance
    area_m2 = pixel_area_m2(configuration.camera.pixel_pitch_m, state.readout)
    photons = radiance * pi / (4 * lens.f_number**2) * transmittance * area_m2
    value = responsivity.value / k.value / photons
    of_lens = hypot(2 * _F_NUMBER_REL, _TRANSMITTANCE_REL) / sqrt(3)
    relative = hypot(responsivity.standard_uncertainty / responsivity.value, k.standard_uncertainty / k.value, of_lens)
    of_glass = "taken as 1, so that it is part of this value" if lens.transmittance is None else f"{transmittance:g}"
    note = (
        f"estimated from lens data, no photons were measured: f/{lens.f_number:g}, transmittance {of_glass}, mean over "
        f"{configuration.source.spectrum}"
    )
    return Quantity(value, relative * value, "1", note)
