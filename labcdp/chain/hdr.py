"""HDR: several captures of one scene merged into one of a larger range."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from math import hypot
from typing import Annotated, Any, Literal, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.disk.files import shown
from ..core.errors import InputError
from .parameters import MergedBits, Number, Parameters, Ratio
from .signal import Capture

FloatArray = NDArray[np.float64]

Method: TypeAlias = Literal["normal", "linear", "weighted", "most-sensitive"]

#: The weights of "weighted" are best where the shot noise of the longest exposure has this many times the variance
#: of its dark noise. With 2 the SNR of up to four exposures stays within 5 % of the best weights at any signal, for
#: ratios of 2 to 16: the best weights lean to the longest exposure (t^2) in the dark and to equal photons (t) in light.
_SHOT_OVER_DARK_VARIANCE = 2.0

#: Merged values closer to 0 are 0.
ZERO_DN = 1e-9

#: Fraction of the range of an exposure from which "weighted" fades it out. Half the range is hundreds of standard
#: deviations of any sensor's noise, so the SNR has no step.
FADE_FROM = 0.5


#: Dark signal of two captures that differs by less than this share of it is in proportion to their sensitivities.
_SAME_DARK_REL = 1e-9


@dataclass(frozen=True)
class CaptureLadder:
    """Captures of one scene, most sensitive first.

    Parameters
    ----------
    sensitivities_s : tuple of float
        Signal in DN of each capture over that of a second at the sensor's own gain, falling: the exposure times of
        exposures of one photodiode at one gain.
    saturations_dn : tuple of float
        DN above `zeros_dn` from which a pixel of each capture counts as clipped.
    k_dn_per_e : tuple of float
        Overall system gain of each, DN per electron.
    dark_noises_dn : tuple of float
        Standard deviation of the temporal noise of each at zero exposure, DN, or anything in proportion to it.
    zeros_dn : tuple of float
        DN of each that stand for 0 of the merged value: the black level, and dark signal in excess of what the most
        sensitive capture has in proportion.

    Raises
    ------
    InputError
        If there is no capture, a sensitivity is not above 0, two are equal or in the wrong order, a saturation is not
        above 0, or a capture saturates before a more sensitive one.
    """

    sensitivities_s: tuple[float, ...]
    saturations_dn: tuple[float, ...]
    k_dn_per_e: tuple[float, ...]
    dark_noises_dn: tuple[float, ...]
    zeros_dn: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.sensitivities_s:
            raise InputError("there is no exposure to merge: give at least one")
        for sensitivity_s in self.sensitivities_s:
            Number("s", 0, above=True).check("exposure_s", sensitivity_s)
        if any(more <= less for more, less in pairwise(self.sensitivities_s)):
            raise InputError(
                f"the exposures {self.sensitivities_s} s are not all different, times gain and light: leave out "
                "repeated ones"
            )
        for saturation_dn in self.saturations_dn:
            if saturation_dn <= 0:
                raise InputError(
                    f"saturation is at {saturation_dn:g} DN above the black level: give a sensor that has a range"
                )
        ends = [saturation_dn * ratio for saturation_dn, ratio in zip(self.saturations_dn, self.ratios, strict=True)]
        for number, (end, next_end) in enumerate(pairwise(ends), 2):
            if next_end <= end:
                raise InputError(
                    f"of the captures, most sensitive first, number {number} saturates at less light than the one "
                    "before and never counts: leave it out, or give it a larger full well or less sensitivity"
                )

    @classmethod
    def of_exposures(cls, exposures_s: Sequence[float], saturation_dn: float, k_dn_per_e: float) -> Self:
        """Return the ladder of exposures of one photodiode at one gain, longest first."""
        alike = (1.0,) * len(exposures_s)
        return cls(
            tuple(exposures_s),
            tuple(saturation_dn * one for one in alike),
            tuple(k_dn_per_e * one for one in alike),
            alike,
            tuple(0.0 for _ in alike),
        )

    @classmethod
    def of_captures(cls, captures: Sequence[Capture]) -> Self:
        """Return the ladder of captures that stand in order, most sensitive first."""
        zeros = [_zero_dn(capture, captures[0]) for capture in captures]
        return cls(
            tuple(capture.sensitivity for capture in captures),
            tuple(capture.saturation_dn - zero for capture, zero in zip(captures, zeros, strict=True)),
            tuple(capture.k_dn_per_e for capture in captures),
            # Captures that state no sensitivities are alike, whatever noise they were seen to have.
            tuple(1.0 if capture.sensitivity_s is None else capture.dark_noise_dn for capture in captures),
            tuple(zeros),
        )

    def __len__(self) -> int:
        return len(self.sensitivities_s)

    @cached_property
    def ratios(self) -> tuple[float, ...]:
        """Highest sensitivity over that of each capture: 1 and rising."""
        return tuple(self.sensitivities_s[0] / sensitivity_s for sensitivity_s in self.sensitivities_s)

    @property
    def merged_saturation_dn(self) -> float:
        """Where the least sensitive capture saturates, on the scale of the most sensitive."""
        return self.saturations_dn[-1] * self.ratios[-1]

    def factors(self, method: Method, first: int = 0) -> list[float]:
        """Factors of the DN from capture `first` on in "linear" or "weighted", where none is clipped or fading."""
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
        """Share of each capture in the "weighted" mean of itself and all less sensitive ones; 1 for the last.

        The weights are inverse variances, s^2 / (dark variance + shot variance), the latter proportional to K and the
        sensitivity s; as if the captures shared no photons.
        """
        weights = [
            ratio**-2
            / ((noise / self.dark_noises_dn[0]) ** 2 + _SHOT_OVER_DARK_VARIANCE * (k / self.k_dn_per_e[0]) / ratio)
            for ratio, noise, k in zip(self.ratios, self.dark_noises_dn, self.k_dn_per_e, strict=True)
        ]
        return tuple(weights[i] / sum(weights[i:]) for i in range(len(weights)))


def _zero_dn(capture: Capture, first: Capture) -> float:
    """DN of a capture that stands for 0 of the merged value, in which dark signal is that of the first capture."""
    if capture.sensitivity_s is None:
        return float(capture.black_level_dn)
    dark_dn, first_dn = (one.dark_dn - one.black_level_dn for one in (capture, first))
    excess_dn = dark_dn - first_dn * (capture.sensitivity / first.sensitivity)
    is_same = abs(excess_dn) <= _SAME_DARK_REL * max(dark_dn, first_dn)
    return float(capture.black_level_dn + (0.0 if is_same else excess_dn))


def merge_dn(
    method: Method, bits: int, captures_dn: Sequence[NDArray[Any]], ladder: CaptureLadder, overlap: float = 0.1
) -> NDArray[Any]:
    """Merge the values of all captures; see `Hdr` for the methods.

    Parameters
    ----------
    method : {"normal", "linear", "weighted", "most-sensitive"}
        Merge method.
    bits : int
        Bits of the merged value; only "normal" has a limited range.
    captures_dn : sequence of ndarray
        DN above `CaptureLadder.zeros_dn`, most sensitive capture first, of shapes that broadcast together.
    ladder : CaptureLadder
        The captures.
    overlap : float
        Of "most-sensitive".

    Returns
    -------
    ndarray of int64 for "normal", else float64
    """
    if method == "normal":
        chosen: NDArray[Any] = np.zeros((), np.int64)
        for i in reversed(range(len(ladder))):
            stage_dn, taken = normal_stage(captures_dn[i], i, bits, ladder)
            chosen = np.where(taken, stage_dn, chosen)
        return chosen
    merged = mix(method, [stage_of(method, overlap)(dn, i, ladder) for i, dn in enumerate(captures_dn)], ladder)
    # Only rounding keeps some from 0, and pixels at and above dark signal count differently.
    return np.where(np.abs(merged) < ZERO_DN, 0.0, merged)


def mix(method: Method, stages: Sequence[tuple[FloatArray, FloatArray]], ladder: CaptureLadder) -> FloatArray:
    """Merge what `linear_stage`, `weighted_stage` or `blended_stage` returned for each, most sensitive first."""
    merged: Any = 0.0
    if method != "linear":
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


#: Takes DN of a capture, its number and the ladder; returns what `mix` takes.
StageOfCapture: TypeAlias = Callable[[NDArray[Any], int, CaptureLadder], tuple[FloatArray, FloatArray]]


def stage_of(method: Method, overlap: float) -> StageOfCapture:
    """Return the function that weights a capture in a method other than "normal"."""
    match method:
        case "weighted":
            return weighted_stage
        case "linear":
            return linear_stage
        case _:
            return partial(blended_stage, overlap)


def linear_stage(dn: NDArray[Any], i: int, ladder: CaptureLadder) -> tuple[FloatArray, FloatArray]:
    """Return the scaled DN of exposure `i`, and 1 where it is not clipped, else 0."""
    return dn * ladder.ratios[i], (dn < ladder.saturations_dn[i]).astype(np.float64)


def normal_stage(
    dn: NDArray[Any], i: int, bits: int, ladder: CaptureLadder
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the scaled value of exposure `i` for "normal", and where it may be taken."""
    scaled = dn * ladder.ratios[i]
    # A product that should be whole must not fall just short of it.
    whole = np.floor(scaled + np.abs(scaled) * (4 * np.finfo(np.float64).eps))
    value = np.minimum(whole, 2**bits - 1).astype(np.int64)
    if i == len(ladder) - 1:
        return value, np.ones(value.shape, dtype=np.bool_)
    threshold = 2 ** (bits / len(ladder) * (i + 1))
    return value, (scaled <= threshold) & (dn < ladder.saturations_dn[i])


def weighted_stage(dn: NDArray[Any], i: int, ladder: CaptureLadder) -> tuple[FloatArray, FloatArray]:
    """Return the term of exposure `i` in the "weighted" value, and the factor of the merge of all shorter ones.

    An exposure is faded out by its own noisy value, which alone would bias the mean: it counts less where noise made
    it bright. For Poisson counts E[N f(N - 1)] = E[N] E[f(N)] (Chen 1975, Ann. Probab. 3, 534), so taking the share
    at one electron less for the exposure itself, but not for the others, removes that bias at any width of the fade.
    """
    scaled = dn * ladder.ratios[i]
    if i == len(ladder) - 1:
        clipped = dn >= ladder.saturations_dn[i]
        return np.where(clipped, ladder.merged_saturation_dn, scaled), np.zeros(np.shape(dn))
    own_share = np.where(dn < ladder.saturations_dn[i], faded_share(dn - ladder.k_dn_per_e[i], i, ladder), 0.0)
    return scaled * own_share, 1 - faded_share(dn, i, ladder)


def faded_share(dn: NDArray[Any], i: int, ladder: CaptureLadder) -> FloatArray:
    """Share of exposure `i`: constant, then falling smoothly (3 x^2 - 2 x^3) to 0 one electron before it clips."""
    begin = FADE_FROM * ladder.saturations_dn[i]
    width = max(ladder.saturations_dn[i] - ladder.k_dn_per_e[i] - begin, 1e-6)
    left = np.clip((begin + width - np.asarray(dn, dtype=np.float64)) / width, 0.0, 1.0)
    share: FloatArray = ladder.shares[i] * left**2 * (3 - 2 * left)
    return share


def blended_stage(overlap: float, dn: NDArray[Any], i: int, ladder: CaptureLadder) -> tuple[FloatArray, FloatArray]:
    """Return the term of capture `i` in the "most-sensitive" value, and the factor of the merge of all others."""
    scaled = np.asarray(dn * ladder.ratios[i], dtype=np.float64)
    if i == len(ladder) - 1:
        return scaled, np.zeros(np.shape(dn))
    end = ladder.saturations_dn[i]
    share = np.clip((end - dn) / (overlap * end), 0.0, 1.0) if overlap else (dn < end).astype(np.float64)
    return scaled * share, 1 - share


@dataclass(frozen=True)
class Hdr(Parameters):
    """How captures are merged; the result has the scale of the most sensitive one, without black level.

    Parameters
    ----------
    method : {"normal", "linear", "weighted", "most-sensitive"}
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
        "most-sensitive": as sensors merge inside: each value from the most sensitive capture that is not clipped,
        times the ratio of the sensitivities. Over the upper `overlap` of its range a capture is blended with the next
        one, in shares that change linearly with its own value.
        What is said of exposures and their times holds for captures of several gains and photodiodes, and their
        sensitivities.
    bits : int
        Bits of the merged value, 1 to 48; only "normal" is limited to them.
    overlap : float
        Share of the range of a capture over which "most-sensitive" blends it with the next one; 0 for a step. What
        sensors have is not published; 0.1 is assumed.

    Raises
    ------
    InputError
        If the method is not known or bits out of range.

    Notes
    -----
    In "normal" and "linear" the noise of an exposure decides whether it is taken, so their mean is low where the choice
    is open: by 0.7 to 3 % within some standard deviations of a threshold of "normal" (8 % where dark current makes
    most of the noise), by 0.1 to 0.2 % just below the saturation of an exposure for "linear". "weighted" stays within
    0.05 %, "most-sensitive" within 0.1 % where the overlap is many standard deviations wide.
    Dark signal of a capture that is not in proportion to its sensitivity, as that of a photodiode of less light, is
    taken off by its mean, as sensors do with their dark pixels.

    Examples
    --------
    >>> from labcdp.chain import Hdr
    >>> Hdr("weighted").bits
    20
    """

    method: Method
    bits: MergedBits = 20
    overlap: Annotated[float, Ratio("(a fraction)", 0, 1)] = 0.1

    def __post_init__(self) -> None:
        if not isinstance(self.method, str) or self.method not in get_args(Method):
            raise InputError(f"method is {shown(self.method)}: give one of {', '.join(get_args(Method))}", key="method")
        super().__post_init__()

    def merge(self, captures: Sequence[Capture]) -> Capture:
        """Merge captures of one scene.

        Parameters
        ----------
        captures : sequence of Capture
            In any order, of one sensor.

        Returns
        -------
        Capture
            `dn` is int64 for "normal", else float64. Pixels clipped in all captures are at its `saturation_dn`, or
            for "normal" and "most-sensitive" above.

        Raises
        ------
        InputError
            If no capture is given, sensitivities are equal or not above 0, shapes differ, or of captures that state no
            sensitivities gains, black levels or saturations.
        """
        ordered = sorted(captures, key=lambda capture: -capture.sensitivity)
        if not ordered:
            raise InputError("there is no exposure to merge: give at least one")
        _check_alike(ordered)
        first, ladder = ordered[0], CaptureLadder.of_captures(ordered)
        # Of a whole number, values below black level would wrap around.
        captures_dn = [capture.dn - zero for capture, zero in zip(ordered, ladder.zeros_dn, strict=True)]
        return replace(
            first,
            dn=merge_dn(self.method, self.bits, captures_dn, ladder, self.overlap),
            black_level_dn=0.0,
            dark_dn=first.dark_dn - first.black_level_dn,
            saturation_dn=self.saturation_dn(ladder),
            dark_noise_dn=first.dark_noise_dn * self._dark_noise_rel(ladder),
        )

    def _dark_noise_rel(self, ladder: CaptureLadder) -> float:
        """Noise of merged dark signal over that of the most sensitive capture."""
        if self.method in ("normal", "most-sensitive"):
            return 1.0
        noises = zip(ladder.factors(self.method), ladder.dark_noises_dn, strict=True)
        return hypot(*(factor * (noise_dn / ladder.dark_noises_dn[0]) for factor, noise_dn in noises))

    def saturation_dn(self, ladder: CaptureLadder) -> float:
        """Return the merged DN from which a pixel counts as saturated: where the last capture is, or the range ends."""
        if self.method == "normal":
            return float(min(ladder.merged_saturation_dn // 1, 2**self.bits - 1))
        return ladder.merged_saturation_dn


def _check_alike(captures: Sequence[Capture]) -> None:
    """Refuse captures that do not belong together; those that state their sensitivities may differ."""
    stated = all(capture.sensitivity_s is not None for capture in captures)
    for name in () if stated else ("k_dn_per_e", "black_level_dn", "saturation_dn"):
        values = [getattr(capture, name) for capture in captures]
        if len(set(values)) > 1:
            raise InputError(f"{name} differs between the captures: {values}; merge captures of one gain and sensor")
    shapes = {capture.dn.shape for capture in captures}
    if len(shapes) > 1:
        raise InputError(f"the captures have the shapes {sorted(shapes)}: merge captures of one size")
