"""Measured and predicted CDP of a pair of patches, compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from ..contrast import Distribution
from ..contrast.detection import result_of_tally
from ..contrast.interval import AskedContrast
from ..contrast.pairs import PairTally, tally_pairs
from .twin_diagnosis import Finding
from .twin_pair import SAMPLING, Influence, Mended, PairAsked, TwinPair
from .twin_prediction import RegionPrediction, added, scaled

FloatArray = NDArray[np.float64]

#: Weight of one outlying pixel, as in the intervals of `labcdp.contrast`.
_OUTLIER_WEIGHT = 0.1
#: Relative errors of two luminances that differ by less cancel in their contrast.
_CANCELLED = 1e-9
#: Share of a variance below which a parameter is not worth a word.
_NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class RegionError:
    """One error that all luminances of a calibration share, in one region.

    Parameters
    ----------
    source : str
        Where it comes from.
    luminance_cd_m2 : float
        Signed error of the region's mean for one standard uncertainty.
    relative : float
        The same over the mean.
    """

    source: str
    luminance_cd_m2: float
    relative: float

    @property
    def of_darkness(self) -> bool:
        """Whether it is the same luminance for all pixels, and not the same share."""
        return self.source.startswith("dark")


@dataclass(frozen=True, eq=False)
class SeenRegion:
    """A patch as the camera saw it.

    Parameters
    ----------
    luminance_cd_m2 : ndarray of float, shape (n,)
        Calibrated luminance of its pixels in one frame.
    exposure_s : float
        Exposure of the frame.
    frame_number : int
        Its number in the session.
    errors : tuple of RegionError
        What the calibration's common errors make of its mean, in the order of the luminance map.
    """

    luminance_cd_m2: FloatArray
    exposure_s: float
    frame_number: int
    errors: tuple[RegionError, ...]


def compare_pair(
    pair: PairAsked,
    seen: tuple[SeenRegion, SeenRegion],
    predicted: tuple[RegionPrediction, RegionPrediction],
) -> TwinPair:
    """Compare measured and predicted CDP of two patches, the bright one first.

    Parameters
    ----------
    pair : PairAsked
        What to compare.
    seen : (SeenRegion, SeenRegion)
        Measured luminances.
    predicted : (RegionPrediction, RegionPrediction)
        Predicted ones.

    Notes
    -----
    The difference of the two has two parts. One is the scatter of a CDP of m dark and n bright pixels around its
    expectation, the two-sample U-statistic's variance [(n - 1) zeta10 + (m - 1) zeta01 + zeta11] / (m n) (Hoeffding
    1948), taken from the twin's distributions: temporal noise and the fixed pattern of a specimen that nobody knows. As
    in a score interval it is that of the prediction, which does not vanish where a region by chance holds no outlying
    pixel and the measured CDP is 0 or 1; a tenth of the variance of one outlying pixel in the smaller region is added.
    The other is that of the parameters and readings, each shifted by a standard uncertainty to both sides; the mean
    square of the two changes is its variance, so that a maximum of the CDP counts too.
    """
    asked = AskedContrast(pair.contrast, pair.epsilon, "weber")

    def tally(bright: Distribution, dark: Distribution) -> PairTally:
        return _tally(pair, bright, dark)

    bright, dark = (Distribution.from_array(region.luminance_cd_m2) for region in seen)
    measured = result_of_tally(tally(bright, dark), bright, dark, "a", asked)
    best = tally(predicted[0].best, predicted[1].best)
    changes = {
        name: [tally(b, d).inside - best.inside for b, d in both]
        for name, both in _shifted(pair, predicted, seen).items()
    }
    m, n = seen[1].luminance_cd_m2.size, seen[0].luminance_cd_m2.size
    sampling = sampling_variance(best, predicted[0].best, predicted[1].best, m, n) + _OUTLIER_WEIGHT / min(m, n) ** 2
    by_parameter = {name: float(np.mean(np.square(both))) for name, both in changes.items()}
    total = sampling + sum(by_parameter.values())
    difference = measured.cdp - best.inside
    influences = [
        _influence(name, changes[name], variance, total, difference)
        for name, variance in by_parameter.items()
        if variance > _NEGLIGIBLE * total
    ]
    influences.append(
        Influence(SAMPLING, sqrt(sampling), sqrt(sampling), sampling / total, difference / sqrt(sampling))
    )
    return TwinPair(
        asked=pair,
        exposure_s=seen[0].exposure_s,
        frame_number=seen[0].frame_number,
        dark_frame_number=seen[1].frame_number,
        measured=measured,
        predicted=best.inside,
        predicted_standard_uncertainty=sqrt(sum(by_parameter.values())),
        sampling_standard_uncertainty=sqrt(sampling),
        influences=tuple(sorted(influences, key=lambda one: -one.share)),
    )


#: Findings, and the luminance of patches by a twin that is as they ask.
MendedPrediction = tuple[Sequence[Finding], Mapping[str, Distribution]]


def with_mended(pair: TwinPair, mended: Sequence[MendedPrediction]) -> TwinPair:
    """Return a pair that differs with the change of the twin that explains it best.

    Parameters
    ----------
    pair : TwinPair
        The pair.
    mended : sequence of (sequence of Finding, dict of str to Distribution)
        Changes, the simplest ones first.
    """
    tried = [_mended(pair, findings, patches) for findings, patches in mended]
    closing = next((one for one in tried if pair.is_closed_by(one)), None)
    best = closing or min(tried, key=pair.left_by, default=None)
    # Less than half closer is no explanation.
    if best is None or pair.left_by(best) > abs(pair.difference) / pair.joint_standard_uncertainty / 2:
        return pair
    return replace(pair, mended=best)


def _mended(pair: TwinPair, findings: Sequence[Finding], patches: Mapping[str, Distribution]) -> Mended:
    predicted = _tally(pair.asked, patches[pair.asked.bright], patches[pair.asked.dark]).inside
    return Mended(
        name=" and the ".join(one.name for one in findings),
        change=" and ".join(f"{one.needed:.4g} {one.unit} instead of {one.stated:.4g}" for one in findings),
        predicted=predicted,
        # The change is known as well as what is needed is: to one part in z.
        standard_uncertainty=abs(predicted - pair.predicted) / min(abs(one.z) for one in findings),
    )


def _tally(pair: PairAsked, bright: Distribution, dark: Distribution) -> PairTally:
    asked = AskedContrast(pair.contrast, pair.epsilon, "weber")
    return tally_pairs(bright, dark, asked.low, asked.high)


def _shifted(
    pair: PairAsked,
    predicted: tuple[RegionPrediction, RegionPrediction],
    seen: tuple[SeenRegion, SeenRegion],
) -> dict[str, list[tuple[Distribution, Distribution]]]:
    """Distributions of the two patches with one parameter lower, and higher, by its name."""
    bright, dark = predicted
    shifted = {
        name: [(low, dark.shifted[name][0]), (high, dark.shifted[name][1])]
        for name, (low, high) in bright.shifted.items()
    }
    for what, both in bright.own.items():
        shifted[f"{what} {pair.bright}"] = [(one, dark.best) for one in both]
    for what, both in dark.own.items():
        shifted[f"{what} {pair.dark}"] = [(bright.best, one) for one in both]
    errors = _not_cancelling(seen)
    if any(in_bright.of_darkness for in_bright, _ in errors):
        # The calibration tells more of it: temperature, and what it does to the fit.
        del shifted["darkness"]
    sources = [in_bright.source for in_bright, _ in errors]
    for number, (in_bright, in_dark) in enumerate(errors):
        source, of_source = sources[number], sources[: number + 1].count(sources[number])
        name = f"{source} of the calibration" + (f", part {of_source}" if sources.count(source) > 1 else "")
        shifted[name] = [(_erring(bright.best, in_bright, sign), _erring(dark.best, in_dark, sign)) for sign in (-1, 1)]
    return shifted


def _not_cancelling(seen: tuple[SeenRegion, SeenRegion]) -> list[tuple[RegionError, RegionError]]:
    """Errors of the calibration that leave a trace in the contrast of two regions."""
    both = zip(seen[0].errors, seen[1].errors, strict=True)
    return [(a, b) for a, b in both if abs(a.relative - b.relative) > _CANCELLED]


def _erring(best: Distribution, error: RegionError, sign: int) -> Distribution:
    if error.of_darkness:
        return added(best, sign * error.luminance_cd_m2)
    return scaled(best, sign * error.relative)


def _influence(name: str, both: list[float], variance: float, total: float, difference: float) -> Influence:
    low, high = both
    change = (high - low) / 2
    # Towards the difference; a change that has one sign on both sides cannot close one of the other sign.
    able = [(side, by) for side, by in ((-1, low), (1, high)) if by * difference > 0]
    shift = min((side * difference / by for side, by in able), key=abs, default=inf)
    return Influence(name, change, sqrt(variance), variance / total, shift)


def sampling_variance(tally: PairTally, bright: Distribution, dark: Distribution, m: int, n: int) -> float:
    """Variance of the share of m dark and n bright pixels drawn from the two distributions."""
    u = tally.inside

    def variance(shares: FloatArray, region: Distribution) -> float:
        return float(np.average((shares - u) ** 2, weights=region.weights))

    of_dark, of_bright = variance(tally.inside_per_dark, dark), variance(tally.inside_per_bright, bright)
    return ((n - 1) * of_dark + (m - 1) * of_bright + u * (1 - u)) / (m * n)
