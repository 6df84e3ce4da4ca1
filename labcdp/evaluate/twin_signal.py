"""Signal of a patch in DN: mean, temporal noise and fixed pattern, predicted by a twin and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any

import numpy as np

from ..calibration import PatchObservation
from ..calibration.emva.result import Quantity
from ..response import Response
from .twin_noise import CameraNoise, known
from .twin_parameters import TwinParameters
from .twin_prediction import TwinRegion, dn_above_dark, luminance_per_dn
from .twin_rounding import ROUNDING_DN2


@dataclass(frozen=True)
class PatchSignal:
    """Signal of a patch in a frame; each value with its standard uncertainty.

    Parameters
    ----------
    mean_dn, temporal_dn, spatial_dn : (float, float)
        Mean DN; temporal noise of a pixel; standard deviation from pixel to pixel without temporal noise.
    """

    mean_dn: tuple[float, float]
    temporal_dn: tuple[float, float]
    spatial_dn: tuple[float, float]


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
    dn_per_cd_m2 : float
        Change of the mean DN with the luminance there.
    predicted, measured : PatchSignal
        By the twin and by the camera.
    """

    name: str
    luminance_cd_m2: float
    exposure_s: float
    dn_per_cd_m2: float
    predicted: PatchSignal
    measured: PatchSignal

    def deviations(self) -> dict[str, float]:
        """Measured less predicted of each value, of noise the variance, in standard uncertainties of the difference."""
        predicted, measured = self.predicted, self.measured
        (p, u), (m, v) = predicted.mean_dn, measured.mean_dn
        found = {"mean_dn": _over(m - p, hypot(u, v))}
        for name in ("temporal_dn", "spatial_dn"):
            of_predicted, of_measured = getattr(predicted, name), getattr(measured, name)
            uncertainty = hypot(variance_uncertainty(*of_predicted), variance_uncertainty(*of_measured))
            found[name] = _over(of_measured[0] ** 2 - of_predicted[0] ** 2, uncertainty)
        return found

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        values: dict[str, Any] = {
            "patch": self.name,
            "luminance_cd_m2": self.luminance_cd_m2,
            "exposure_s": self.exposure_s,
        }
        for name, deviation in self.deviations().items():
            (predicted, u), (measured, v) = getattr(self.predicted, name), getattr(self.measured, name)
            values[name] = {
                "predicted": predicted,
                "predicted_standard_uncertainty": u,
                "measured": measured,
                "measured_standard_uncertainty": v,
                "standardised_deviation": deviation,
            }
        return values


def longest_exposures(patches: Sequence[TwinPatch]) -> list[TwinPatch]:
    """Return each patch at its longest exposure."""
    longest: dict[str, TwinPatch] = {}
    for patch in patches:
        if patch.name not in longest or patch.exposure_s > longest[patch.name].exposure_s:
            longest[patch.name] = patch
    return list(longest.values())


def variance_uncertainty(value: float, uncertainty: float) -> float:
    """Return the standard uncertainty of the square of a value; of one near 0, that by the second order."""
    return max(2 * value * uncertainty, uncertainty**2)


def twin_patch(twin: TwinParameters, region: TwinRegion, o: PatchObservation, response: Response) -> TwinPatch:
    """Compare the signal of a patch in one exposure.

    Parameters
    ----------
    twin : TwinParameters
        The camera, without what `o` was corrected for.
    region : TwinRegion
        The patch as the twin is told of it.
    o : PatchObservation
        The patch as the camera saw it.
    response : Response
        Response of the camera.
    """
    return TwinPatch(
        region.name,
        region.luminance_cd_m2,
        o.exposure_s,
        1 / luminance_per_dn(twin, region, o.exposure_s, response),
        predict_signal(twin, region, o.exposure_s, response),
        _measured_signal(o, twin),
    )


def predict_signal(twin: TwinParameters, region: TwinRegion, exposure_s: float, response: Response) -> PatchSignal:
    """Predict mean, temporal noise and fixed pattern of a patch in a frame, in DN."""
    noise, dark_dn = twin.noise, twin.dark_dn(exposure_s)
    v = 1 / float(np.mean(1 / region.fall_off))
    full = twin.responsivity.value * exposure_s * v
    net_dn = float(dn_above_dark(twin, response, full * region.luminance_cd_m2))
    rel = hypot(known(twin.responsivity) / twin.responsivity.value, region.reading_rel, region.flat_field_rel)
    of_light = rel * full * region.luminance_cd_m2 / float(response.slope(net_dn))
    mean_u = hypot(of_light, twin.dark_standard_uncertainty_dn(exposure_s), region.darkness_dn)
    k = noise.k_dn_per_e
    above_dn = net_dn + twin.dark_current_e_s.value * k.value * exposure_s
    read = noise.read_noise_dn
    variance = read.value**2 + ROUNDING_DN2 + k.value * above_dn
    variance_u = hypot(2 * read.value * known(read), above_dn * known(k), k.value * of_light)
    parts = pattern_parts(noise, net_dn, exposure_s)
    spatial = sqrt(sum((part.value * factor) ** 2 for part, factor in parts))
    in_square = hypot(*(part.value * known(part) * factor**2 for part, factor in parts))
    least = hypot(*(known(part) * factor for part, factor in parts))
    return PatchSignal(
        (dark_dn + net_dn, mean_u),
        (sqrt(variance), variance_u / (2 * sqrt(variance))),
        (spatial, min(in_square / spatial, least) if spatial > 0 else least),
    )


def pattern_parts(noise: CameraNoise, net_dn: float, exposure_s: float) -> list[tuple[Quantity, float]]:
    """Return the parts of the fixed pattern, and by what each is multiplied to be DN."""
    return [
        (noise.dsnu_dn, 1.0),
        (noise.row_dsnu_dn, 1.0),
        (noise.column_dsnu_dn, 1.0),
        (noise.dsnu_dn_s, exposure_s),
        (noise.prnu_rel, net_dn),
    ]


def _measured_signal(o: PatchObservation, twin: TwinParameters) -> PatchSignal:
    """Mean, temporal noise and fixed pattern as the frames have them, each with its standard uncertainty."""
    dark_dn = twin.dark_dn(o.exposure_s)
    temporal = o.temporal_variance_dn2
    pattern = o.fixed_pattern_variance_dn2(dark_dn) / o.mean_inverse_v**2
    mean_u = sqrt(temporal / (o.n_pixels * o.n_frames) + pattern / o.n_pixels)
    freedom = (o.n_pixels - 1) * (o.n_frames - 1)
    by_noise = temporal / o.n_frames * sqrt(2 / freedom)
    pattern_u = hypot((pattern + temporal / o.n_frames) * sqrt(2 / o.n_pixels), by_noise)
    spatial = sqrt(pattern)
    return PatchSignal(
        (o.net_dn_at_pixel(0.0), mean_u),
        (sqrt(temporal), sqrt(temporal / (2 * freedom))),
        (spatial, min(pattern_u / (2 * spatial), sqrt(pattern_u)) if spatial > 0 else sqrt(pattern_u)),
    )


def _over(difference: float, uncertainty: float) -> float:
    return difference / uncertainty if uncertainty > 0 else 0.0
