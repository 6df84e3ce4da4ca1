"""Exposure search: the fewest exposures that show every patch between black and saturation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import floor, log10, sqrt

import numpy as np

from ..core.clock import exposure_text
from ..core.errors import DeviceError
from ..core.frame import Frame
from ..core.roi import Roi
from .checks import CheckFinding
from .live import region_values

#: Range of a patch's mean at one exposure, as shares of the span from black to saturation. The lower end is a
#: compromise between noise and the number of exposures, which it spaces by about a factor of 4.
LOWEST_SHARE = 0.20
HIGHEST_SHARE = 0.85
#: The quantile of a patch that must stay below saturation, and its limit; the maximum would be that of a hot pixel.
HIGH_QUANTILE = 0.999
HIGHEST_QUANTILE_SHARE = 0.95
#: Longest exposure of the search; beyond it, dark current and hot pixels dominate in an uncooled camera.
LONGEST_S = 1.0

#: Margin of the allowed range for errors of the estimates.
_MARGIN = 0.02
#: Least share of the span in a frame from which a rate is determined.
_STRONG_SHARE = 0.10
#: Share of the span aimed at in the next frame, and the largest step from a frame with little signal.
_AIM_SHARE = 0.5
_LARGEST_STEP = 32.0
#: Relative difference below which exposures are not distinguished.
_NARROW = 1.05


@dataclass(frozen=True)
class PatchLevel:
    """One patch in one frame.

    Parameters
    ----------
    mean_dn, high_dn : float
        Mean and `HIGH_QUANTILE` quantile of its values.
    """

    mean_dn: float
    high_dn: float


@dataclass(frozen=True)
class SearchFrame:
    """One frame of a search.

    Parameters
    ----------
    exposure_s : float
        Exposure in effect.
    levels : mapping of str to PatchLevel
        Values by patch.
    saturation_dn : float
        Saturation.
    """

    exposure_s: float
    levels: Mapping[str, PatchLevel]
    saturation_dn: float

    @classmethod
    def at(cls, frame: Frame, regions: Sequence[Roi]) -> SearchFrame:
        """Evaluate the regions of a frame."""
        levels = {}
        for region in regions:
            values = region_values(frame, region)
            high = float(np.quantile(values, HIGH_QUANTILE, method="higher"))
            levels[region.name] = PatchLevel(float(values.mean(dtype=np.float64)), high)
        return cls(frame.exposure_s, levels, frame.linear_saturation_dn)


@dataclass(frozen=True)
class PatchRate:
    """Rate at which a patch fills the camera's span.

    Parameters
    ----------
    patch : str
        Its name.
    share_per_s : float or None
        Share of the span from black to saturation per second; None if saturated at the shortest exposure.
    high_ratio : float
        Its high quantile over its mean, both above black.
    """

    patch: str
    share_per_s: float | None
    high_ratio: float = 1.0


@dataclass(frozen=True)
class FoundExposures:
    """Result of a search.

    Parameters
    ----------
    exposures_s : tuple of float
        Shortest first.
    shares : dict of str to float
        Largest share of the span reached without saturation at one of them, by patch.
    findings : tuple of CheckFinding
        Patches that are well exposed at none of them.
    """

    exposures_s: tuple[float, ...]
    shares: dict[str, float]
    findings: tuple[CheckFinding, ...]


def measure_rates(
    look: Callable[[float], SearchFrame], patches: Sequence[str], range_s: tuple[float, float]
) -> list[PatchRate]:
    """Measure how fast patches fill the span, from the shortest exposure upwards.

    The camera is assumed to be linear: the mean above black is proportional to the exposure. Black is the intercept of
    the darkest patch, for which the search starts with two frames.

    Parameters
    ----------
    look : callable
        Takes a frame with an exposure in seconds.
    patches : sequence of str
        Patches in the frames.
    range_s : (float, float)
        Shortest and longest exposure.
    """
    shortest_s, longest_s = range_s
    frames = [look(shortest_s), look(min(2 * shortest_s, longest_s))]
    given_up: set[str] = set()
    while True:
        black_dn = _black_dn(frames)
        traces = [_Trace.of(frames, name, black_dn) for name in patches]
        open_ones = [trace for trace in traces if trace.patch not in given_up and trace.wants_more(longest_s)]
        if not open_ones:
            return [trace.rate() for trace in traces]
        brightest = max(open_ones, key=lambda trace: trace.share / (trace.clear_s or 1.0))
        exposure_s = brightest.next_s(longest_s)
        if exposure_s is None:
            given_up.add(brightest.patch)
        else:
            frames.append(look(exposure_s))
            if frames[-1].exposure_s in [earlier.exposure_s for earlier in frames[:-1]]:
                # The camera has no exposure in between.
                given_up.add(brightest.patch)


def choose_exposures(rates: Sequence[PatchRate], range_s: tuple[float, float]) -> FoundExposures:
    """Select the fewest exposures such that each patch is well exposed at one.

    Each patch allows a range of exposures; the smallest upper end is selected, which covers every range that contains
    it, and so on (greedy interval stabbing, which is optimal).

    Raises
    ------
    DeviceError
        If every patch is saturated at the shortest exposure.
    """
    shortest_s, longest_s = range_s
    findings: list[CheckFinding] = []
    ranges: list[tuple[float, float]] = []
    for rate in rates:
        allowed = _allowed_s(rate)
        if allowed is None or allowed[1] < shortest_s:
            findings.append(_too_bright(rate, shortest_s))
        else:
            low_s, high_s = (min(t, longest_s) for t in allowed)
            # For a very non-uniform patch the brightest part decides.
            ranges.append((max(min(low_s, high_s), shortest_s), high_s))
    if not ranges:
        raise DeviceError(
            f"every patch is saturated at the shortest exposure, {exposure_text(shortest_s)}: stop the lens "
            "down, or dim the light"
        )
    chosen: list[float] = []
    for low_s, high_s in sorted(ranges, key=lambda r: r[1]):
        # Closer than the margin, a camera could round two exposures to one.
        if not chosen or chosen[-1] * (1 + _MARGIN) < low_s:
            chosen.append(max(_rounded_down(high_s), low_s))
    shares = {rate.patch: share for rate in rates if (share := _best_share(rate, chosen)) is not None}
    for rate in rates:
        share = shares.get(rate.patch)
        if share is not None and share < LOWEST_SHARE * (1 - _MARGIN):
            findings.append(_too_dark(rate.patch, share, max(chosen)))
    return FoundExposures(tuple(chosen), shares, tuple(findings))


@dataclass(frozen=True)
class _Trace:
    """One patch through the frames of a search."""

    patch: str
    clear_s: float | None
    clear: PatchLevel | None
    full_s: float | None
    black_dn: float
    span_dn: float

    @classmethod
    def of(cls, frames: Sequence[SearchFrame], patch: str, black_dn: float) -> _Trace:
        clear = [frame for frame in frames if _is_clear(frame, patch)]
        full = [frame.exposure_s for frame in frames if not _is_clear(frame, patch)]
        best = max(clear, key=lambda frame: frame.exposure_s, default=None)
        clear_s, level = (None, None) if best is None else (best.exposure_s, best.levels[patch])
        return cls(patch, clear_s, level, min(full, default=None), black_dn, frames[0].saturation_dn - black_dn)

    @property
    def share(self) -> float:
        assert self.clear is not None
        return (self.clear.mean_dn - self.black_dn) / self.span_dn

    def wants_more(self, longest_s: float) -> bool:
        if self.clear_s is None or self.share >= _STRONG_SHARE:
            return False
        return self.clear_s < longest_s / _NARROW

    def next_s(self, longest_s: float) -> float | None:
        assert self.clear_s is not None
        wanted_s = min(self.clear_s * _AIM_SHARE / max(self.share, _AIM_SHARE / _LARGEST_STEP), longest_s)
        if self.full_s is not None and wanted_s > self.full_s / _NARROW:
            wanted_s = sqrt(self.clear_s * self.full_s)
        return wanted_s if wanted_s > self.clear_s * _NARROW else None

    def rate(self) -> PatchRate:
        if self.clear is None or self.clear_s is None:
            return PatchRate(self.patch, None)
        strong = self.share >= _STRONG_SHARE
        high_ratio = (self.clear.high_dn - self.black_dn) / (self.share * self.span_dn) if strong else 1.0
        return PatchRate(self.patch, max(self.share / self.clear_s, 0.0), max(high_ratio, 1.0))


def _is_clear(frame: SearchFrame, patch: str) -> bool:
    return frame.levels[patch].high_dn <= HIGHEST_QUANTILE_SHARE * frame.saturation_dn


def _black_dn(frames: Sequence[SearchFrame]) -> float:
    """Black by the line through the shortest and longest unsaturated frame of the darkest patch, else 0."""
    longest = max(frames, key=lambda frame: frame.exposure_s)
    darkest = min(longest.levels, key=lambda name: longest.levels[name].mean_dn)
    clear = sorted((frame for frame in frames if _is_clear(frame, darkest)), key=lambda frame: frame.exposure_s)
    if len(clear) < 2 or clear[-1].exposure_s < _NARROW * clear[0].exposure_s:
        return 0.0
    (t0, m0), (t1, m1) = ((frame.exposure_s, frame.levels[darkest].mean_dn) for frame in (clear[0], clear[-1]))
    return m0 - (m1 - m0) / (t1 - t0) * t0


def _allowed_s(rate: PatchRate) -> tuple[float, float] | None:
    if rate.share_per_s is None:
        return None
    if rate.share_per_s == 0:
        return float("inf"), float("inf")
    highest = min(HIGHEST_SHARE, HIGHEST_QUANTILE_SHARE / rate.high_ratio) * (1 - _MARGIN)
    return LOWEST_SHARE * (1 + _MARGIN) / rate.share_per_s, highest / rate.share_per_s


def _best_share(rate: PatchRate, exposures_s: Sequence[float]) -> float | None:
    allowed = _allowed_s(rate)
    if allowed is None or rate.share_per_s is None:
        return None
    highest_s = allowed[1] * (1 + 1e-9)  # against floating-point rounding
    return max((t * rate.share_per_s for t in exposures_s if t <= highest_s), default=None)


def _rounded_down(exposure_s: float) -> float:
    """Round down to three significant digits."""
    unit = 10.0 ** (floor(log10(exposure_s)) - 2)
    return floor(exposure_s / unit * (1 + 1e-12)) * unit


def _too_bright(rate: PatchRate, shortest_s: float) -> CheckFinding:
    share = float("inf") if rate.share_per_s is None else rate.share_per_s * shortest_s * rate.high_ratio
    return CheckFinding(
        "saturation",
        f"patch {rate.patch!r} is too bright even for the shortest exposure, {exposure_text(shortest_s)}: stop the "
        "lens down, or dim the light",
        min(share, 1.0),
        HIGHEST_SHARE,
    )


def _too_dark(patch: str, share: float, longest_s: float) -> CheckFinding:
    return CheckFinding(
        "darkness",
        f"patch {patch!r} reaches {share:.1%} of the camera's range at {exposure_text(longest_s)}, not "
        f"{LOWEST_SHARE:.0%}: open the lens, or add light",
        share,
        LOWEST_SHARE,
    )
