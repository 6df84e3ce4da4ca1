"""Merging exposures of one scene, value by value: pure functions on arrays of any shape.

All values are digital numbers without the black level. A merged value has the scale of the longest exposure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..parameters import check_number

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
            check_number("exposure_s", exposure_s, "s", 0, above=True)
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

    @cached_property
    def shares(self) -> tuple[float, ...]:
        """Share of each exposure in the "weighted" mean of itself and all shorter ones; 1 for the shortest.

        The weights are inverse variances, t^2 / (dark variance + shot variance), the latter proportional to t.
        """
        weights = [r**-2 / (1 + _SHOT_OVER_DARK_VARIANCE / r) for r in self.ratios]
        return tuple(weights[i] / sum(weights[i:]) for i in range(len(weights)))


def merge_dn(method: Method, bits: int, exposures_dn: Sequence[NDArray[Any]], ladder: ExposureLadder) -> NDArray[Any]:
    """Merge the values of all exposures; see `labcdp.chain.hdr.exposures.Hdr` for the methods.

    Parameters
    ----------
    method : {"normal", "linear", "weighted"}
        How to merge.
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
    last = len(ladder) - 1
    if method == "normal":
        chosen, _ = normal_stage(exposures_dn[last], last, bits, ladder)
        for i in reversed(range(last)):
            own, taken = normal_stage(exposures_dn[i], i, bits, ladder)
            chosen = np.where(taken, own, chosen)
        return chosen
    if method == "weighted":
        merged, _ = weighted_stage(exposures_dn[last], last, ladder)
        for i in reversed(range(last)):
            own_part, rest = weighted_stage(exposures_dn[i], i, ladder)
            merged = own_part + rest * merged
        return _without_rounding(merged)
    usable: Any = True
    total: Any = 0.0
    count: Any = 0
    for i in reversed(range(last + 1)):
        usable = usable & (exposures_dn[i] < ladder.saturation_dn)
        total = total + np.where(usable, ladder.ratios[i] * exposures_dn[i], 0.0)
        count = count + usable
    mean: FloatArray = np.where(count > 0, total / np.maximum(count, 1), ladder.merged_saturation_dn)
    return _without_rounding(mean)


def _without_rounding(merged: FloatArray) -> FloatArray:
    """Make 0 of what only rounding keeps from it: pixels at and above dark signal count differently."""
    exact: FloatArray = np.where(np.abs(merged) < ZERO_DN, 0.0, merged)
    return exact


def normal_stage(
    dn: NDArray[Any], i: int, bits: int, ladder: ExposureLadder
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Value of exposure `i` for "normal", and where it is taken if no longer one was."""
    scaled = dn * ladder.ratios[i]
    # A product that should be whole must not fall just short of it.
    whole = np.floor(scaled + np.abs(scaled) * (4 * np.finfo(np.float64).eps))
    value = np.minimum(whole, 2**bits - 1).astype(np.int64)
    if i == len(ladder) - 1:
        return value, np.ones(value.shape, dtype=np.bool_)
    threshold = 2 ** (bits / len(ladder) * (i + 1))
    return value, (scaled <= threshold) & (dn < ladder.saturation_dn)


def weighted_stage(dn: NDArray[Any], i: int, ladder: ExposureLadder) -> tuple[FloatArray, FloatArray]:
    """Return what exposure `i` adds to the "weighted" value, and the factor of the value merged from all shorter ones.

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
