"""The compiled loops of the tracker against NumPy and OpenCV."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.tracking.geometry import shift
from labcdp.tracking.level import Level
from labcdp.tracking.level_kernel import first_light, next_light, nothing_seen, sample
from labcdp.tracking.matrix_kernel import invert, multiply, solve_positive
from labcdp.tracking.outline_kernel import share_gone, sum_edges
from labcdp.tracking.select_kernel import kth_smallest, median
from labcdp.tracking.simulated import Moment, SimulatedVideo, pose
from labcdp.tracking.template import make_template
from labcdp.tracking.view_kernel import between, patch_around, reduced, smoothed

singles = st.floats(-1e6, 1e6, width=32)


@pytest.fixture(scope="module")
def pixels():
    frame = next(iter(SimulatedVideo(lambda t: Moment(pose(120, 80)), n_frames=1, size=(240, 160)).frames()))
    return Level(make_template(frame.grey, frame.rois[0]), planar=False, coarse=False).pixels


@given(st.lists(singles, min_size=1, max_size=40), st.data())
def test_the_kth_smallest_is_that_of_the_sorted_values(numbers, data):
    k = data.draw(st.integers(0, len(numbers) - 1))
    values = np.array(numbers, np.float32)

    assert kth_smallest(values, k) == np.sort(values)[k]
    assert median(values) == pytest.approx(np.median(values.astype(float)))


@given(st.integers(0, 10**6), st.integers(1, 10))
def test_equations_are_solved_as_by_lapack(seed, n):
    rng = np.random.default_rng(seed)
    factor, right = rng.normal(size=(n, n)), rng.normal(size=n)
    matrix = factor @ factor.T + np.eye(n)
    solution = right.copy()

    assert solve_positive(matrix.copy(), solution)
    assert solution == pytest.approx(np.linalg.solve(matrix, right))


def test_a_matrix_that_is_not_positive_definite_is_told():
    assert not solve_positive(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2))


def test_matrices_are_multiplied_and_inverted():
    rng = np.random.default_rng(1)
    a, b, result = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), np.empty((3, 3))

    multiply(a, b, result)
    assert result == pytest.approx(a @ b)
    invert(a, result)
    assert result == pytest.approx(np.linalg.inv(a))
    invert(np.ones((3, 3)), result)
    assert not np.isfinite(result).any()


@pytest.mark.parametrize(
    ("window", "shape"),
    [
        ((3, 5, 180, 133), (57, 93)),
        ((0, 0, 200, 150), (3, 4)),
        ((10, 20, 60, 90), (70, 50)),
        ((7, 7, 58, 71), (63, 50)),
    ],
)
def test_a_window_is_reduced_as_by_opencv(window, shape):
    grey = np.random.default_rng(2).integers(0, 256, (150, 200), dtype=np.uint8)
    left, top, right, bottom = window
    part = grey[top:bottom, left:right].astype(np.float32)

    assert reduced(grey, *window, shape) == pytest.approx(
        cv2.resize(part, shape[::-1], interpolation=cv2.INTER_AREA), abs=1e-3
    )


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (2, 2), (3, 2), (20, 31)])
def test_an_image_is_smoothed_as_by_opencv(shape):
    image = np.random.default_rng(3).normal(0, 1, shape).astype(np.float32)

    assert smoothed(image) == pytest.approx(
        cv2.sepFilter2D(image, -1, np.array([0.25, 0.5, 0.25]), np.array([0.25, 0.5, 0.25])), abs=1e-6
    )


@given(st.floats(-5, 15), st.floats(-5, 15))
def test_between_pixels_a_product_of_slopes_is_exact_and_beyond_them_the_last_ones_go_on(x, y):
    v, u = np.mgrid[:7, :9] + 0.5
    image = (1 + 2 * u + 3 * v + 0.5 * u * v).astype(np.float32)
    u, v = np.clip(x, 0.5, 8.5), np.clip(y, 0.5, 6.5)

    assert between(image, x, y) == pytest.approx(1 + 2 * u + 3 * v + 0.5 * u * v, rel=1e-5)


def test_a_place_that_is_no_number_is_the_first_pixel():
    assert between(np.arange(9, dtype=np.float32).reshape(3, 3) + 1, np.nan, np.nan) == 1


def test_a_patch_has_its_point_in_the_middle():
    image = np.tile(np.arange(40, dtype=np.float32), (30, 1))

    patch = patch_around(image, 20.5, 15.0, 0.5, 8)

    # Middles of its pixels are two pixels of the image apart, and its own middle is between two of them.
    assert (patch == np.array([13, 15, 17, 19, 21, 23, 25, 27])[None, :, None]).all()


def test_a_view_is_looked_up_in_all_pixels_and_those_outside_do_not_count(pixels):
    view = np.random.default_rng(4).uniform(0, 255, (90, 80)).astype(np.float32)
    n, columns = pixels.trust.size, pixels.columns
    pixels = pixels._replace(trust=np.full(n, 0.5, np.float32))
    tilted = shift(20, 30) @ np.array([[1.1, 0.1, 0], [-0.1, 0.9, 0], [1e-3, 2e-3, 1]])
    seen = nothing_seen(n)

    sample(view, (25.0, 0.0, 80.0, 90.0), tilted, pixels, seen)

    y, x = np.divmod(np.arange(n), columns) + np.full(2, 0.5)[:, None]
    moved = tilted @ np.stack([x, y, np.ones(n)])
    x, y = (moved[:2] / moved[2]).astype(np.float32)
    truth = cv2.remap(view, x[None] - 0.5, y[None] - 0.5, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
    # OpenCV interpolates in steps of 1/32 of a pixel, along both axes.
    assert np.abs(seen.values - truth).max() < 2 * 255 / 32
    assert np.array_equal(seen.trusted, np.where((x > 25) & (x < 80) & (y > 0) & (y < 90), np.float32(0.5), 0))


def test_gain_and_offset_are_those_of_weighted_least_squares(pixels):
    rng = np.random.default_rng(5)
    template, n = pixels.jacobian[-2], pixels.trust.size
    seen = nothing_seen(n)
    seen.values[:] = 0.6 * template + 12 + rng.normal(0, 3, n)
    seen.trusted[:], seen.robust[:] = rng.uniform(0, 1, n), rng.uniform(0, 1, n)
    root = np.sqrt(seen.trusted * seen.robust).astype(float)
    design = np.stack([template, np.ones(n)], axis=1) * root[:, None]
    gain, offset = np.linalg.lstsq(design, seen.values * root)[0]

    light = next_light(pixels, seen, np.nan)

    assert light[:2] == pytest.approx((gain, offset), rel=1e-4)
    assert seen.residuals == pytest.approx((seen.values - offset) / gain - template, abs=1e-3)


def test_a_guess_of_the_light_is_kept_although_much_is_covered(pixels):
    template, n = pixels.jacobian[-2], pixels.trust.size
    seen = nothing_seen(n)
    seen.values[:], seen.trusted[:] = 0.6 * template + 12, 1
    seen.values[: n * 2 // 5] = 255

    best = first_light(pixels, seen, np.array([(0.6, 12.0), (np.nan, np.nan)]))

    assert best[:2] == pytest.approx((0.6, 12.0), rel=0.01)
    # What is written is that of the light that is kept.
    assert seen.residuals[n // 2 :] == pytest.approx(np.zeros(n - n // 2), abs=1.0)


def test_edges_are_summed_part_by_part():
    rng = np.random.default_rng(6)
    values = rng.uniform(0, 255, (12, 9)).astype(np.float32)
    near, parts = np.arange(values.size), rng.integers(0, 4, values.size)
    slopes = rng.normal(0, 1, (2, values.size)).astype(np.float32)
    agrees = np.ones(values.size, np.float32)
    agrees[parts == 3] = np.nan
    sums = np.zeros(4)

    sum_edges(values.ravel(), agrees, 9, near, parts, slopes, sums)

    dy, dx = np.gradient(values)
    products = dx.ravel() * slopes[0] + dy.ravel() * slopes[1]
    assert sums[:3] == pytest.approx(np.bincount(parts, weights=products)[:3], rel=1e-4)
    assert np.isnan(sums[3])


@given(st.lists(st.floats(0, 1.5, width=32), min_size=1, max_size=24), st.integers(0, 10**6))
def test_the_share_of_an_outline_that_is_gone(heights, seed):
    kept = np.array(heights, np.float32)
    length = np.random.default_rng(seed).uniform(1, 9, kept.size)
    light = min(max(np.quantile(kept.astype(float), 0.85), 0.25), 1.0)
    edge = np.abs(kept - 0.35 * light).min()

    # Not where rounding decides.
    if edge > 1e-6:
        assert share_gone(kept, length, 0.35, 0.85, 0.25) == pytest.approx(
            length[kept < 0.35 * light].sum() / length.sum()
        )
