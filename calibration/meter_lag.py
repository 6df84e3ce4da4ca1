"""Lag of a slow meter: a reading that is partly the one before, found where readings alternate between patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..core.quantity import Quantity
from ..core.reading import Reading
from ..core.result import Finding, warning

#: Standard uncertainties from which a lag is significant.
_SIGNIFICANT = 3.0
#: Lag, and error of the mean of a patch, below which it does no harm worth a number.
_NEGLIGIBLE_REL = 0.001


#: Steps between the luminances of patches decide, not what else changes from reading to reading, as noise and drift.
_STEPS_SHARE = 0.9


@dataclass(frozen=True)
class MeterLag:
    """Share of the reading before in the first reading after a change of patch.

    Parameters
    ----------
    lag : Quantity
        The share, from 0 (none) to 1.
    effect_rel : mapping of str to float
        Relative error of the mean of each patch by it.

    Examples
    --------
    >>> from labcdp.calibration.meter_lag import MeterLag
    >>> from labcdp.core.quantity import Quantity
    >>> MeterLag(Quantity(0.05, 0.01), {"dark": 0.3}).is_significant
    True
    """

    lag: Quantity
    effect_rel: Mapping[str, float]

    @property
    def is_significant(self) -> bool:
        """Whether it is beyond its uncertainty, and changes the mean of a patch."""
        worst = max((abs(effect) for effect in self.effect_rel.values()), default=0.0)
        lag = self.lag.value
        return lag > max(_NEGLIGIBLE_REL, _SIGNIFICANT * self.lag.u) and worst > _NEGLIGIBLE_REL


def meter_lag(readings: Mapping[str, Sequence[Reading]]) -> MeterLag | None:
    """Find by how much the readings of a patch depend on the patch that was read before.

    A reading of a patch of luminance M is M + a (r - M), r the reading before, a the lag. a is the slope of a weighted
    straight line, with a constant for each patch; weights are those of the readings' random uncertainty. Steps between
    patches decide: a change of the light during the session changes neighbouring readings alike and hardly a.

    Parameters
    ----------
    readings : mapping of str to sequence of Reading
        By patch. Their times say their order.

    Returns
    -------
    MeterLag or None
        None if the order is not known, or readings do not alternate enough: there must be more of them than patches,
        and a patch with a reading after another patch and one that is not, or after two.

    Examples
    --------
    A meter that keeps a tenth of the reading before, read on 100 and 10 cd/m²:

    >>> from datetime import UTC, datetime, timedelta
    >>> from labcdp.calibration.meter_lag import meter_lag
    >>> from labcdp.core.reading import MeterIdentity
    >>> from labcdp.drivers.manual import MeterAccuracy, parse_written, reading_of
    >>> accuracy, meter = MeterAccuracy(0.02, 0.001, digits=1), MeterIdentity("L 1003", "4711")
    >>> def reading(text, second):
    ...     at = datetime(2026, 3, 1, tzinfo=UTC) + timedelta(seconds=second)
    ...     return reading_of(parse_written(text), "cd/m2", accuracy, meter, at, text)
    >>> bright = [reading(text, second) for second, text in enumerate(("100.0", "100.0", "100.0"))]
    >>> dark = [reading(text, 10 + second) for second, text in enumerate(("19.0", "10.9", "10.1"))]
    >>> found = meter_lag({"bright": bright, "dark": dark})
    >>> round(found.lag.value, 3), found.is_significant
    (0.1, True)
    """
    ordered = sorted(
        ((reading.timestamp, patch, reading) for patch, group in readings.items() for reading in group),
        key=lambda item: item[0],
    )
    if any(before[0] == after[0] for before, after in pairwise(ordered)):
        return None
    names = list(readings)
    n = len(names)
    patch = np.array([names.index(name) for _, name, _ in ordered])
    value = np.array([reading.luminance_cd_m2 for _, _, reading in ordered])
    u = _levels(patch, np.array([reading.standard_uncertainty_random_cd_m2 for _, _, reading in ordered]), n)
    if len(value) < n + 2 or not (u > 0).all():
        return None
    level = _levels(patch, value, n)
    step = np.concatenate([[0.0], value[:-1] - level[patch[1:]]])
    slope = _slope(step[1:], level[patch[:-1]] - level[patch[1:]], value[1:], 1 / u[patch[1:]] ** 2, patch[1:], n)
    if slope is None:
        return None
    counts = np.maximum(np.bincount(patch, minlength=n), 1)
    by_patch = np.bincount(patch, weights=slope.value * step, minlength=n) / counts
    known = {name: by_patch[i] / level[i] for i, name in enumerate(names) if level[i] > 0}
    return MeterLag(slope, {name: float(effect) for name, effect in known.items()})


def _levels(patch: NDArray[np.intp], value: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Return the luminance of each patch by its last readings before another one, which lag least."""
    last = np.concatenate([patch[1:] != patch[:-1], [True]])
    totals = np.bincount(patch[last], weights=value[last], minlength=n)
    return totals / np.maximum(np.bincount(patch[last], minlength=n), 1)


def _slope(
    x: NDArray[np.float64],
    between_patches: NDArray[np.float64],
    y: NDArray[np.float64],
    weight: NDArray[np.float64],
    group: NDArray[np.intp],
    n: int,
) -> Quantity | None:
    """Return the slope of a weighted line with a constant for each group; None if steps do not decide it."""

    def within(values: NDArray[np.float64]) -> NDArray[np.float64]:
        total = np.bincount(group, weights=weight, minlength=n)
        mean = np.bincount(group, weights=weight * values, minlength=n) / np.where(total > 0, total, 1)
        return values - mean[group]

    x, y, between = within(x), within(y), within(between_patches)
    size = float(weight @ x**2)
    dof = len(y) - len(np.unique(group)) - 1
    if dof < 1 or not float(weight @ between**2) > _STEPS_SHARE * size > 0:
        return None
    slope = float(weight @ (x * y)) / size
    chi2 = float(weight @ (y - slope * x) ** 2)
    return Quantity(slope, sqrt(max(1.0, chi2 / dof) / size), dof=dof)


def lag_findings(meter: str, readings: Mapping[str, Sequence[Reading]]) -> list[Finding]:
    """Return a warning if a meter lags, none otherwise."""
    found = meter_lag(readings)
    if found is None or not found.is_significant:
        return []
    patch = max(found.effect_rel, key=lambda name: abs(found.effect_rel[name]))
    values = {"lag": found.lag.value, "lag_U": found.lag.U, "effect_rel": found.effect_rel[patch]}
    return [warning("meter-lags", meter, patch=patch, **values)]
