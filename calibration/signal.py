"""Signal above dark of an observation, its noise, and whether it can be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ..core.clock import exposure_text
from ..core.dn import Response
from ..core.result import Finding, info
from .fit_records import LeftOut, Reason
from .frames.observations import PatchObservation
from .frames.rounding import ROUNDING_DN2, quantisation_variance_dn2
from .frames.statistics import MAX_CLIPPED_SHARE, MIN_NET_SIGNAL, lines_variance_dn2
from .sensor.noise import GainSetting, TemporalNoise, find_gain

Array = NDArray[np.float64]

#: Codes of findings about exposures that are left out.
_CODES: dict[Reason, str] = {
    "saturated": "exposure-saturated",
    "clipped at 0 DN": "exposure-clipped",
    "outside the response of the bracket": "exposure-outside-response",
    "not above the dark signal": "exposure-not-above-dark",
}


@dataclass(frozen=True, eq=False)
class NetSignals:
    """Signals of n observations above the dark signal, arrays of shape (n,); h(net_dn) = R t L / mean(1 / V).

    Parameters
    ----------
    net_dn : ndarray of float
        DN above dark of a region's pixels, V not removed; with a tone curve, that of the pixels' mean h.
    scale_per_s : ndarray of float
        Mean of 1 / V over the exposure time: h(net_dn) times this is R L.
    noise_variance_dn2 : ndarray of float
        Variance of `net_dn` by the noise of pixels, columns and rows, and by rounding.
    flicker_rel, black_level_dn : ndarray of float
        Standard uncertainties by what changes from frame to frame, the light (relative) and the black level: the same
        errors at all patches of the same frames.
    frames_variance_dn2 : ndarray of float
        Variance by these two.
    dark_variance_dn2 : ndarray of float
        Variance by the dark model.
    dark_nonuniformity_dn : ndarray of float
        Standard uncertainty by dark signal non-uniformity, both slow and from pixel to pixel; the same error at all
        exposures of one patch.
    pixels_rel : ndarray of float
        Relative standard uncertainty by pixels of different sensitivity.
    pixels_variance_rel : ndarray of float
        Relative variance of the pixels' sensitivities as this patch shows it; below 0 by chance.
    slow_rel : ndarray of float
        Relative standard deviation of the patch's luminance across the region.
    rim_rel, rim_u_rel : ndarray of float
        By how much the rim of the region makes it brighter than what is inside, relative, and its standard uncertainty.
    shape_rel : ndarray of float
        By how much the light of the part that the meter sees exceeds that of the region, relative.
    gain_index : ndarray of int
        Index of their gains among the settings.
    """

    net_dn: Array
    scale_per_s: Array
    noise_variance_dn2: Array
    flicker_rel: Array
    black_level_dn: Array
    frames_variance_dn2: Array
    dark_variance_dn2: Array
    dark_nonuniformity_dn: Array
    pixels_rel: Array
    pixels_variance_rel: Array
    slow_rel: Array
    rim_rel: Array
    rim_u_rel: Array
    shape_rel: Array
    gain_index: NDArray[np.intp]

    @property
    def variance_without_light_dn2(self) -> Array:
        """Variance of `net_dn` by what is there in the dark too: a light that flickers is light."""
        known = self.noise_variance_dn2 + self.black_level_dn**2 + self.dark_variance_dn2
        return known + self.dark_nonuniformity_dn**2

    @property
    def variance_dn2(self) -> Array:
        """Variance of `net_dn` by all but the pixels' sensitivity: the inverse weight among exposures."""
        known = self.noise_variance_dn2 + self.frames_variance_dn2 + self.dark_variance_dn2
        return known + self.dark_nonuniformity_dn**2

    def where(self, kept: NDArray[np.bool_]) -> NetSignals:
        """Return some of them, by a mask."""
        return NetSignals(**{name: values[kept] for name, values in vars(self).items()})


def net_signals(observations: Sequence[PatchObservation], settings: Sequence[GainSetting]) -> NetSignals:
    """Subtract the dark signal from observations.

    Parameters
    ----------
    observations : sequence of PatchObservation
        Of any patches and exposures.
    settings : sequence of GainSetting
        Dark signal and noise of their gains.

    Raises
    ------
    CalibrationError
        If a gain is not among them.
    """
    rows = [_net_signal(o, settings) for o in observations]
    return NetSignals(**{field.name: np.array([row[field.name] for row in rows]) for field in fields(NetSignals)})


def _net_signal(o: PatchObservation, settings: Sequence[GainSetting]) -> dict[str, float]:
    index = find_gain(settings, o.state.gain_db)
    dark, noise = settings[index].dark, settings[index].noise
    dark_dn = dark.mean_dn(o.exposure_s, o.temperature_c)
    pattern_dn2 = max(o.fixed_pattern_variance_dn2(dark_dn), 0.0)
    dark_dn2 = dark.noise_variance_dn2(o.exposure_s, o.temperature_c)
    net_dn, power = _before_tone(o, dark_dn, pattern_dn2, dark_dn2, noise)
    # h / V is uniform where (DN - d) / V is not: to first order it varies as this does with another d, over the power.
    level_dn = dark_dn + (1 - 1 / power) * o.net_dn(dark_dn) / o.mean_inverse_v
    # The dark part of the pattern is known from the dark frames; the rest is sensitivity.
    dark_pattern_dn = dark.pattern_dn(o.exposure_s)
    sensitivity_dn2 = o.fixed_pattern_variance_dn2(level_dn) - (dark_pattern_dn * o.mean_inverse_v) ** 2
    rounding = quantisation_variance_dn2(o.temporal_variance_dn2 + pattern_dn2, o.step_dn)
    nonuniformity_dn2 = dark.nonuniformity_dn**2 + dark_pattern_dn**2 / o.n_pixels
    nonuniformity_dn2 += lines_variance_dn2(dark.line_pattern_dn, o.n_lines)
    on_axis = max(abs(o.net_dn(dark_dn)), 1e-12)
    of_pixels = noise.variance_dn2(net_dn, dark_dn2) / o.n_pixels
    of_rim_dn2 = (of_pixels + lines_variance_dn2(dark.line_noise_dn, o.n_lines)) / o.n_frames + nonuniformity_dn2
    # A mean and that of a part of it differ by less than the part varies.
    of_part = 0.0 if o.inside is None else sqrt(1 / o.inside.share - 1)
    flicker_rel, black_level_dn = noise.flicker_at(o.exposure_s)[0] / sqrt(o.n_frames), dark.drift_dn / sqrt(o.n_frames)
    return {
        "net_dn": net_dn,
        "scale_per_s": o.mean_inverse_v / o.exposure_s,
        "noise_variance_dn2": (of_pixels + lines_variance_dn2(dark.line_noise_dn, o.n_lines)) / o.n_frames + rounding,
        "flicker_rel": flicker_rel,
        "black_level_dn": black_level_dn,
        "frames_variance_dn2": (flicker_rel * net_dn / power) ** 2 + black_level_dn**2,
        "dark_variance_dn2": dark.variance_dn2(o.exposure_s, o.temperature_c),
        "dark_nonuniformity_dn": sqrt(nonuniformity_dn2),
        "pixels_rel": noise.prnu_rel / sqrt(o.n_pixels),
        "pixels_variance_rel": (power / on_axis) ** 2 * sensitivity_dn2,
        "slow_rel": power * sqrt(o.nonuniformity.slow_variance_dn2(level_dn)) / on_axis,
        "rim_rel": power * o.rim_dn(level_dn) / on_axis,
        "rim_u_rel": hypot(power * sqrt(of_rim_dn2) / on_axis, noise.prnu_rel / sqrt(o.n_pixels)) * of_part,
        "shape_rel": power * o.shape_dn(level_dn) / on_axis,
        "gain_index": index,
    }


def with_prnu(setting: GainSetting, observations: Sequence[PatchObservation]) -> GainSetting:
    """Return the same with the standard deviation of the pixels' sensitivities that all patches together show.

    It is one property of the camera. What each patch shows of it may be below 0 by chance, and only their weighted mean
    is set to 0 then: estimates of at least 0 would be too large on average.
    """
    kept, _, _ = usable(observations, [setting])
    signals = net_signals(kept, [setting])
    # Inverse variances of variances, by noise.
    weight = (signals.net_dn**2 / signals.noise_variance_dn2) ** 2 / np.array([o.n_pixels for o in kept])
    prnu_rel = sqrt(max(sum(weight * signals.pixels_variance_rel), 0.0) / sum(weight)) if kept else 0.0
    return replace(setting, noise=replace(setting.noise, prnu_rel=prnu_rel))


def _before_tone(
    o: PatchObservation, dark_dn: float, pattern_dn2: float, dark_dn2: float, noise: TemporalNoise
) -> tuple[float, float]:
    """Signal whose h is the mean over the pixels' light, and d ln h / d ln n there.

    The mean of a non-linear response over noisy pixels differs from the response of the mean, to second order by half
    the variance of the light times the curvature; so does that of the dark frames.
    """
    net_dn, tone = o.net_dn_at_pixel(dark_dn), noise.tone
    if tone is None or net_dn <= 0 or not noise.covers(net_dn):
        return net_dn, 1.0
    h, slope = float(tone.linearise(net_dn)), float(tone.slope(net_dn))
    variance_dn2 = max(o.temporal_variance_dn2 - ROUNDING_DN2, 0.0) + pattern_dn2
    shift = _shift_of_mean(tone, net_dn, variance_dn2) - _shift_of_mean(tone, 0.0, max(dark_dn2 - ROUNDING_DN2, 0.0))
    return net_dn + shift / slope, slope * net_dn / h


def _shift_of_mean(tone: Response, net_dn: float, variance_dn2: float) -> float:
    """Mean of h over normal DN less h of their mean, by three points (Gauss and Hermite): exact to the fifth power."""
    wide = sqrt(3 * variance_dn2)
    low, middle, high = tone.linearise([net_dn - wide, net_dn, net_dn + wide]).tolist()
    return float(low - 2 * middle + high) / 6


def usable(
    observations: Sequence[PatchObservation], settings: Sequence[GainSetting]
) -> tuple[list[PatchObservation], list[LeftOut], list[Finding]]:
    """Exclude exposures at which a patch is clipped or not significantly above dark.

    Parameters
    ----------
    observations : sequence of PatchObservation
        Of one patch.
    settings : sequence of GainSetting
        Dark signal and noise of their gains.

    Returns
    -------
    list of PatchObservation
        The usable ones.
    list of LeftOut
        The others.
    list of Finding
        One for each reason, naming patch and exposures; normal where exposures are bracketed.
    """
    reasons = _reasons_to_leave_out(observations, settings)
    kept = [o for o, reason in zip(observations, reasons, strict=True) if reason is None]
    left_out = [
        LeftOut(o.patch, o.exposure_s, None, reason)
        for o, reason in zip(observations, reasons, strict=True)
        if reason is not None
    ]
    exposures_s: dict[Reason, list[float]] = {}
    for left in left_out:
        exposures_s.setdefault(left.reason, []).append(left.exposure_s or 0.0)
    findings = [info(_CODES[reason], left_out[0].patch, exposures_s=times) for reason, times in exposures_s.items()]
    return kept, left_out, findings


def left_out_text(left_out: Sequence[LeftOut]) -> str:
    """List excluded data on one line, for error messages."""
    groups: dict[tuple[str, Reason], list[str]] = {}
    # A patch without data is implied by its exposures.
    for left in [left for left in left_out if left.reason != "not usable at any exposure"]:
        times = groups.setdefault((left.patch, left.reason), [])
        times += [] if left.exposure_s is None else [exposure_text(left.exposure_s)]
    return "; ".join(
        f"patch {patch!r}: {reason}{' at ' if times else ''}{', '.join(times)}"
        for (patch, reason), times in groups.items()
    )


def temperature_findings(observations: Sequence[PatchObservation], settings: Sequence[GainSetting]) -> list[Finding]:
    """Warn of observations outside the temperatures of the dark frames, where that changes the dark signal.

    Parameters
    ----------
    observations : sequence of PatchObservation
        Of one patch.
    settings : sequence of GainSetting
        Dark signal of their gains, among others.
    """
    by_gain: dict[int, list[PatchObservation]] = {}
    for o in observations:
        by_gain.setdefault(find_gain(settings, o.state.gain_db), []).append(o)
    findings = []
    for index, of_gain in by_gain.items():
        frames = [(o.exposure_s, o.temperature_c) for o in of_gain]
        findings += settings[index].dark.temperature_findings(frames, f"patch {of_gain[0].patch}")
    return findings


def _reasons_to_leave_out(
    observations: Sequence[PatchObservation], settings: Sequence[GainSetting]
) -> list[Reason | None]:
    """Return why observations cannot be used; None for those that can."""
    reasons: list[Reason | None] = []
    for o in observations:
        clipped = o.black_share > MAX_CLIPPED_SHARE
        reasons.append("saturated" if o.saturated_share > MAX_CLIPPED_SHARE else "clipped at 0 DN" if clipped else None)
    numbers = [k for k, reason in enumerate(reasons) if reason is None]
    signals = net_signals([observations[k] for k in numbers], settings)
    least_dn = MIN_NET_SIGNAL * np.sqrt(signals.variance_without_light_dn2)
    for k, gain, net_dn, least in zip(numbers, signals.gain_index, signals.net_dn, least_dn, strict=True):
        if not settings[gain].noise.covers(float(net_dn)):
            reasons[k] = "outside the response of the bracket"
        elif net_dn <= least:
            reasons[k] = "not above the dark signal"
    return reasons
