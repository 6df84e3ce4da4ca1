"""The difference of two values against closed forms and published examples."""

from math import hypot, inf, nan, sqrt

import numpy as np
import pytest

from labcdp.core.table import Z_95
from labcdp.evaluate.compare.grid import Uncertain, difference


def symmetric(value, u, **common):
    return Uncertain(value, Z_95 * u, Z_95 * u, common)


def wilson(hits, n):
    """Interval of E. B. Wilson for a share of independent trials."""
    p = hits / n
    middle, half = p + Z_95**2 / (2 * n), Z_95 * sqrt(p * (1 - p) / n + Z_95**2 / (4 * n * n))
    low, high = ((middle + sign * half) / (1 + Z_95**2 / n) for sign in (-1, 1))
    return Uncertain(p, p - low, high - p)


@pytest.mark.parametrize(
    ("first", "second", "low", "high"),
    [
        # Newcombe, Statistics in Medicine 17, 873 (1998), table II, method 10; first minus second.
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((9, 10), (3, 10), 0.1705, 0.8090),
        ((10, 10), (0, 20), 0.6791, 1.0),
    ],
)
def test_shares_have_the_published_intervals(first, second, low, high):
    found = difference(wilson(*second), wilson(*first))
    assert [found.low, found.high] == pytest.approx([low, high], abs=5e-5)
    assert found.significant


def test_common_errors_follow_the_law_of_propagation():
    """With a = x + c and b = y + c, the variance of b - a is that of x and y alone."""
    x, y, c = 0.3, 0.4, 1.2
    (u_a, u_b) = (hypot(own, c) for own in (x, y))
    a, b = symmetric(1.0, u_a, meter=c / u_a), symmetric(2.0, u_b, meter=c / u_b)
    assert difference(a, b).z == pytest.approx(1 / 0.5)
    # Of unequal sensitivity to the common error, the difference of the sensitivities is left.
    assert difference(symmetric(1.0, 0.3, meter=1.0), symmetric(2.0, 0.5, meter=1.0)).z == pytest.approx(1 / 0.2)
    # Errors of different meters are independent.
    assert difference(symmetric(1.0, 0.3, meter=1.0), symmetric(2.0, 0.4, other=1.0)).z == pytest.approx(2.0)


def test_coverage_of_correlated_values_is_95_percent():
    rng = np.random.default_rng(1)
    n = 20_000
    c = rng.normal(0, 1.2, n)
    first, second = 5 + rng.normal(0, 0.3, n) + c, 6 + rng.normal(0, 0.4, n) + c
    u = [hypot(own, 1.2) for own in (0.3, 0.4)]
    found = difference(symmetric(first, u[0], meter=1.2 / u[0]), symmetric(second, u[1], meter=1.2 / u[1]))
    share = np.mean((found.low < 1) & (found.high > 1))
    assert abs(share - 0.95) < 4 * sqrt(0.95 * 0.05 / n)


def test_equal_exact_and_unknown_values():
    same = symmetric(3.0, 0.1, data=1.0)
    found = difference(same, same)
    assert [found.value, found.low, found.high, found.z] == [0, 0, 0, 0]
    assert not found.significant
    # Rounding is no difference.
    assert difference(Uncertain(0.3), Uncertain(0.1 + 0.2)).z == 0
    assert difference(Uncertain(1.0), Uncertain(0.5)).z == -inf
    unknown = difference(Uncertain(1.0, nan, nan), symmetric(2.0, 0.1))
    assert np.isnan(unknown.z)
    assert not unknown.significant
