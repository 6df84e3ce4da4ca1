"""Assemble a characterisation from measured points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot
from typing import Any

import numpy as np

from ...core.result import Finding, unique
from ..frames.observations import DarkObservation
from ..frames.statistics import MAX_CLIPPED_SHARE
from ..sensor.dark_fit import drift_of_black_level
from .findings import findings_of
from .quantities import fit_dark_current, sensitivity_threshold_e, snr_max
from .result import Characterisation, Quantity
from .series import SeriesPoint
from .transfer import Saturation, departure_rel, find_saturation, points_to_fit, system_gain

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
    found = Characterisation(
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
    return with_findings(found, findings_of(found, departure_rel(transfer.fitted, k.value)))


def with_findings(found: Characterisation, more: Iterable[Finding]) -> Characterisation:
    """Return a characterisation with further findings."""
    return replace(found, findings=unique([*found.findings, *more]))


def with_frame_changes(points: Sequence[SeriesPoint], darks: Sequence[DarkObservation]) -> list[SeriesPoint]:
    """Add what black level and lamp change from frame to frame to the uncertainty of each point."""
    drift_dn2 = drift_of_black_level(darks)[0] ** 2
    lit = [point for point in points if point.net_dn > 0 and point.light.saturated_share <= MAX_CLIPPED_SHARE]
    seen = [
        np.var(p.light.frame_means_dn, ddof=1) - p.light.mean_variance_dn2 * p.light.n_frames - drift_dn2 for p in lit
    ]
    # Relative flicker shows best where the light is brightest.
    weights = [point.net_dn**4 * (point.light.n_frames - 1) for point in lit]
    relative2 = [one / point.net_dn**2 for one, point in zip(seen, lit, strict=True)]
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
    found, k = transfer.saturation, transfer.k
    net, relative = found.net_dn, found.net_uncertainty_dn / found.net_dn
    limited = "" if found.limit == "full well" else ", a lower limit of the pixel's full well"
    photons = points[found.index].photons
    value = net / k.value
    if photons is not None and responsivity is not None:
        value = responsivity.value * photons / k.value
    return (
        Quantity(net, relative * net, "DN", "above the dark signal"),
        None if photons is None else Quantity(photons, relative * photons, "photons", "known to half a step"),
        Quantity(value, hypot(relative, k.relative) * value, "e-", found.definition + limited),
    )
