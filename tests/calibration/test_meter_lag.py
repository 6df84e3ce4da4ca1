"""A meter whose readings are partly the one before: found where readings alternate, and not mistaken for drift."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from labcdp.calibration.meter_lag import lag_findings, meter_lag

from .conftest import make_reading

NOON = datetime(2018, 3, 1, 12, tzinfo=UTC)
LEVELS = {"a": 1.0, "b": 10.0, "c": 100.0, "d": 1000.0}


def readings(visits, n, lag=0.0, noise_rel=0.002, drift_rel=0.0, seed=1):
    """Readings of a meter that keeps a share of the reading before, in light that drifts over the whole time."""
    rng = np.random.default_rng(seed)
    series = {name: [] for name in visits}
    before, total = None, len(visits) * n
    for second, name in enumerate(name for name in visits for _ in range(n)):
        true = LEVELS[name] * (1 + drift_rel * second / total) * (1 + noise_rel * rng.standard_normal())
        before = true if before is None else true + lag * (before - true)
        at = NOON + timedelta(seconds=second)
        changes = {"resolution": 1e-4, "digits_half_width": 1e-4, "repeatability_rel": noise_rel}
        series[name].append(make_reading(before, timestamp=at, **changes))
    return series


@pytest.mark.parametrize("lag", [0.003, 0.02, 0.1])
@pytest.mark.parametrize(("visits", "n"), [("abcd", 3), ("dbca", 3), ("acdacdcada", 1), ("abdabcd", 2)])
def test_the_lag_is_found_within_its_uncertainty(lag, visits, n):
    found = [meter_lag(readings(visits, n, lag, seed=seed)).lag for seed in range(40)]
    values, u = np.array([q.value for q in found]), np.array([q.u for q in found])
    assert abs(values.mean() - lag) < 4 * values.std() / np.sqrt(40) + 1e-6
    assert values.std() < 2 * np.median(u)


def test_without_lag_it_is_rarely_significant_also_where_the_light_drifts():
    for drift_rel in (0.0, 0.02, -0.02):
        said = [bool(lag_findings("m", readings("abcdcba", 3, 0.0, drift_rel=drift_rel, seed=s))) for s in range(50)]
        assert sum(said) <= 2


def test_the_finding_names_the_patch_that_is_most_wrong():
    (finding,) = lag_findings("LS-110 1", readings("da", 3, 0.02))
    # A third of 2 % of 1000 cd/m² on 1 cd/m².
    assert finding.values["patch"] == "a"
    assert finding.values["effect_rel"] == pytest.approx(0.02 * 999 / 3, rel=0.05)
    assert (finding.code, finding.severity, finding.subject) == ("meter-lags", "warning", "LS-110 1")


def test_nothing_is_said_where_nothing_alternates_or_the_order_is_not_known():
    assert meter_lag(readings("a", 5)) is None
    assert meter_lag(readings("ab", 1)) is None
    # Each reading of a patch follows the same other patch.
    assert meter_lag(readings("acacacac", 1, 0.1)) is None
    same_time = {name: [make_reading(value)] * 3 for name, value in LEVELS.items()}
    assert meter_lag(same_time) is None
    assert lag_findings("m", same_time) == []
