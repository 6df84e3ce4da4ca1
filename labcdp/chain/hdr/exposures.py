"""HDR: several exposures of one scene merged into one capture of a larger range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import get_args

from ...core.disk.quoting import shown
from ...core.errors import InputError
from ..capture import Capture
from ..parameters import check_whole
from .merge import ExposureLadder, Method, merge_dn


@dataclass(frozen=True)
class Hdr:
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
    """

    method: Method
    bits: int = 20

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise InputError(f"method is {shown(self.method)}: give one of {', '.join(get_args(Method))}")
        check_whole("bits", self.bits, "bits", 1, 48)

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
        _check_alike(ordered)
        longest = ordered[0]
        ladder = ExposureLadder(
            tuple(capture.exposure_s for capture in ordered),
            longest.saturation_dn - longest.black_level_dn,
            longest.k_dn_per_e,
        )
        exposures_dn = [capture.dn - capture.black_level_dn for capture in ordered]
        return replace(
            longest,
            dn=merge_dn(self.method, self.bits, exposures_dn, ladder),
            black_level_dn=0.0,
            dark_dn=longest.dark_dn - longest.black_level_dn,
            saturation_dn=self.saturation_dn(ladder),
            dark_noise_dn=longest.dark_noise_dn * self._noise_factor(ladder),
        )

    def saturation_dn(self, ladder: ExposureLadder) -> float:
        """Return the merged DN from which a pixel counts as saturated: where the shortest one is, or the range ends."""
        if self.method == "normal":
            return float(min(ladder.merged_saturation_dn // 1, 2**self.bits - 1))
        return ladder.merged_saturation_dn

    def _noise_factor(self, ladder: ExposureLadder) -> float:
        """Noise in dark signal over that of the longest exposure."""
        if self.method == "normal":
            return 1.0
        if self.method == "linear":
            return sqrt(sum(ratio**2 for ratio in ladder.ratios)) / len(ladder)
        left, variance = 1.0, 0.0
        for ratio, share in zip(ladder.ratios, ladder.shares, strict=True):
            variance += (left * share * ratio) ** 2
            left *= 1 - share
        return sqrt(variance)


def _check_alike(captures: Sequence[Capture]) -> None:
    """Refuse no captures at all, and captures that do not belong together."""
    if not captures:
        raise InputError("there is no exposure to merge: give at least one")
    for name in ("k_dn_per_e", "black_level_dn", "saturation_dn"):
        values = [getattr(capture, name) for capture in captures]
        if len(set(values)) > 1:
            raise InputError(f"{name} differs between the captures: {values}; merge captures of one gain and sensor")
    shapes = {capture.dn.shape for capture in captures}
    if len(shapes) > 1:
        raise InputError(f"the captures have the shapes {sorted(shapes)}: merge captures of one size")
