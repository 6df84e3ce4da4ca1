"""What is impossible or suspicious in a characterisation, in plain words with what to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..rounding import ROUNDING_DN2
from .dark_current import LEAST_VARIANCE_DN2
from .result import DarkPoint, Quantity, SaturationLimit, SeriesPoint
from .saturation import Saturation

#: No camera's shortest exposure is below, and no series' longest below the second; the last is an hour.
_SHORTEST_S, _LONGEST_SHORT_S, _LONGEST_S = 1e-6, 1e-4, 3600.0
#: A series whose longest exposure is below is rare: photon series go to some 10 ms.
_RARELY_SHORT_S = 1e-3
#: Exposures beyond, without a dark current of at least this many e-/s, are rare: only cooled sensors have less.
_RARELY_LONG_S, _LOW_CURRENT_E_S = 10.0, 0.1
#: Large pixels have less at room temperature: 1 nA/cm^2 on (24 um)^2 are 4e4 e-/s.
_LARGEST_CURRENT_E_S = 1e5
#: Cameras are linear to a percent or two.
_LARGEST_LINEARITY_ERROR = 0.03
#: Standard deviation of darkness in DN from which on rounding falsifies nothing, and its variance with rounding.
_DITHERED_DN = 0.6
_DITHERED_DN2 = _DITHERED_DN**2 + ROUNDING_DN2
#: A quantum efficiency beyond is a wrong photon number.
_LOWEST_QE = 1e-3
#: Most values at DN 0 in darkness (EMVA 1288 Release 3.1, section 6.5: about 0.5 %).
_BLACK_SHARE = 0.005
#: Fewest points of a series (EMVA 1288 Release 3.1, section 6.5: at least 9 exposures).
_FEWEST_POINTS = 9
#: Beyond so many standard uncertainties a value is not below zero by chance.
_CHANCE = 3.0
#: Photon transfer of real cameras is straight to 1 or 2 %.
_LARGEST_DEPARTURE = 0.05


def flag_exposures(points: Sequence[SeriesPoint]) -> Iterator[str]:
    """Exposures of an index that are not in nanoseconds."""
    shortest, longest = min(p.exposure_s for p in points), max(p.exposure_s for p in points)
    if 0 < shortest < _SHORTEST_S or longest < _LONGEST_SHORT_S or longest > _LONGEST_S:
        yield (
            f"the exposures are {shortest * 1e9:g} to {longest * 1e9:g} ns, which no camera series has: the index "
            "probably gives them in another unit; write them in nanoseconds, or the dark current is wrong"
        )
    elif longest < _RARELY_SHORT_S:
        yield (
            f"the longest exposure is {longest * 1e6:.4g} us, which is rare for a photon series: if the index gives "
            "the exposures in microseconds, write them in nanoseconds, or the dark current is 1000 times too large"
        )


def flag_long_exposures(points: Sequence[SeriesPoint], dark_current: Quantity | None) -> Iterator[str]:
    """Exposures of an index that are so long that the dark current becomes that of a cooled sensor."""
    longest = max(p.exposure_s for p in points)
    if dark_current is None or not _RARELY_LONG_S < longest <= _LONGEST_S:
        return
    if dark_current.value + 2 * dark_current.standard_uncertainty < _LOW_CURRENT_E_S:
        yield (
            f"the longest exposure is {longest:.4g} s and the dark current {dark_current.value:.2g} e-/s, which only a "
            "cooled camera has: if it is not, the index gives the exposures in picoseconds; write them in nanoseconds"
        )


def flag_photons_unknown(points: Sequence[SeriesPoint]) -> Iterator[str]:
    """Tell that an index gives no photons."""
    if all(point.photons is None for point in points):
        yield (
            "the index gives 0 photons for all bright images, so responsivity and quantum efficiency are not known, "
            "and linearity is that over the exposure: give photons per pixel and exposure"
        )


def flag_linearity(errors: Sequence[Quantity | None]) -> Iterator[str]:
    """Departures from the line that no usable camera has."""
    known = [error for error in errors if error is not None]
    worst = max(known, key=lambda error: abs(error.value), default=None)
    if worst is not None and abs(worst.value) > max(_LARGEST_LINEARITY_ERROR, _CHANCE * worst.standard_uncertainty):
        yield (
            f"the response departs from a straight line by {worst.value:+.1%} {worst.note.partition(';')[0]}: check "
            "the images, exposures and photons of that level, then the light; few cameras are off by more than "
            f"{_LARGEST_LINEARITY_ERROR:.0%}"
        )


def flag_rounding(darks: Sequence[DarkPoint]) -> Iterator[str]:
    """Darkness with so little noise that rounding falsifies it."""
    least = min(point.variance_dn2 for point in darks)
    if least < _DITHERED_DN2:
        shortest = min(darks, key=lambda point: point.exposure_s)
        limit = "read noise is an upper limit, " if shortest.variance_dn2 < LEAST_VARIANCE_DN2 else ""
        yield (
            f"the dark noise is below {_DITHERED_DN:g} DN (variance {least:.3g} DN^2): rounding falsifies read noise, "
            f"dark current and DSNU; {limit}their uncertainties were widened by what it may hide; record at a higher "
            "gain or more bits"
        )


def flag_photons(quantum_efficiency: Quantity | None) -> Iterator[str]:
    """Photon numbers of an index that cannot be."""
    if quantum_efficiency is not None and quantum_efficiency.value > 1:
        yield (
            f"the quantum efficiency is {quantum_efficiency.value:.3g}, more than 1 electron per photon, which is "
            "impossible: the photon numbers are too small; give photons per pixel and exposure"
        )
    if quantum_efficiency is not None and quantum_efficiency.value < _LOWEST_QE:
        yield (
            f"the quantum efficiency is {quantum_efficiency.value:.2g}, less than 0.1 %: the photon numbers are "
            "probably too large; give photons per pixel and exposure, not per second or square metre"
        )


def flag_depth(largest_mean_dn: float, multiple: int, bits: int, saturation: Saturation) -> Iterator[str]:
    """Bits that do not match the values."""
    if multiple > 1:
        yield (
            f"all values are multiples of {multiple}: the camera's {bits - multiple.bit_length() + 1} bits stand in "
            "the upper bits of the images; divide by it and correct the bits, or K is too large by it"
        )
    if saturation.limit != "not reached" and largest_mean_dn < 2 ** (bits - 1) and multiple == 1:
        yield (
            f"the images saturate at {largest_mean_dn:.0f} DN, less than half of what {bits} bits can hold: check the "
            "bits of the data, or the gain is too low to use the converter"
        )


def flag_series(points: Sequence[SeriesPoint], saturation: Saturation) -> Iterator[str]:
    """Too few points, clipping at black, saturation that was not reached."""
    if len(points) < _FEWEST_POINTS:
        yield (
            f"the series has {len(points)} points: the standard asks for at least {_FEWEST_POINTS}; record more "
            "exposures between darkness and saturation"
        )
    black = max(points, key=lambda p: p.dark_black_share)
    if black.dark_black_share > _BLACK_SHARE:
        yield (
            f"{black.dark_black_share:.1%} of the values in darkness at {black.exposure_s:g} s are 0 DN, so noise and "
            "mean of darkness are falsified: raise the camera's black level"
        )
    if saturation.limit == "not reached":
        yield (
            f"saturation was not reached (up to {points[-1].net_dn:.0f} DN above darkness): full well, saturation, "
            "largest SNR and dynamic range are lower limits; record longer exposures or more light"
        )


def flag_noise(points: Sequence[SeriesPoint], saturation: Saturation) -> Iterator[str]:
    """Noise that falls while the signal of a series rises."""
    if saturation.limit == "full well" and _still_rises(points, saturation):
        yield (
            f"the temporal noise falls beyond {points[saturation.index].net_dn:.0f} DN though the signal still rises: "
            "the images are denoised or compressed, or the camera changes its gain; use raw images"
        )


def flag_values(
    dark_current: Quantity | None, by_variance: Quantity | None, limit: SaturationLimit, departure_rel: float
) -> Iterator[str]:
    """Impossible values of dark current; photon transfer that is no line."""
    for quantity, what in ((dark_current, "mean"), (by_variance, "variance")):
        if quantity is not None and quantity.value < -_CHANCE * quantity.standard_uncertainty:
            yield (
                f"the dark current by the {what} is {quantity.value:.3g} e-/s, below zero by "
                f"{-quantity.value / quantity.standard_uncertainty:.0f} standard uncertainties, which is impossible: "
                "was the sensor still warming up, or is the camera's dark current compensation on?"
            )
    if dark_current is not None and (
        dark_current.value - _CHANCE * dark_current.standard_uncertainty > _LARGEST_CURRENT_E_S
    ):
        yield (
            f"the dark current is {dark_current.value:.3g} e-/s, more than any sensor has at room temperature: check "
            "the unit of the exposures"
        )
    if limit == "converter":
        yield (
            "the converter ends the range, not the full well: the saturation capacity stated is what the converter "
            "can show at this gain, a lower limit of the pixel's full well"
        )
    if departure_rel > _LARGEST_DEPARTURE:
        yield (
            f"photon transfer is no straight line, the variances miss it by {departure_rel:.1%} (rms): the noise has "
            "parts that do not come from photons, or the response bends; the uncertainty of K was widened"
        )


def _still_rises(points: Sequence[SeriesPoint], saturation: Saturation) -> bool:
    """Whether the last point is brighter than the peak by at least half of what its stimulus is."""
    peak, last = points[saturation.index], points[-1]
    more = (
        last.exposure_s / peak.exposure_s if last.photons is None or not peak.photons else last.photons / peak.photons
    )
    return more > 1.02 and last.net_dn / peak.net_dn - 1 > 0.5 * (more - 1)
