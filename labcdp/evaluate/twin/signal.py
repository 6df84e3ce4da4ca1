"""Signal of a patch in DN: mean, temporal noise and fixed pattern, predicted by a twin and measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, sqrt

from ...calibration import PatchObservation
from ...calibration.rounding import DITHERED_DN2, ROUNDING_DN2
from ...core.response import Response
from .noise import known
from .parameters import TwinParameters
from .prediction import TwinRegion, dn_above_dark

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
        dithered = min(one["temporal_dn"][0] for one in (self.predicted, self.measured)) ** 2 >= DITHERED_DN2
        found: dict[str, float | None] = {}
        for kind in KINDS:
            (p, u), (m, v) = self.predicted[kind], self.measured[kind]
            if kind == "mean_dn":
                found[kind] = _over(m - p, hypot(u, v))
            else:
                uncertainty = hypot(_of_square(p, u), _of_square(m, v))
                found[kind] = _over(m**2 - p**2, uncertainty) if dithered else None
        return found


def _over(difference: float, uncertainty: float) -> float:
    return difference / uncertainty if uncertainty > 0 else 0.0


def _of_square(value: float, uncertainty: float) -> float:
    """Return the standard uncertainty of the square of a value, with the second-order term for values near 0."""
    return max(2 * value * uncertainty, uncertainty**2)


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
    noise, dark_dn = twin.noise, twin.dark_dn(exposure_s)
    on_axis = twin.responsivity.value * exposure_s * region.luminance_cd_m2
    harmonic = 1 / float((1 / region.vignetting).mean())
    net_dn, light_dn = dn_above_dark(twin, response, [on_axis * v for v in (harmonic, float(region.vignetting.mean()))])
    rel = hypot(known(twin.responsivity) / twin.responsivity.value, region.reading_rel, region.flat_field_rel)
    of_light = rel * on_axis * harmonic / float(response.slope(net_dn))
    mean_u = hypot(of_light, twin.dark_standard_uncertainty_dn(exposure_s), region.darkness_dn)
    k, read = noise.k_dn_per_e, noise.read_noise_dn
    above_dn = float(light_dn) + twin.dark_current_e_s.value * k.value * exposure_s
    temporal = sqrt(read.value**2 + ROUNDING_DN2 + k.value * above_dn)
    temporal_u = hypot(2 * read.value * known(read), above_dn * known(k), k.value * of_light) / (2 * temporal)
    parts = [(one, 1.0) for one in (noise.dsnu_dn, noise.row_dsnu_dn, noise.column_dsnu_dn)]
    parts += [(noise.dsnu_dn_s, exposure_s), (noise.prnu_rel, float(net_dn))]
    spatial = hypot(*(part.value * factor for part, factor in parts))
    in_square = hypot(*(part.value * known(part) * factor**2 for part, factor in parts))
    least = hypot(*(known(part) * factor for part, factor in parts))
    return {
        "mean_dn": (dark_dn + float(net_dn), mean_u),
        "temporal_dn": (temporal, temporal_u),
        "spatial_dn": (spatial, min(in_square / spatial, least) if spatial > 0 else least),
    }


def _measured_signal(o: PatchObservation, twin: TwinParameters) -> dict[str, Value]:
    """Measured mean, temporal noise and fixed pattern, each with its standard uncertainty."""
    temporal = o.temporal_variance_dn2
    pattern = o.fixed_pattern_variance_dn2(twin.dark_dn(o.exposure_s)) / o.mean_inverse_v**2
    mean_u = sqrt(temporal / (o.n_pixels * o.n_frames) + pattern / o.n_pixels)
    dof = (o.n_pixels - 1) * (o.n_frames - 1)
    by_noise = temporal / o.n_frames * sqrt(2 / dof)
    pattern_u = hypot((pattern + temporal / o.n_frames) * sqrt(2 / o.n_pixels), by_noise)
    spatial = sqrt(pattern)
    return {
        "mean_dn": (o.net_dn_at_pixel(0.0), mean_u),
        "temporal_dn": (sqrt(temporal), sqrt(temporal / (2 * dof))),
        "spatial_dn": (spatial, min(pattern_u / (2 * spatial), sqrt(pattern_u)) if spatial > 0 else sqrt(pattern_u)),
    }
