"""HDR: several exposures of one scene merged into one capture of a larger range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import hypot
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.disk.files import shown
from ..core.errors import InputError
from .parameters import MergedBits, Number, Parameters
from .signal import Capture

FloatArray = NDArray[np.float64]

Method: TypeAlias = Literal["normal", "linear", "weighted"]

#: The weights of "weighted" are best where the shot noise of the longest exposure has this many times the variance
#: of its dark noise. With 2 the SNR of up to four exposures stays within 5 % of the best weights at any signal, for
#: ratios of 2 to 16: the best weights lean to the longest exposure (t^2) in the dark and to equal photons (t) in light.
_SHOT_OVER_DARK_VARIANCE = 2.0

#: Merged values closer to 0 are 0.
ZERO_DN = 1e-9

#: Fraction of the range of an exposure from which "weighted" fades it out. Half the range is hundreds of standard
#: deviations of any sensor's noise, so the SNR has no step.
FADE_FROM = 0.5


@dataclass(frozen=True)
class ExposureLadder:
    """Exposures of one sensor at one gain, longest first.

    Parameters
    ----------
    exposures_s : tuple of float
        Exposure times in seconds, falling.
    saturation_dn : float
        DN above black level from which a pixel counts as clipped.
    k_dn_per_e : float
        Overall system gain, DN per electron.

    Raises
    ------
    InputError
        If there is no exposure, one is not above 0, two are equal or in the wrong order, or the saturation is not
        above 0.
    """

    exposures_s: tuple[float, ...]
    saturation_dn: float
    k_dn_per_e: float

    def __post_init__(self) -> None:
        if not self.exposures_s:
            raise InputError("there is no exposure to merge: give at least one")
        for exposure_s in self.exposures_s:
            Number("s", 0, above=True).check("exposure_s", exposure_s)
        if any(longer <= shorter for longer, shorter in pairwise(self.exposures_s)):
            raise InputError(f"the exposures {self.exposures_s} s are not all different: leave out repeated ones")
        if self.saturation_dn <= 0:
            raise InputError(
                f"saturation is at {self.saturation_dn:g} DN above the black level: give a sensor that has a range"
            )

    def __len__(self) -> int:
        return len(self.exposures_s)

    @cached_property
    def ratios(self) -> tuple[float, ...]:
        """Longest exposure time over that of each exposure: 1 and rising."""
        return tuple(self.exposures_s[0] / exposure_s for exposure_s in self.exposures_s)

    @property
    def merged_saturation_dn(self) -> float:
        """Where the shortest exposure saturates, on the scale of the longest."""
        return self.saturation_dn * self.ratios[-1]

    def factors(self, method: Method, first: int = 0) -> list[float]:
        """Factors of the DN from exposure `first` on in "linear" or "weighted", where none is clipped or fading."""
        ratios = self.ratios[first:]
        if method == "linear":
            return [ratio / len(ratios) for ratio in ratios]
        left, factors = 1.0, []
        for ratio, share in zip(ratios, self.shares[first:], strict=True):
            factors.append(left * share * ratio)
            left *= 1 - share
        return factors

    @cached_property
    def shares(self) -> tuple[float, ...]:
        """Share of each exposure in the "weighted" mean of itself and all shorter ones; 1 for the shortest.

        The weights are inverse variances, t^2 / (dark variance + shot variance), the latter proportional to t.
        """
        weights = [r**-2 / (1 + _SHOT_OVER_DARK_VARIANCE / r) for r in self.ratios]
        return tuple(weights[i] / sum(weights[i:]) for i in range(len(weights)))


def merge_dn(method: Method, bits: int, exposures_dn: Sequence[NDArray[Any]], ladder: ExposureLadder) -> NDArray[Any]:
    """Merge the values of all exposures; see `Hdr` for the methods.

    Parameters
    ----------
    method : {"normal", "linear", "weighted"}
        Merge method.
    bits : int
        Bits of the merged value; only "normal" has a limited range.
    exposures_dn : sequence of ndarray
        DN without black level, longest exposure first, of shapes that broadcast together.
    ladder : ExposureLadder
        The exposures.

    Returns
    -------
    ndarray of int64 for "normal", else float64
    """
    if method == "normal":
        chosen: NDArray[Any] = np.zeros((), np.int64)
        for i in reversed(range(len(ladder))):
            stage_dn, taken = normal_stage(exposures_dn[i], i, bits, ladder)
            chosen = np.where(taken, stage_dn, chosen)
        return chosen
    stage = weighted_stage if method == "weighted" else linear_stage
    merged = mix(method, [stage(dn, i, ladder) for i, dn in enumerate(exposures_dn)], ladder)
    # Only rounding keeps some from 0, and pixels at and above dark signal count differently.
    return np.where(np.abs(merged) < ZERO_DN, 0.0, merged)


def mix(method: Method, stages: Sequence[tuple[FloatArray, FloatArray]], ladder: ExposureLadder) -> FloatArray:
    """Merge what `linear_stage` or `weighted_stage` returned for each exposure, longest first."""
    merged: Any = 0.0
    if method == "weighted":
        for own_part, rest in reversed(stages):
            merged = own_part + rest * merged
        return np.asarray(merged)
    usable: Any = 1.0
    count: Any = 0.0
    for scaled, not_clipped in reversed(stages):
        usable = usable * not_clipped
        merged = merged + usable * scaled
        count = count + usable
    mean: FloatArray = merged / np.maximum(count, 1.0) + (count == 0) * ladder.merged_saturation_dn
    return mean


def linear_stage(dn: NDArray[Any], i: int, ladder: ExposureLadder) -> tuple[FloatArray, FloatArray]:
    """Return the scaled DN of exposure `i`, and 1 where it is not clipped, else 0."""
    return dn * ladder.ratios[i], (dn < ladder.saturation_dn).astype(np.float64)


def normal_stage(
    dn: NDArray[Any], i: int, bits: int, ladder: ExposureLadder
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the scaled value of exposure `i` for "normal", and where it may be taken."""
    scaled = dn * ladder.ratios[i]
    # A product that should be whole must not fall just short of it.
    whole = np.floor(scaled + np.abs(scaled) * (4 * np.finfo(np.float64).eps))
    value = np.minimum(whole, 2**bits - 1).astype(np.int64)
    if i == len(ladder) - 1:
        return value, np.ones(value.shape, dtype=np.bool_)
    threshold = 2 ** (bits / len(ladder) * (i + 1))
    return value, (scaled <= threshold) & (dn < ladder.saturation_dn)


def weighted_stage(dn: NDArray[Any], i: int, ladder: ExposureLadder) -> tuple[FloatArray, FloatArray]:
    """Return the term of exposure `i` in the "weighted" value, and the factor of the merge of all shorter ones.

    An exposure is faded out by its own noisy value, which alone would bias the mean: it counts less where noise made
    it bright. For Poisson counts E[N f(N - 1)] = E[N] E[f(N)] (Chen 1975, Ann. Probab. 3, 534), so taking the share
    at one electron less for the exposure itself, but not for the others, removes that bias at any width of the fade.
    """
    scaled = dn * ladder.ratios[i]
    if i == len(ladder) - 1:
        clipped = dn >= ladder.saturation_dn
        return np.where(clipped, ladder.merged_saturation_dn, scaled), np.zeros(np.shape(dn))
    own_share = np.where(dn < ladder.saturation_dn, faded_share(dn - ladder.k_dn_per_e, i, ladder), 0.0)
    return scaled * own_share, 1 - faded_share(dn, i, ladder)


def faded_share(dn: NDArray[Any], i: int, ladder: ExposureLadder) -> FloatArray:
    """Share of exposure `i`: constant, then falling smoothly (3 x^2 - 2 x^3) to 0 one electron before it clips."""
    begin = FADE_FROM * ladder.saturation_dn
    width = max(ladder.saturation_dn - ladder.k_dn_per_e - begin, 1e-6)
    left = np.clip((begin + width - np.asarray(dn, dtype=np.float64)) / width, 0.0, 1.0)
    share: FloatArray = ladder.shares[i] * left**2 * (3 - 2 * left)
    return share


@dataclass(frozen=True)
class Hdr(Parameters):
    """How exposures are merged; the result has the scale of the longest exposure, without black level.

    Parameters
    ----------
    method : {"normal", "linear", "weighted"}
        "normal": the longest exposure, or where it exceeds 2^(bits / n) of n exposures or is clipped, the next shorter
        one times the ratio of the exposure times, and so on with 2^(2 bits / n), ...; whole numbers, rounded down
        after the test, up to 2^bits - 1. L. Ebbert, Implementierung von CDP, 2018; that clipped pixels are left is
        ours. Values below black level stay negative, so that dark signal has no bias.
        "linear": mean of DN / exposure time over the exposures, times the longest time; also there. Ours leaves out
        a clipped exposure and all longer ones.
        "weighted": mean with weights of nearly the least variance, in which each exposure fades out over the upper
        half of its range before it clips. The SNR has no step where one exposure takes over from another, as it has
        in the other two; it still falls there, as the shorter exposure has fewer photons. After Hanji, Zhong and
        Mantiuk, Noise-aware merging of high dynamic range image stacks, 2020, whose weights t are the best for shot
        noise and t^2 for read noise.
    bits : int
        Bits of the merged value, 1 to 48.

    Raises
    ------
    InputError
        If the method is not known or bits out of range.

    Notes
    -----
    In "normal" and "linear" the noise of an exposure decides whether it is taken, so their mean is low where the choice
    is open: by 0.7 to 3 % within some standard deviations of a threshold of "normal" (8 % where dark current makes
    most of the noise), by 0.1 to 0.2 % just below the saturation of an exposure for "linear". "weighted" stays within
    0.05 %.

    Examples
    --------
    >>> from labcdp.chain import Hdr
    >>> Hdr("weighted").bits
    20
    """

    method: Method
    bits: MergedBits = 20

    def __post_init__(self) -> None:
        if not isinstance(self.method, str) or self.method not in get_args(Method):
            raise InputError(f"method is {shown(self.method)}: give one of {', '.join(get_args(Method))}", key="method")
        super().__post_init__()

    def merge(self, captures: Sequence[Capture]) -> Capture:
        """Merge captures of one scene.

        Parameters
        ----------
        captures : sequence of Capture
            In any order, of one sensor at one gain.

        Returns
        -------
        Capture
            `dn` is int64 for "normal", else float64. Pixels clipped in all exposures are at its `saturation_dn`, or
            for "normal" above.

        Raises
        ------
        InputError
            If no capture is given, exposure times are equal or not above 0, or shapes, gains, black levels or
            saturations differ.
        """
        ordered = sorted(captures, key=lambda capture: -capture.exposure_s)
        if not ordered:
            raise InputError("there is no exposure to merge: give at least one")
        _check_alike(ordered)
        longest = ordered[0]
        ladder = ExposureLadder(
            tuple(capture.exposure_s for capture in ordered),
            longest.saturation_dn - longest.black_level_dn,
            longest.k_dn_per_e,
        )
        # Of a whole number, values below black level would wrap around.
        exposures_dn = [capture.dn - float(capture.black_level_dn) for capture in ordered]
        return replace(
            longest,
            dn=merge_dn(self.method, self.bits, exposures_dn, ladder),
            black_level_dn=0.0,
            dark_dn=longest.dark_dn - longest.black_level_dn,
            saturation_dn=self.saturation_dn(ladder),
            dark_noise_dn=longest.dark_noise_dn
            * (1.0 if self.method == "normal" else hypot(*ladder.factors(self.method))),
        )

    def saturation_dn(self, ladder: ExposureLadder) -> float:
        """Return the merged DN from which a pixel counts as saturated: where the shortest one is, or the range ends."""
        if self.method == "normal":
            return float(min(ladder.merged_saturation_dn // 1, 2**self.bits - 1))
        return ladder.merged_saturation_dn


def _check_alike(captures: Sequence[Capture]) -> None:
    """Refuse captures that do not belong together."""
    for name in ("k_dn_per_e", "black_level_dn", "saturation_dn"):
        values = [getattr(capture, name) for capture in captures]
        if len(set(values)) > 1:
            raise InputError(f"{name} differs between the captures: {values}; merge captures of one gain and sensor")
    shapes = {capture.dn.shape for capture in captures}
    if len(shapes) > 1:
        raise InputError(f"the captures have the shapes {sorted(shapes)}: merge captures of one size")
