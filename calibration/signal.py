"""One signal for each patch, from its observations at all exposures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from .dark import DarkModel
from .noise import TemporalNoise
from .observations import PatchObservation
from .region_statistics import quantisation_variance_dn2
from .signal_limits import MAX_CLIPPED_SHARE, MIN_NET_SIGNAL

#: Relative disagreement between exposures that goes without notice: small beside the 2 % of a meter.
EXPOSURE_TOLERANCE_REL = 0.002


@dataclass(frozen=True)
class PatchSignal:
    """Signal of a patch: y = (DN - d(t)) / (t V), averaged over the region and combined over the exposures.

    Parameters
    ----------
    patch : str
        Name of the patch.
    rate_dn_s : float
        y in DN per second, as on the optical axis.
    variance_dn2_s2 : float
        Its variance from noise and from the uneven darkness of the sensor; differs from patch to patch.
    dark_sensitivity : (float, float)
        Derivatives of y by the dark offset (1/s) and by the dark rate (1): the error of the dark model is shared by
        all patches.
    fixed_pattern_rel : float
        Relative standard uncertainty of y by pixels of different sensitivity.
    nonuniformity_rel : float
        Relative standard deviation of the patch's luminance across the region.
    exposures_s : tuple of float
        Exposures that were used, ascending.
    chi_squared : float
        Sum of squared deviations of the exposures from y, each over its variance and `EXPOSURE_TOLERANCE_REL`.
    degrees_of_freedom : int
        Observations less one.
    """

    patch: str
    rate_dn_s: float
    variance_dn2_s2: float
    dark_sensitivity: tuple[float, float]
    fixed_pattern_rel: float
    nonuniformity_rel: float
    exposures_s: tuple[float, ...]
    chi_squared: float
    degrees_of_freedom: int


def usable(
    observations: Sequence[PatchObservation], dark: DarkModel, noise: TemporalNoise
) -> tuple[list[PatchObservation], list[str]]:
    """Leave out the exposures at which one patch is clipped, or no brighter than the dark.

    Parameters
    ----------
    observations : sequence of PatchObservation
        Of one patch.
    dark : DarkModel
        Darkness.
    noise : TemporalNoise
        Noise of a pixel.

    Returns
    -------
    list of PatchObservation
        The usable ones.
    list of str
        A warning for each reason, naming patch and exposures.
    """
    kept: list[PatchObservation] = []
    left_out: dict[str, list[PatchObservation]] = {}
    for observation in observations:
        reason = _reason_to_leave_out(observation, dark, noise)
        if reason is None:
            kept.append(observation)
        else:
            left_out.setdefault(reason, []).append(observation)
    return kept, [
        f"patch {group[0].patch!r} {reason} at {', '.join(f'{o.exposure_s:g} s' for o in group)}: left out there"
        for reason, group in left_out.items()
    ]


def combine(observations: Sequence[PatchObservation], dark: DarkModel, noise: TemporalNoise) -> PatchSignal:
    """Combine the usable observations of one patch, each weighted by the inverse of its variance.

    Parameters
    ----------
    observations : sequence of PatchObservation
        At least one, of one patch, as `usable` returns them.
    dark : DarkModel
        Darkness.
    noise : TemporalNoise
        Noise of a pixel.
    """
    t = np.array([o.exposure_s for o in observations])
    dark_dn = [dark.mean_dn(o.exposure_s) for o in observations]
    inverse_v = np.array([o.mean_inverse_v for o in observations])
    pairs = list(zip(observations, dark_dn, strict=True))
    net = np.array([o.net_dn(d) for o, d in pairs])
    by_noise = np.array([_noise_variance_dn2(o, dark, noise) for o in observations]) / t**2
    by_dark = np.array([_dark_variance_dn2(o, dark) for o in observations]) / t**2
    weight = 1 / (by_noise + by_dark)
    weight /= weight.sum()
    rate = float(weight @ (net / t))
    by_offset, by_rate = -float(weight @ (inverse_v / t)), -float(weight @ inverse_v)
    pixels = np.array([sqrt(o.fixed_pattern_variance_dn2(d) / o.n_pixels) for o, d in pairs])
    slow = np.array([sqrt(o.nonuniformity_variance_dn2(d)) for o, d in pairs])
    tolerated = by_noise + by_dark + (pixels / t) ** 2 + (EXPOSURE_TOLERANCE_REL * rate) ** 2
    return PatchSignal(
        patch=observations[0].patch,
        rate_dn_s=rate,
        variance_dn2_s2=float(weight**2 @ by_noise) + (by_offset * dark.nonuniformity_dn) ** 2,
        dark_sensitivity=(by_offset, by_rate),
        fixed_pattern_rel=float(weight @ (pixels / net)),
        nonuniformity_rel=float(weight @ (slow / net)),
        exposures_s=tuple(float(v) for v in np.unique(t)),
        chi_squared=float(np.sum((net / t - rate) ** 2 / tolerated)),
        degrees_of_freedom=t.size - 1,
    )


def _reason_to_leave_out(observation: PatchObservation, dark: DarkModel, noise: TemporalNoise) -> str | None:
    if observation.saturated_share > MAX_CLIPPED_SHARE:
        return "is saturated"
    if observation.black_share > MAX_CLIPPED_SHARE:
        return "is clipped at 0 DN"
    variance = _noise_variance_dn2(observation, dark, noise) + _dark_variance_dn2(observation, dark)
    if observation.net_dn(dark.mean_dn(observation.exposure_s)) <= MIN_NET_SIGNAL * sqrt(variance):
        return "is not brighter than the dark"
    return None


def _noise_variance_dn2(observation: PatchObservation, dark: DarkModel, noise: TemporalNoise) -> float:
    """Variance of the region's mean (DN - d) / V: noise of the pixels, and rounding."""
    o, dark_dn = observation, dark.mean_dn(observation.exposure_s)
    pixel = noise.variance_dn2(o.net_dn_at_pixel(dark_dn))
    rounding = quantisation_variance_dn2(o.temporal_variance_dn2 + o.fixed_pattern_variance_dn2(dark_dn))
    return o.mean_inverse_v**2 * (pixel / (o.n_pixels * o.n_frames) + rounding)


def _dark_variance_dn2(observation: PatchObservation, dark: DarkModel) -> float:
    """Variance of the same by the darkness at this patch."""
    at_patch = dark.variance_dn2(observation.exposure_s) + dark.nonuniformity_dn**2
    return observation.mean_inverse_v**2 * at_patch
