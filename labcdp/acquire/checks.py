"""Checks of recorded data: saturation, flicker, dark frames, and the meter before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Literal

from ..calibration.frames.statistics import MAX_CLIPPED_SHARE, MIN_NET_SIGNAL
from ..core.clock import exposure_text
from ..core.errors import InputError
from ..core.reading import Reading, ReadingSeries
from .live import PatchNumbers, measured_black_dn

#: Standard uncertainties above which a change is significant.
_SIGNIFICANT = 3.0

#: Share of the brightest patch's signal above which a dark frame was taken without the cap.
_LIT_SHARE = 0.5


@dataclass(frozen=True)
class CheckFinding:
    """A problem of recorded data, which may have to be repeated.

    Parameters
    ----------
    check : str
        Name of the check.
    cause : str
        Problem and possible cause, on one line.
    value, limit : float
        Measured value and its limit; shares and relative changes as fractions.

    Examples
    --------
    >>> from labcdp.acquire import CheckFinding
    >>> CheckFinding("flicker", "the light flickers", value=0.03, limit=0.01).passing
    True
    """

    check: Literal[
        "saturation",
        "darkness",
        "light in the dark",
        "flicker",
        "meter drift",
        "scatter",
        "mixed readings",
        "repeated frames",
    ]
    cause: str
    value: float
    limit: float

    def __str__(self) -> str:
        """Return the cause."""
        return self.cause

    @property
    def passing(self) -> bool:
        """Whether repeating may solve it without a change at the bench."""
        return self.check not in ("saturation", "darkness", "light in the dark", "repeated frames")


def check_levels(numbers: Sequence[PatchNumbers]) -> list[CheckFinding]:
    """Find patches that no exposure shows between black and saturation.

    A patch needs an exposure at which at most `MAX_CLIPPED_SHARE` of its values are saturated and its signal is at
    least `MIN_NET_SIGNAL` times the temporal noise of a pixel.

    Parameters
    ----------
    numbers : sequence of PatchNumbers
        All exposures of all patches.
    """
    findings = []
    for name in dict.fromkeys(n.patch for n in numbers):
        seen = [n for n in numbers if n.patch == name]
        clear = [n for n in seen if n.saturated_share <= MAX_CLIPPED_SHARE]
        least = min(seen, key=lambda n: n.saturated_share)
        best = max(clear, key=lambda n: n.signal_dn, default=least)
        needed_dn = MIN_NET_SIGNAL * (best.temporal_noise_dn or 0.0)
        if not clear:
            cause = (
                f"patch {name!r} is saturated at every exposure, {least.saturated_share:.1%} of it even at "
                f"{exposure_text(least.exposure_s)}: add a shorter exposure, or dim the light"
            )
            findings.append(CheckFinding("saturation", cause, least.saturated_share, MAX_CLIPPED_SHARE))
        elif best.signal_dn < needed_dn:
            cause = (
                f"patch {name!r} is {best.signal_dn:.1f} DN above black at {exposure_text(best.exposure_s)}, within "
                f"{MIN_NET_SIGNAL:g} times its noise: add a longer exposure, or more light"
            )
            findings.append(CheckFinding("darkness", cause, best.signal_dn, needed_dn))
    return findings


def check_darkness(dark: Sequence[PatchNumbers], light: Sequence[PatchNumbers]) -> list[CheckFinding]:
    """Find dark frames that show the target: half as bright as the light frames at the brightest patch.

    The black level is that of the light frames, as dark frames without the cap would say a wrong one.

    Parameters
    ----------
    dark, light : sequence of PatchNumbers
        All exposures of all patches.
    """
    black_dn = measured_black_dn((), light)
    if black_dn is None:
        # Of one exposure the darkest patch is nearest to black; a single patch says nothing of it.
        black_dn = min(n.mean_dn for n in light) if len(light) > 1 else 0.0
    for n in light:
        seen = [d for d in dark if (d.patch, d.exposure_s) == (n.patch, n.exposure_s)]
        brightest = max((m for m in light if m.exposure_s == n.exposure_s), key=lambda m: m.mean_dn)
        signal_dn = n.mean_dn - black_dn
        clear = n is brightest and signal_dn > MIN_NET_SIGNAL * (n.temporal_noise_dn or 0.0)
        if clear and seen and (share := (seen[0].mean_dn - black_dn) / signal_dn) > _LIT_SHARE:
            cause = (
                f"in the dark frames at {exposure_text(n.exposure_s)} patch {n.patch!r} is {share:.0%} as bright as in "
                "the light frames: cover the lens"
            )
            return [CheckFinding("light in the dark", cause, share, _LIT_SHARE)]
    return []


def check_repeats(n_repeated: int, n_frames: int) -> list[CheckFinding]:
    """Find frames that are bit for bit an earlier frame: the noise is measured from what differs between frames.

    Parameters
    ----------
    n_repeated, n_frames : int
        Frames that repeat an earlier one of their exposure, and all frames.
    """
    if n_repeated == 0:
        return []
    cause = (
        f"{n_repeated} of {n_frames} frames are bit for bit the same as an earlier one, so noise and K are "
        "underestimated: is the camera's test pattern on, or its image frozen? if not, use a format with more bits"
    )
    return [CheckFinding("repeated frames", cause, n_repeated / n_frames, 0.0)]


def check_flicker(numbers: Sequence[PatchNumbers], largest_rel: float) -> list[CheckFinding]:
    """Find exposures whose frames differ in brightness by more than `largest_rel` and significantly.

    The mean of a region of n pixels varies by their temporal noise over sqrt(n) even in steady light.

    Parameters
    ----------
    numbers : sequence of PatchNumbers
        All exposures of all patches; saturated ones are left out.
    largest_rel : float
        Largest standard deviation between frames, relative to the signal.
    """
    findings = []
    for exposure_s in sorted({n.exposure_s for n in numbers}):
        flickering = [
            (n.flicker_rel, n)
            for n in numbers
            if n.exposure_s == exposure_s
            and n.saturated_share <= MAX_CLIPPED_SHARE
            and n.flicker_rel is not None
            and n.flicker_rel > largest_rel
            and (n.flicker_dn or 0.0) > _SIGNIFICANT * (n.temporal_noise_dn or 0.0) / sqrt(n.pixels)
        ]
        if flickering:
            value, worst = max(flickering, key=lambda pair: pair[0])
            cause = (
                f"patch {worst.patch!r} flickers by {value:.1%} between frames of {exposure_text(exposure_s)}: lamp "
                "flicker? choose an exposure that is a multiple of the mains period, or wait until the lamp is steady"
            )
            findings.append(CheckFinding("flicker", cause, value, largest_rel))
    return findings


def check_meter_drift(
    patch: str, before: Sequence[Reading], after: Sequence[Reading], largest_rel: float
) -> list[CheckFinding]:
    """Compare the readings of a patch before its frames with those after.

    Parameters
    ----------
    patch : str
        Its name.
    before, after : sequence of Reading
        At least one each.
    largest_rel : float
        Largest relative change; changes within the readings' uncertainty are ignored.
    """
    try:
        was, now = ReadingSeries(tuple(before)), ReadingSeries(tuple(after))
    except InputError:
        # Reported by `check_scatter`.
        return []
    if was.mean_cd_m2 == 0:
        return []
    change = now.mean_cd_m2 / was.mean_cd_m2 - 1
    own_cd_m2 = hypot(was.standard_uncertainty_random_cd_m2, now.standard_uncertainty_random_cd_m2)
    if abs(change) <= max(largest_rel, _SIGNIFICANT * own_cd_m2 / was.mean_cd_m2):
        return []
    cause = (
        f"patch {patch!r} went from {was.mean_cd_m2:.4g} to {now.mean_cd_m2:.4g} cd/m² ({change:+.1%}) while its "
        "frames were taken: wait until the light is steady"
    )
    return [CheckFinding("meter drift", cause, change, largest_rel)]


def settling_drift_rel(readings: Sequence[Reading], largest_rel: float) -> float | None:
    """Return the relative drift of a series of readings if it is significant, None for one that has settled.

    Parameters
    ----------
    readings : sequence of Reading
        Of one patch, one after the other.
    largest_rel : float
        Largest relative change from the first to the last that is no drift.

    Examples
    --------
    >>> from labcdp.acquire.checks import settling_drift_rel
    >>> from labcdp.core.reading import MeterIdentity
    >>> from labcdp.drivers.manual import MeterAccuracy, typed_reading
    >>> accuracy, meter = MeterAccuracy(0.02, 0.001, digits=1), MeterIdentity("L 1003", "4711")
    >>> def drift_rel(*texts: str) -> float | None:
    ...     return settling_drift_rel([typed_reading(text, accuracy, meter) for text in texts], largest_rel=0.01)
    >>> round(drift_rel("9.00", "9.50", "9.70"), 3), drift_rel("9.80", "9.80", "9.80")
    (0.074, None)
    """
    if len(readings) < 2:
        return None
    try:
        drift = ReadingSeries(tuple(readings)).drift_rel
    except InputError:
        # Reported by `check_scatter`.
        return None
    return drift.value if abs(drift.value) > max(largest_rel, _SIGNIFICANT * drift.u) else None


def check_scatter(patch: str, readings: Sequence[Reading], largest_rel: float) -> list[CheckFinding]:
    """Find readings of one patch that differ by more than the meter's repeatability and last digit explain.

    Parameters
    ----------
    patch : str
        Its name.
    readings : sequence of Reading
        At least one, taken one after the other; a single one cannot scatter.
    largest_rel : float
        Largest standard deviation, relative to the mean.
    """
    try:
        series = ReadingSeries(tuple(readings))
    except InputError as error:
        units = len({reading.unit for reading in readings})
        return [CheckFinding("mixed readings", f"the readings of patch {patch!r} are inconsistent: {error}", units, 1)]
    own_cd_m2 = max(reading.standard_uncertainty_random_cd_m2 for reading in readings)
    # The scatter of one reading is nan; the comparison is then False.
    if not series.scatter_cd_m2 > max(largest_rel * series.mean_cd_m2, _SIGNIFICANT * own_cd_m2):
        return []
    cause = (
        f"the {len(readings)} readings of patch {patch!r} scatter by {series.scatter_rel:.1%}: is the meter pointed at "
        "the patch alone, and held still?"
    )
    return [CheckFinding("scatter", cause, series.scatter_rel, largest_rel)]
