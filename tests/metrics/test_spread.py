from fractions import Fraction
from math import inf

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.metrics import contrast_distribution

region = st.lists(st.one_of(st.integers(-2, 8), st.integers(90, 130)), min_size=1, max_size=10)
edges = st.lists(st.decimals("-1", "5", places=2), min_size=1, max_size=8, unique=True).map(sorted)


@given(region, region, edges)
def test_it_is_the_share_of_all_pairs_up_to_each_edge(all_contrasts, a, b, bins):
    assume(max(a + b) > 0)
    flat = [value for row in all_contrasts(a, b) for value in row]
    expected = [float(Fraction(sum(not value > edge for value in flat), len(flat))) for edge in map(Fraction, bins)]
    result = contrast_distribution(a, b, np.array(bins, dtype=float))
    assert result.cumulative.tolist() == expected
    assert result.undefined == pytest.approx(sum(value != value for value in flat) / len(flat), abs=1e-15)
    assert result.unbounded == pytest.approx(flat.count(inf) / len(flat), abs=1e-15)


@pytest.mark.parametrize(
    ("bins", "message"),
    [
        ([], "bins are not a rising list of finite contrasts: give edges such as 0, 0.1, 0.2"),
        ([0.1, 0.1], "bins are not a rising list of finite contrasts"),
        ([0.2, 0.1], "bins are not a rising list of finite contrasts"),
        ([0, np.inf], "bins are not a rising list of finite contrasts"),
        ([np.nan], "bins are not a rising list of finite contrasts"),
        (0, "bins is 0: give a number above 0, or edges such as 0, 0.1, 0.2"),
        (0.5, "bins are not a rising list of finite contrasts"),
        ([-1.5, 0], r"bins start at -1\.5: no contrast is below -1 between values above 0"),
    ],
)
def test_unusable_edges_are_refused(bins, message):
    with pytest.raises(InputError, match=message):
        contrast_distribution([2], [1], bins)


def test_bins_cover_all_but_a_thousandth_of_the_contrasts():
    rng = np.random.default_rng(23)
    a, b = rng.normal(100, 5, 300), rng.normal(120, 5, 200)
    result = contrast_distribution(a, b, 50)
    contrasts = np.divide.outer(b, a).ravel() - 1
    low, high = np.quantile(contrasts, [0.0005, 0.9995], method="inverted_cdf")
    width = (high - low) / 50
    assert np.diff(result.edges) == pytest.approx(np.full(result.edges.size - 1, width))
    assert low - width < result.edges[0] <= low
    assert high <= result.edges[-1] < high + width
    assert result.cumulative[-1] - result.cumulative[0] > 0.999


def test_bins_leave_unbounded_and_undefined_contrasts_out():
    result = contrast_distribution([120, 130, 0], [100, 110, 0], 4)
    # -1 for the bright 0; above it four finite contrasts up to 0.3.
    assert result.edges[0] == -1
    assert 0.3 < result.edges[-1] < 0.3 + np.diff(result.edges)[-1]
    assert result.cumulative[-1] == pytest.approx(7 / 9)
