"""Assemble a characterisation from measured points."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from ...core.quantity import Quantity
from ...core.result import Finding, info, unique, warning
from ..frames.observations import DarkObservation
from ..frames.rounding import ROUNDING_DN2
from ..frames.statistics import MAX_CLIPPED_SHARE
from ..sensor.dark_fit import black_level_drift
from .quantities import LEAST_VARIANCE_DN2, fit_dark_current, sensitivity_threshold_e, snr_max
from .result import Characterisation, SeriesPoint
from .transfer import Saturation, departure_rel, find_saturation, points_to_fit, system_gain

_Point = TypeVar("_Point", bound=SeriesPoint)
#: The definitions used.
DEFINITION = "EMVA 1288 Release 4.0 Linear; LE_min and LE_max after Release 3.1"


@dataclass(frozen=True)
class Transfer:
    """Saturation and system gain of a series.

    Parameters
    ----------
    saturation : Saturation
        End of the range.
    fitted : sequence of SeriesPoint
        Points up to 70 % of it.
    k : Quantity
        Overall system gain.
    """

    saturation: Saturation
    fitted: Sequence[SeriesPoint]
    k: Quantity


def photon_transfer(points: Sequence[SeriesPoint]) -> Transfer:
    """Find saturation and K of a series, by the standard's unweighted fit.

    Parameters
    ----------
    points : sequence of SeriesPoint
        In rising order of signal.

    Raises
    ------
    CalibrationError
        If there are too few points, or K is not above 0.
    """
    saturation = find_saturation(points)
    fitted = points_to_fit(points, saturation.net_dn)
    return Transfer(saturation, fitted, system_gain(fitted))


def assemble(
    origin: Mapping[str, Any],
    points: Sequence[SeriesPoint],
    darks: Sequence[DarkObservation],
    transfer: Transfer,
    measured: Mapping[str, Any],
) -> Characterisation:
    """Join all parts; `origin` and `measured` are attributes of the characterisation, the latter quantities."""
    k, qe, limit = transfer.k, measured.get("quantum_efficiency"), transfer.saturation.limit
    dark: dict[str, Any] = {**fit_dark_current(darks).quantities(k)}
    saturation_dn, photons, full_well = _saturation(points, transfer, measured.get("responsivity"))
    threshold = sensitivity_threshold_e(dark["dark_noise_dn"], k)
    note = "a lower limit" if limit != "full well" else ""
    result = Characterisation(
        **origin,
        **measured,
        **dark,
        definition=DEFINITION,
        k_dn_per_e=k,
        saturation_limit=limit,
        saturation_dn=saturation_dn,
        saturation_photons=photons,
        full_well_e=full_well,
        snr_max=snr_max(full_well, note),
        sensitivity_threshold_e=threshold,
        sensitivity_threshold_photons=qe and threshold.over(qe, "photons", "with the quantum efficiency stated"),
        dynamic_range=full_well.over(threshold, "1", note),
        series=tuple(points),
        darks=tuple(darks),
        findings=(),
    )
    return with_findings(result, characterisation_findings(result, departure_rel(transfer.fitted, k.value)))


def with_findings(result: Characterisation, more: Iterable[Finding]) -> Characterisation:
    """Return a characterisation with further findings."""
    return replace(result, findings=unique([*result.findings, *more]))


def with_frame_changes(points: Sequence[_Point], darks: Sequence[DarkObservation]) -> list[_Point]:
    """Add what black level and lamp change from frame to frame to the uncertainty of each point."""
    drift_dn2 = black_level_drift(darks)[0] ** 2
    lit = [point for point in points if point.net_dn > 0 and point.light.saturated_share <= MAX_CLIPPED_SHARE]
    seen = [
        np.var(p.light.frame_means_dn, ddof=1) - p.light.mean_variance_dn2 * p.light.n_frames - drift_dn2 for p in lit
    ]
    # Relative flicker shows best where the light is brightest.
    weights = [point.net_dn**4 * (point.light.n_frames - 1) for point in lit]
    relative2 = [mean / point.net_dn**2 for mean, point in zip(seen, lit, strict=True)]
    flicker2 = max(float(np.average(relative2, weights=weights)), 0.0) if lit else 0.0
    return [
        replace(
            p, frames_variance_dn2=(flicker2 * p.net_dn**2 + drift_dn2) / p.light.n_frames + drift_dn2 / p.dark.n_frames
        )
        for p in points
    ]


def _saturation(
    points: Sequence[SeriesPoint], transfer: Transfer, responsivity: Quantity | None
) -> tuple[Quantity, Quantity | None, Quantity]:
    """Saturation in DN above dark signal, in photons, and in electrons.

    Electrons are R / K times the photons (mu_e.sat of the standard), or DN over K without photons.
    """
    saturation, k = transfer.saturation, transfer.k
    net, relative = saturation.net_dn, saturation.net_uncertainty_dn / saturation.net_dn
    limited = "" if saturation.limit == "full well" else ", a lower limit of the pixel's full well"
    photons = points[saturation.index].photons
    full_dn = net if photons is None or responsivity is None else responsivity.value * photons
    return (
        Quantity(net, relative * net, "DN", "above the dark signal"),
        None if photons is None else Quantity(photons, relative * photons, "photons", "known to half a step"),
        Quantity(full_dn, relative * full_dn, "DN").over(k, "e-", saturation.definition + limited),
    )


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


def characterisation_findings(result: Characterisation, departure_rel: float) -> Iterator[Finding]:
    """Find what is impossible or implausible in data sets and sessions.

    Parameters
    ----------
    found : Characterisation
        To judge.
    departure_rel : float
        Relative departure of the photon transfer from its line.
    """
    points, limit = result.series, result.saturation_limit
    # Bits that do not match the values.
    largest_mean_dn, multiple = max(p.light.mean_dn for p in points), min(p.light.multiple for p in points)
    if multiple > 1:
        yield warning("bits-shifted", multiple=multiple, bits=result.bits - multiple.bit_length() + 1)
    elif limit != "not reached" and largest_mean_dn < 2 ** (result.bits - 1):
        yield warning("bits-unused", saturation_dn=largest_mean_dn, bits=result.bits)
    if len(points) < _FEWEST_POINTS:
        yield warning("few-points", count=len(points), least=_FEWEST_POINTS)
    black = max(points, key=lambda p: p.dark.black_share)
    if black.dark.black_share > _BLACK_SHARE:
        yield warning("dark-values-clipped", share=black.dark.black_share, exposure_s=black.exposure_s)
    if limit == "not reached":
        # A photon series is recorded up to saturation, a session need not be.
        series = all(point.photons is not None for point in points)
        yield (warning if series else info)("saturation-not-reached", net_dn=points[-1].net_dn)
    if limit == "converter":
        yield info("converter-saturates")
    yield from _dark_current_findings(result)
    if departure_rel > _LARGEST_DEPARTURE:
        yield warning("photon-transfer-not-straight", departure_rel=departure_rel)
    # Deviations from the line that no usable camera has.
    errors = [error for error in (result.linearity_error_min_rel, result.linearity_error_max_rel) if error is not None]
    worst = max(errors, key=lambda error: abs(error.value), default=None)
    if worst is not None and abs(worst.value) > max(_LARGEST_LINEARITY_ERROR, _CHANCE * worst.u):
        yield warning("not-linear", deviation_rel=worst.value, usual_rel=_LARGEST_LINEARITY_ERROR)
    # Dark signals with too little noise to dither rounding.
    least = min(dark.temporal_variance_dn2 for dark in result.darks)
    if least < _DITHERED_DN2:
        yield warning("dark-noise-rounded", limit_dn=_DITHERED_DN, variance_dn2=least)
        if min(result.darks, key=lambda dark: dark.exposure_s).temporal_variance_dn2 < LEAST_VARIANCE_DN2:
            yield info("read-noise-upper-limit")


def findings_of_data_set(result: Characterisation) -> Iterator[Finding]:
    """Find exposures and photon numbers that the index of a data set cannot mean, and noise that falls."""
    exposures_s = [point.exposure_s for point in result.series]
    shortest, longest, current = min(exposures_s), max(exposures_s), result.dark_current_e_s
    if 0 < shortest < _SHORTEST_S or longest < _LONGEST_SHORT_S or longest > _LONGEST_S:
        yield warning("exposures-not-in-ns", range_ns=[shortest * 1e9, longest * 1e9])
    elif longest < _RARELY_SHORT_S:
        yield warning("exposures-perhaps-in-us", longest_s=longest)
    low = current is not None and current.value + 2 * current.u < _LOW_CURRENT_E_S
    if current is not None and low and _RARELY_LONG_S < longest <= _LONGEST_S:
        yield warning("exposures-perhaps-in-ps", longest_s=longest, dark_current_e_s=current.value)
    if all(point.photons is None for point in result.series):
        yield warning("photons-unknown")
    efficiency = result.quantum_efficiency
    if efficiency is not None and not _LOWEST_QE <= efficiency.value <= 1:
        code = "photons-too-few" if efficiency.value > 1 else "photons-too-many"
        yield warning(code, quantum_efficiency=efficiency.value)
    if result.saturation_limit == "full well" and _still_rises(result):
        yield warning("noise-falls", net_dn=result.saturation_dn.value)


def _dark_current_findings(result: Characterisation) -> Iterator[Finding]:
    mean, by_variance = result.dark_current_e_s, result.dark_current_by_variance_e_s
    for current, code in ((mean, "dark-current-negative"), (by_variance, "dark-current-by-variance-negative")):
        if current is not None and current.value < -_CHANCE * current.u:
            z = -current.value / current.u
            yield warning(code, dark_current_e_s=current.value, z=z)
    if mean is not None and mean.value - _CHANCE * mean.u > _LARGEST_CURRENT_E_S:
        yield warning("dark-current-too-large", dark_current_e_s=mean.value)


def _still_rises(result: Characterisation) -> bool:
    """Whether the last point exceeds the peak by at least half of the increase of the stimulus."""
    last, full, photons = result.series[-1], result.saturation_dn.value, result.saturation_photons
    peak = next(point for point in result.series if point.net_dn == full)
    if last.photons is None or photons is None or photons.value == 0:
        more = last.exposure_s / peak.exposure_s
    else:
        more = last.photons / photons.value
    return more > 1.02 and last.net_dn / full - 1 > 0.5 * (more - 1)
