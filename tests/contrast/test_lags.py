from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.contrast import lags, variance_inflation
from labcdp.contrast.correlation import _Weights
from labcdp.contrast.lags import Lags, lags_of_mask

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


def table(values, down, right):
    return [[by_brute_force(values, dy, dx) for dx in range(1 - right, right)] for dy in range(1 - down, down)]


# More lags than the image has are asked for, too.
@pytest.mark.parametrize("cost_of_transform", [0, inf])
@given(shape=SHAPES, down=st.integers(1, 11), right=st.integers(1, 11), seed=SEEDS)
def test_sums_as_by_brute_force(cost_of_transform, shape, down, right, seed):
    values = np.random.default_rng(seed).normal(size=shape)
    expected = np.array(table(values, down, right))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lags, "_PRODUCTS_OF_TRANSFORM", cost_of_transform)
        patch.setattr(lags, "_PRODUCTS_OF_STEP", 0)
        np.testing.assert_allclose(Lags(values).near(down, right), expected, atol=1e-12)
        np.testing.assert_allclose(Lags(values).line(0, down), expected[down - 1 :, right - 1], atol=1e-12)
        np.testing.assert_allclose(Lags(values).line(1, right), expected[down - 1, right - 1 :], atol=1e-12)


@given(shape=SHAPES, counts=st.lists(st.tuples(st.integers(1, 11), st.integers(1, 11)), min_size=2), seed=SEEDS)
def test_what_was_asked_for_before_does_not_matter(shape, counts, seed):
    mask = np.random.default_rng(seed).random(shape) < 0.6
    of_mask = lags_of_mask(mask)
    for down, right in counts:
        expected = np.array(table(mask.astype(float), down, right))
        assert (of_mask.line(1, right) == expected[down - 1, right - 1 :]).all()
        assert (of_mask.near(down, right) == expected).all()
        assert (of_mask.line(0, down) == expected[down - 1 :, right - 1]).all()


@given(shape=SHAPES, down=st.integers(1, 11), right=st.integers(1, 11), full=st.booleans(), seed=SEEDS)
def test_pairs_of_a_mask_as_by_brute_force(shape, down, right, full, seed):
    mask = np.ones(shape, bool) if full else np.random.default_rng(seed).random(shape) < 0.6
    assert (lags_of_mask(mask).near(down, right) == table(mask.astype(float), down, right)).all()


@given(shape=SHAPES, seed=SEEDS, all_down=st.booleans(), all_right=st.booleans())
def test_a_weighted_sum_is_over_all_lags(shape, seed, all_down, all_right):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=shape)
    down, right = (np.sort(np.append(rng.random(rng.integers(0, length)), 1))[::-1] for length in shape)
    expected = 0.0
    for dy in range(1 - shape[0], shape[0]):
        for dx in range(1 - shape[1], shape[1]):
            along_down, along_right = (
                weights[abs(lag)] if abs(lag) < weights.size else 0 for weights, lag in ((down, dy), (right, dx))
            )
            weight = max(along_down * along_right, all_down * along_right, all_right * along_down)
            expected += weight * by_brute_force(values, dy, dx)
    assert _Weights(down, right, all_down, all_right).sum_of(Lags(values)) == pytest.approx(expected, abs=1e-10)


@given(shape=st.tuples(st.integers(3, 40), st.integers(3, 8)), share=st.floats(0.3, 1), seed=SEEDS)
def test_a_region_seen_in_a_mirror_has_the_same_inflation(shape, share, seed):
    rng = np.random.default_rng(seed)
    image, mask = rng.normal(size=shape) + rng.normal(0, 0.5, (shape[0], 1)), rng.random(shape) < share
    mask[0, :2] = True
    # Narrow ones have no pairs at far lags, and only rounding could tell there whether they are correlated.
    expected = variance_inflation(image, mask)
    assert variance_inflation(image[:, ::-1], mask[:, ::-1]) == pytest.approx(expected, rel=1e-9)
    assert variance_inflation(image.T, mask.T) == pytest.approx(expected, rel=1e-9)
