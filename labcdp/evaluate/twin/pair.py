"""A pair of patches: measured and predicted CDP, and the uncertainty of their difference."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.quantity import Z_95
from ...metrics import Cdp, Distribution
from ...metrics.contrast import checked_contrast, detected_ratios
from ...metrics.detection import count_cdp
from ...metrics.pixel_pairs import count_pairs, share_inside
from .prediction import RegionPrediction, added, scaled
from .regions import CameraPatch

#: Whether prediction and measurement agree.
TwinJudgement: TypeAlias = Literal["agree", "differ", "undecided"]
#: Share of all possible CDPs inside the joint interval above which a pair is undecided.
_VACUOUS = 0.8
#: Weight of one outlying pixel, as in the intervals of `labcdp.metrics`.
_OUTLIER_WEIGHT = 0.1
#: Relative errors of two luminances that differ by less than this cancel in their contrast.
_CANCELLED = 1e-9


@dataclass(frozen=True)
class PairRequest:
    """A pair to compare.

    Parameters
    ----------
    bright, dark : str
        The patches.
    contrast, epsilon : float
        Weber contrast to be detected, a fraction, and its tolerance.
    meter_contrast : float
        Weber contrast of the two by the meter.
    """

    bright: str
    dark: str
    contrast: float
    epsilon: float
    meter_contrast: float


@dataclass(frozen=True)
class TwinPair(PairRequest):
    """CDP of a pair of patches, measured and predicted.

    Parameters
    ----------
    exposure_s : float
        Exposure of the frames.
    frame_number, dark_frame_number : int
        Frames of the bright and of the dark patch.
    measured : Cdp
        CDP by the camera; its interval is for the finite number of pixels.
    predicted : float
        CDP by the twin, for an infinite region.
    u_predicted : float
        Standard uncertainty of the prediction by the parameters of the twin and the meter's readings.
    u_pixels : float
        Scatter of the CDP of this number of pixels around its expectation, by the twin.
    """

    exposure_s: float
    frame_number: int
    dark_frame_number: int
    measured: Cdp[float]
    predicted: float
    u_predicted: float
    u_pixels: float

    @property
    def name(self) -> str:
        """Names of both patches."""
        return f"{self.bright} / {self.dark}"

    @property
    def difference(self) -> float:
        """Measured less predicted."""
        return self.measured.cdp - self.predicted

    @property
    def u_difference(self) -> float:
        """Standard uncertainty of the difference."""
        return hypot(self.u_predicted, self.u_pixels)

    @property
    def z(self) -> float:
        """Difference in its standard uncertainties."""
        return self.difference / self.u_difference

    @property
    def predicted_interval(self) -> tuple[float, float]:
        """95 % interval of the prediction, inside 0 to 1."""
        half_width = Z_95 * self.u_predicted
        return max(self.predicted - half_width, 0.0), min(self.predicted + half_width, 1.0)

    @property
    def judgement(self) -> TwinJudgement:
        """Whether 0 lies in the 95 % interval of the difference; undecided if nearly any CDP would agree.

        This depends only on the prediction, so leaving out undecided pairs does not bias the result.
        """
        half_width = Z_95 * self.u_difference
        agreeing = min(self.predicted + half_width, 1.0) - max(self.predicted - half_width, 0.0)
        if agreeing >= _VACUOUS:
            return "undecided"
        return "agree" if abs(self.z) <= Z_95 else "differ"


def compare_pair(
    pair: PairRequest, seen: tuple[CameraPatch, CameraPatch], predicted: tuple[RegionPrediction, RegionPrediction]
) -> TwinPair:
    """Compare measured and predicted CDP of two patches, the bright one first.

    Parameters
    ----------
    pair : PairRequest
        The pair to compare.
    seen : (CameraPatch, CameraPatch)
        Measured luminances.
    predicted : (RegionPrediction, RegionPrediction)
        Predicted ones.

    Notes
    -----
    The variance of the difference has two parts. One is the scatter of a CDP of m dark and n bright pixels around its
    expectation, the two-sample U-statistic's variance [(n - 1) zeta10 + (m - 1) zeta01 + zeta11] / (m n) (Hoeffding
    1948), taken from the twin's distributions: temporal noise and the unknown fixed pattern of the specimen. As in a
    score interval, the predicted distributions are used, so that it does not vanish where a region happens to hold no
    outlying pixel and the measured CDP is 0 or 1; a tenth of the variance of one outlying pixel in the smaller region
    is added. The other is the uncertainty of the parameters and readings, each shifted by a standard uncertainty to
    both sides; its variance is the mean square of the two changes, which does not vanish at a maximum of the CDP.
    """
    contrast = checked_contrast(pair.contrast, pair.epsilon)
    ratios = detected_ratios(contrast, pair.epsilon)
    bright, dark = (Distribution.from_array(region.luminance_cd_m2) for region in seen)
    best = predicted[0].best, predicted[1].best
    expected = share_inside(*best, ratios)
    m, n = seen[1].luminance_cd_m2.size, seen[0].luminance_cd_m2.size
    by_pixels = sampling_variance(*best, ratios, m, n) + _OUTLIER_WEIGHT / min(m, n) ** 2
    by_parameters = sum(
        float(np.mean([(share_inside(b, d, ratios) - expected) ** 2 for b, d in both]))
        for both in _shifted(predicted, seen).values()
    )
    return TwinPair(
        **vars(pair),
        exposure_s=seen[0].exposure_s,
        frame_number=seen[0].frame_number,
        dark_frame_number=seen[1].frame_number,
        measured=count_cdp(bright, dark, [contrast], pair.epsilon)[0],
        predicted=expected,
        u_predicted=sqrt(by_parameters),
        u_pixels=sqrt(by_pixels),
    )


def _shifted(
    predicted: tuple[RegionPrediction, RegionPrediction], seen: tuple[CameraPatch, CameraPatch]
) -> dict[str, list[tuple[Distribution, Distribution]]]:
    """Distributions of the two patches with one parameter lower, and higher, by its name."""
    bright, dark = (dict(region.shifted) for region in predicted)
    errors = [
        (a, b) for a, b in zip(seen[0].errors, seen[1].errors, strict=True) if abs(a.relative - b.relative) > _CANCELLED
    ]
    if any(a.is_additive for a, _ in errors):
        # The calibration knows more about it: temperature, and its effect on the fit.
        del bright["dark signal"], dark["dark signal"]
    for number, (a, b) in enumerate(errors):
        name = f"{a.source} of the calibration ({number})"
        for shifted, best, error in ((bright, predicted[0].best, a), (dark, predicted[1].best, b)):
            shifted[name] = added(best, error.luminance_cd_m2) if error.is_additive else scaled(best, error.relative)
    unchanged = [(region.best, region.best) for region in predicted]
    return {
        name: list(zip(bright.get(name, unchanged[0]), dark.get(name, unchanged[1]), strict=True))
        for name in bright | dark
    }


def sampling_variance(bright: Distribution, dark: Distribution, ratios: tuple[float, float], m: int, n: int) -> float:
    """Variance of the share of pairs inside an interval, of m dark and n bright pixels drawn from two distributions."""
    (_, u, _), per_dark, per_bright = count_pairs(bright, dark, ratios)

    def variance(shares: NDArray[np.float64], region: Distribution) -> float:
        return float(np.average((shares - u) ** 2, weights=region.weights))

    by_dark, by_bright = variance(per_dark, dark), variance(per_bright, bright)
    return float(((n - 1) * by_dark + (m - 1) * by_bright + u * (1 - u)) / (m * n))
