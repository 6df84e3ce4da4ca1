from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.metrics.correlation.lags import at_lag, chosen, inflation_of_scores, summed, weights

SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 9))
SEEDS = st.integers(0, 2**32 - 1)


def by_brute_force(values, dy, dx):
    height, width = values.shape
    return sum(
        values[y, x] * values[y + dy, x + dx]
        for y in range(height)
        for x in range(width)
        if 0 <= y + dy < height and 0 <= x + dx < width
    )


# More rows than the image has are asked for, too.
@given(shape=SHAPES, lag=st.integers(0, 11), seed=SEEDS)
def test_a_lag_as_by_brute_force(shape, lag, seed):
    values = np.random.default_rng(seed).normal(size=shape)
    assert at_lag(values, values, lag) == pytest.approx(by_brute_force(values, lag, 0), abs=1e-12)


@pytest.mark.parametrize(("reach", "expected"), [(0, [1]), (1, [1, 1, 1, 0.5, 0]), (3, [1] * 5 + [0.75, 0.5, 0.25, 0])])
def test_weights_are_1_up_to_the_lag_after_the_last_one_and_fall_to_0_at_twice_that(reach, expected):
    assert weights(reach).tolist() == expected


@given(
    shape=SHAPES, reaches=st.tuples(st.integers(0, 4), st.integers(0, 4)), seed=SEEDS,
    all_down=st.booleans(), all_right=st.booleans(),
)  # fmt: skip
def test_a_weighted_sum_is_over_all_lags(shape, reaches, seed, all_down, all_right):
    values = np.random.default_rng(seed).normal(size=shape)
    expected = 0.0
    for dy in range(1 - shape[0], shape[0]):
        for dx in range(1 - shape[1], shape[1]):
            u, v = (
                weights(reach)[abs(lag)] if abs(lag) < weights(reach).size else 0.0
                for reach, lag in zip(reaches, (dy, dx), strict=True)
            )
            weight = u + v - u * v if all_down and all_right else v if all_down else u if all_right else u * v
            expected += weight * by_brute_force(values, dy, dx)
    assert summed(values, *reaches, all_down, all_right) == pytest.approx(expected, abs=1e-9)


def test_the_far_lags_of_independent_noise_count_as_rarely_as_chance_says():
    """2.3 standard deviations on one side: 1.1 % of the cases along each axis."""
    rng = np.random.default_rng(6)
    mask = np.ones((24, 30))
    n = 4000
    found = np.zeros(2)
    for _ in range(n):
        image = rng.normal(size=mask.shape)
        found += chosen(image - image.mean(), mask, 2 * sqrt(np.log10(mask.size) / mask.size), 5, 2.3)[2:]
    # A sum of squares is skewed: somewhat more than of a normal distribution lie beyond.
    assert (found / n <= 0.0107 * 2 + 3 * sqrt(0.0107 / n)).all()
    assert (found > 0).all()


@given(shape=st.tuples(st.integers(3, 40), st.integers(3, 8)), share=st.floats(0.3, 1), seed=SEEDS)
def test_a_region_seen_in_a_mirror_has_the_same_inflation(shape, share, seed):
    rng = np.random.default_rng(seed)
    image, mask = rng.normal(size=shape) + rng.normal(0, 0.5, (shape[0], 1)), rng.random(shape) < share
    mask[0, :2] = True
    # Narrow ones have no pairs at far lags, and only rounding could tell there whether they are correlated.
    image = np.where(mask, image - image[mask].mean(), 0)
    expected = inflation_of_scores(image, mask)
    assert inflation_of_scores(image[:, ::-1], mask[:, ::-1]) == pytest.approx(expected, rel=1e-9)
    assert inflation_of_scores(image.T, mask.T) == pytest.approx(expected, rel=1e-9)
