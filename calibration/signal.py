"""What one observation of a patch says: signal above dark, its noise, and whether it can be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

from ..response import Response
from .findings import LeftOut
from .gains import GainSetting, index_of_gain
from .observations import PatchObservation
from .region_statistics import quantisation_variance_dn2
from .signal_limits import MAX_CLIPPED_SHARE, MIN_NET_SIGNAL, ROUNDING_DN2


@dataclass(frozen=True)
class NetSignal:
    """Signal of a patch at one exposure, above the darkness; h(net_dn) = R t L / mean(1 / V).

    Parameters
    ----------
    net_dn : float
        DN above dark as the region's pixels have it, V not removed; with a tone curve, that of the pixels' mean h.
    scale_per_s : float
        Mean of 1 / V over the exposure time: h(net_dn) times this is R L.
    noise_variance_dn2 : float
        Variance of `net_dn` by the pixels' noise and by rounding.
    dark_variance_dn2 : float
        Variance by the dark model.
    dark_nonuniformity_dn : float
        Standard uncertainty by the uneven darkness, slowly across the sensor and from pixel to pixel; the same error at
        all exposures of one patch.
    pixels_rel : float
        Relative standard uncertainty by pixels of different sensitivity.
    slow_rel : float
        Relative standard deviation of the patch's luminance across the region.
    gain_index : int
        Place of its gain among the settings.
    """

    net_dn: float
    scale_per_s: float
    noise_variance_dn2: float
    dark_variance_dn2: float
    dark_nonuniformity_dn: float
    pixels_rel: float
    slow_rel: float
    gain_index: int

    @property
    def variance_dn2(self) -> float:
        """Variance of `net_dn` by all but the pixels' sensitivity: the inverse weight among exposures."""
        return self.noise_variance_dn2 + self.dark_variance_dn2 + self.dark_nonuniformity_dn**2


def net_signal(observation: PatchObservation, settings: Sequence[GainSetting]) -> NetSignal:
    """Take the darkness off an observation.

    Parameters
    ----------
    observation : PatchObservation
        Of one patch at one exposure.
    settings : sequence of GainSetting
        Darkness and noise of its gain, among others.

    Raises
    ------
    CalibrationError
        If its gain is not there.
    """
    o, index = observation, index_of_gain(settings, observation.state.gain_db)
    setting = settings[index]
    dark_dn = setting.dark.mean_dn(o.exposure_s, o.temperature_c)
    pattern_dn2 = o.fixed_pattern_variance_dn2(dark_dn)
    net_dn, power = _before_tone(o, dark_dn, pattern_dn2, setting.noise.tone)
    # What of the pattern is darkness is an offset, and known from the dark frames; the rest is sensitivity.
    dark_pattern_dn = setting.dark.pattern_dn(o.exposure_s)
    sensitivity_dn2 = max(pattern_dn2 - (dark_pattern_dn * o.mean_inverse_v) ** 2, 0.0)
    rounding = quantisation_variance_dn2(o.temporal_variance_dn2 + pattern_dn2)
    on_axis = max(abs(o.net_dn(dark_dn)), 1e-12)
    return NetSignal(
        net_dn=net_dn,
        scale_per_s=o.mean_inverse_v / o.exposure_s,
        noise_variance_dn2=setting.noise.variance_dn2(net_dn) / (o.n_pixels * o.n_frames) + rounding,
        dark_variance_dn2=setting.dark.variance_dn2(o.exposure_s, o.temperature_c),
        dark_nonuniformity_dn=hypot(setting.dark.nonuniformity_dn, dark_pattern_dn / sqrt(o.n_pixels)),
        pixels_rel=power * sqrt(sensitivity_dn2 / o.n_pixels) / on_axis,
        slow_rel=power * sqrt(o.nonuniformity_variance_dn2(dark_dn)) / on_axis,
        gain_index=index,
    )


def _before_tone(o: PatchObservation, dark_dn: float, pattern_dn2: float, tone: Response | None) -> tuple[float, float]:
    """Signal whose h is the mean over the pixels' light, and d ln h / d ln n there.

    The mean over noisy pixels of a bent response is not the response of the mean: to second order it is off by half
    the variance of the light times the curvature.
    """
    net_dn = o.net_dn_at_pixel(dark_dn)
    if tone is None or not tone.net_dn[1] <= net_dn <= tone.net_dn[-1]:
        return net_dn, 1.0
    h, slope = float(tone.linearise(net_dn)), float(tone.slope(net_dn))
    variance_dn2 = max(o.temporal_variance_dn2 - ROUNDING_DN2, 0.0) + pattern_dn2
    wide = sqrt(3 * variance_dn2)
    # The mean of h over a normal distribution by three points (Gauss and Hermite): exact to the fifth power.
    mean = (float(tone.linearise(net_dn - wide)) + 4 * h + float(tone.linearise(net_dn + wide))) / 6
    return net_dn + (mean - h) / slope, slope * net_dn / h


def usable(
    observations: Sequence[PatchObservation], settings: Sequence[GainSetting]
) -> tuple[list[PatchObservation], list[LeftOut], list[str]]:
    """Leave out the exposures at which one patch is clipped, or no brighter than the dark.

    Parameters
    ----------
    observations : sequence of PatchObservation
        Of one patch.
    settings : sequence of GainSetting
        Darkness and noise of their gains.

    Returns
    -------
    list of PatchObservation
        The usable ones.
    list of LeftOut
        The others.
    list of str
        A warning for each reason, naming patch and exposures.
    """
    kept: list[PatchObservation] = []
    left_out: list[LeftOut] = []
    reasons: dict[str, list[PatchObservation]] = {}
    for observation in observations:
        reason = _reason_to_leave_out(observation, settings)
        if reason is None:
            kept.append(observation)
        else:
            reasons.setdefault(reason, []).append(observation)
            left_out.append(LeftOut(observation.patch, observation.exposure_s, None, reason))
    return (
        kept,
        left_out,
        [
            f"patch {group[0].patch!r} {reason} at {', '.join(f'{o.exposure_s:g} s' for o in group)}: left out there"
            for reason, group in reasons.items()
        ],
    )


def temperature_warnings(observations: Sequence[PatchObservation], settings: Sequence[GainSetting]) -> list[str]:
    """Warn of observations outside the temperatures of the dark frames, where that changes the darkness.

    Parameters
    ----------
    observations : sequence of PatchObservation
        Of one patch.
    settings : sequence of GainSetting
        Darkness of their gains, among others.
    """
    by_gain: dict[int, list[PatchObservation]] = {}
    for o in observations:
        by_gain.setdefault(index_of_gain(settings, o.state.gain_db), []).append(o)
    return [
        f"patch {own[0].patch!r}: {warning}"
        for index, own in by_gain.items()
        for warning in settings[index].dark.temperature_warnings((o.exposure_s, o.temperature_c) for o in own)
    ]


def _reason_to_leave_out(observation: PatchObservation, settings: Sequence[GainSetting]) -> str | None:
    if observation.saturated_share > MAX_CLIPPED_SHARE:
        return "is saturated"
    if observation.black_share > MAX_CLIPPED_SHARE:
        return "is clipped at 0 DN"
    signal = net_signal(observation, settings)
    tone = settings[signal.gain_index].noise.tone
    if tone is not None and not tone.net_dn[1] <= signal.net_dn <= tone.net_dn[-1]:
        return "is outside the signals that the response of the bracket covers"
    if signal.net_dn <= MIN_NET_SIGNAL * sqrt(signal.variance_dn2):
        return "is not brighter than the dark"
    return None
