from fractions import Fraction
from math import inf, nan, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labcdp.core.errors import InputError
from labcdp.metrics import DetectionInterval, cdp_neighbours

from .conftest import neighbours_of

levels = st.one_of(st.integers(-2, 6), st.integers(90, 130))
images = hnp.arrays(np.int32, st.tuples(st.integers(1, 7), st.integers(2, 7)), elements=levels).filter(
    lambda image: image.max() > 0
)
contrasts = st.decimals("0.01", "0.99", places=2).map(float)
epsilons = st.one_of(
    st.decimals("0.01", "1", places=2).map(float),
    st.builds(DetectionInterval, st.sampled_from([0.0, 0.2, 1.0, None]), st.sampled_from([0.1, 2.0])),
    st.builds(DetectionInterval.at_least, st.sampled_from([0.0, 0.5, 1.0])),
)


def neighbour_contrasts(image):
    """Weber contrast of each pixel with its right and its lower neighbour: Fraction, inf or nan."""
    pairs = ((int(small), int(large)) for small, large in neighbours_of(image))
    return [Fraction(large, small) - 1 if small > 0 else inf if large > 0 else nan for small, large in pairs]


def interval(contrast, epsilon):
    asked = Fraction(str(contrast))
    below, above = (epsilon.below, epsilon.above) if isinstance(epsilon, DetectionInterval) else (epsilon, epsilon)
    low = -inf if below is None else asked * (1 - Fraction(str(below)))
    return low, inf if above is None else asked * (1 + Fraction(str(above)))


@given(images, contrasts, epsilons)
def test_every_pair_of_neighbours_is_compared_in_exact_arithmetic(image, contrast, epsilon):
    low, high = interval(contrast, epsilon)
    found = neighbour_contrasts(image)
    result = cdp_neighbours(image, contrast, epsilon)
    assert result.pairs == len(found)
    assert result.cdp == sum(low <= value <= high for value in found) / len(found)
    assert result.above == sum(value > high for value in found) / len(found)
    assert result.undefined == sum(value != value for value in found) / len(found)
    assert result.below + result.cdp + result.above == pytest.approx(1, abs=1e-15)


@given(images, st.lists(contrasts, min_size=1, max_size=3))
def test_a_range_equals_single_contrasts(assert_array_equals_numbers, image, asked):
    array = cdp_neighbours(image, np.array(asked), definition="michelson")
    assert_array_equals_numbers(array, [cdp_neighbours(image, one, definition="michelson") for one in asked])
    for index, record in enumerate(array):
        assert (array.cdp[index], array.below[index], array.pairs) == (record.cdp, record.below, record.pairs)


def test_a_perfect_checkerboard_of_the_thesis_is_all_detected():
    board = 100 + 20 * (np.indices((301, 420)).sum(axis=0) % 2)
    result = cdp_neighbours(board, 0.2)
    assert (result.cdp, result.u, result.pairs) == (1, 0, 252_119)
    # As many trials as a quarter of the pairs.
    assert result.interval == pytest.approx((1 / (1 + 1.96**2 / (252_119 / 4)), 1), abs=1e-7)


def checkerboard(rng, shape, std, pattern_std):
    image = 100 + 20 * (np.indices(shape).sum(axis=0) % 2) + rng.normal(0, std, shape)
    return image + rng.normal(0, pattern_std, (shape[0], 1)) + rng.normal(0, pattern_std, (1, shape[1]))


@pytest.mark.parametrize(("std", "pattern_std"), [(5, 0), (2, 6)])
def test_the_confidence_interval_covers_the_truth(std, pattern_std):
    rng = np.random.default_rng(6)
    shape, repeats = (60, 60), 300
    # A long mean is the truth; its own error is a twentieth of that of one image.
    results = [cdp_neighbours(checkerboard(rng, shape, std, pattern_std), 0.2) for _ in range(repeats)]
    truth = np.mean([result.cdp for result in results])
    covered = np.mean([low <= truth <= high for low, high in (result.interval for result in results)])
    assert 0.93 - 3 * sqrt(0.93 * 0.07 / repeats) < covered < 0.98 + 3 * sqrt(0.98 * 0.02 / repeats)


@pytest.mark.parametrize("shape", [(7, 50), (50, 7), (1, 2)])
def test_few_rows_or_columns_have_no_standard_error(shape):
    result = cdp_neighbours(np.full(shape, 100), 0.2)
    assert np.isnan([result.u, *result.interval]).all()


@pytest.mark.parametrize("image", [[1, 2], [[5]], [[1, np.nan], [np.inf, 2]], [[0, -1], [0, 0]], [[1, 2**53 + 1]]])
def test_unusable_images_are_refused(image):
    with pytest.raises(InputError, match=r"image (has 1 dimensions|holds|spans)"):
        cdp_neighbours(image, 0.2)
