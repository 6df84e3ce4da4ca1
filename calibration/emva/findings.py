"""Findings about impossible or implausible values in a characterisation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...core.result import Finding, info, warning
from ..frames.observations import DarkObservation
from ..frames.rounding import ROUNDING_DN2
from .quantities import LEAST_VARIANCE_DN2
from .result import Quantity
from .series import SeriesPoint
from .transfer import Saturation

#: Lower bounds of a camera's shortest and a series' longest exposure, and upper bound (one hour).
_SHORTEST_S, _LONGEST_SHORT_S, _LONGEST_S = 1e-6, 1e-4, 3600.0
#: A series whose longest exposure is below is rare: photon series go to some 10 ms.
_RARELY_SHORT_S = 1e-3
#: Exposures beyond, without a dark current of at least this many e-/s, are rare: only cooled sensors have less.
_RARELY_LONG_S, _LOW_CURRENT_E_S = 10.0, 0.1
#: Large pixels have less at room temperature: 1 nA/cm^2 on (24 um)^2 are 4e4 e-/s.
_LARGEST_CURRENT_E_S = 1e5
#: Cameras are linear to a percent or two.
_LARGEST_LINEARITY_ERROR = 0.03
#: Standard deviation of the dark signal in DN above which rounding is harmless, and its variance with rounding.
_DITHERED_DN = 0.6
_DITHERED_DN2 = _DITHERED_DN**2 + ROUNDING_DN2
#: Quantum efficiency above which the photon numbers are wrong.
_LOWEST_QE = 1e-3
#: Most values at DN 0 in dark signal (EMVA 1288 Release 4.0 Linear: about 0.5 %).
_BLACK_SHARE = 0.005
#: Fewest points of a series (EMVA 1288 Release 4.0 Linear: at least 9 exposures).
_FEWEST_POINTS = 9
#: Critical value, in standard uncertainties, for negative values.
_CHANCE = 3.0
#: Photon transfer of real cameras is straight to 1 or 2 %.
_LARGEST_DEPARTURE = 0.05


def exposure_findings(points: Sequence[SeriesPoint]) -> Iterator[Finding]:
    """Find exposures of an index that are not in nanoseconds."""
    shortest, longest = min(p.exposure_s for p in points), max(p.exposure_s for p in points)
    if 0 < shortest < _SHORTEST_S or longest < _LONGEST_SHORT_S or longest > _LONGEST_S:
        yield warning("exposures-not-in-ns", range_ns=[shortest * 1e9, longest * 1e9])
    elif longest < _RARELY_SHORT_S:
        yield warning("exposures-perhaps-in-us", longest_s=longest)


def long_exposure_findings(points: Sequence[SeriesPoint], dark_current: Quantity | None) -> Iterator[Finding]:
    """Find exposures of an index that are so long that the dark current becomes that of a cooled sensor."""
    longest = max(p.exposure_s for p in points)
    if dark_current is None or not _RARELY_LONG_S < longest <= _LONGEST_S:
        return
    if dark_current.value + 2 * dark_current.standard_uncertainty < _LOW_CURRENT_E_S:
        yield warning("exposures-perhaps-in-ps", longest_s=longest, dark_current_e_s=dark_current.value)


def linearity_findings(errors: Sequence[Quantity | None]) -> Iterator[Finding]:
    """Find deviations from the line that no usable camera has."""
    known = [error for error in errors if error is not None]
    worst = max(known, key=lambda error: abs(error.value), default=None)
    if worst is not None and abs(worst.value) > max(_LARGEST_LINEARITY_ERROR, _CHANCE * worst.standard_uncertainty):
        yield warning("not-linear", deviation_rel=worst.value, usual_rel=_LARGEST_LINEARITY_ERROR)


def rounding_findings(darks: Sequence[DarkObservation]) -> Iterator[Finding]:
    """Find dark signals with too little noise to dither rounding."""
    least = min(point.temporal_variance_dn2 for point in darks)
    if least < _DITHERED_DN2:
        shortest = min(darks, key=lambda point: point.exposure_s)
        yield warning("dark-noise-rounded", limit_dn=_DITHERED_DN, variance_dn2=least)
        if shortest.temporal_variance_dn2 < LEAST_VARIANCE_DN2:
            yield info("read-noise-upper-limit")


def photon_findings(points: Sequence[SeriesPoint], quantum_efficiency: Quantity | None) -> Iterator[Finding]:
    """Find missing or impossible photon numbers of an index."""
    if all(point.photons is None for point in points):
        yield warning("photons-unknown")
    if quantum_efficiency is not None and quantum_efficiency.value > 1:
        yield warning("photons-too-few", quantum_efficiency=quantum_efficiency.value)
    if quantum_efficiency is not None and quantum_efficiency.value < _LOWEST_QE:
        yield warning("photons-too-many", quantum_efficiency=quantum_efficiency.value)


def depth_findings(points: Sequence[SeriesPoint], bits: int, saturation: Saturation) -> Iterator[Finding]:
    """Find bits that do not match the values."""
    largest_mean_dn = max(point.light.mean_dn for point in points)
    multiple = min(point.light.multiple for point in points)
    if multiple > 1:
        yield warning("bits-shifted", multiple=multiple, bits=bits - multiple.bit_length() + 1)
    if saturation.limit != "not reached" and largest_mean_dn < 2 ** (bits - 1) and multiple == 1:
        yield warning("bits-unused", saturation_dn=largest_mean_dn, bits=bits)


def series_findings(points: Sequence[SeriesPoint], saturation: Saturation) -> Iterator[Finding]:
    """Find too few points, clipping at black, and saturation not reached."""
    if len(points) < _FEWEST_POINTS:
        yield warning("few-points", count=len(points), least=_FEWEST_POINTS)
    black = max(points, key=lambda p: p.dark.black_share)
    if black.dark.black_share > _BLACK_SHARE:
        yield warning("dark-values-clipped", share=black.dark.black_share, exposure_s=black.exposure_s)
    if saturation.limit == "not reached":
        # A photon series is recorded up to saturation, a session need not be.
        series = all(point.photons is not None for point in points)
        yield (warning if series else info)("saturation-not-reached", net_dn=points[-1].net_dn)
    if saturation.limit == "converter":
        yield info("converter-saturates")


def noise_findings(points: Sequence[SeriesPoint], saturation: Saturation) -> Iterator[Finding]:
    """Find noise that decreases while the signal of a series increases."""
    if saturation.limit == "full well" and _still_rises(points, saturation):
        yield warning("noise-falls", net_dn=points[saturation.index].net_dn)


def value_findings(
    dark_current: Quantity | None, by_variance: Quantity | None, departure_rel: float
) -> Iterator[Finding]:
    """Find impossible dark currents and non-linear photon transfer."""
    for quantity, code in ((dark_current, "dark-current-negative"), (by_variance, "dark-current-by-variance-negative")):
        if quantity is not None and quantity.value < -_CHANCE * quantity.standard_uncertainty:
            z = -quantity.value / quantity.standard_uncertainty
            yield warning(code, dark_current_e_s=quantity.value, z=z)
    if dark_current is not None and (
        dark_current.value - _CHANCE * dark_current.standard_uncertainty > _LARGEST_CURRENT_E_S
    ):
        yield warning("dark-current-too-large", dark_current_e_s=dark_current.value)
    if departure_rel > _LARGEST_DEPARTURE:
        yield warning("photon-transfer-not-straight", departure_rel=departure_rel)


def _still_rises(points: Sequence[SeriesPoint], saturation: Saturation) -> bool:
    """Whether the last point exceeds the peak by at least half of the increase of the stimulus."""
    peak, last = points[saturation.index], points[-1]
    more = (
        last.exposure_s / peak.exposure_s if last.photons is None or not peak.photons else last.photons / peak.photons
    )
    return more > 1.02 and last.net_dn / peak.net_dn - 1 > 0.5 * (more - 1)
