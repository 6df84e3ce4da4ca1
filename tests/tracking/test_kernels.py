"""The compiled loops of the tracker against NumPy and OpenCV."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.tracking.fit_kernel import trust_learnt
from labcdp.tracking.geometry import scaling, shift, transform
from labcdp.tracking.level import Level
from labcdp.tracking.level_kernel import first_light, next_light, nothing_seen, sample
from labcdp.tracking.matrix_kernel import invert, multiply, solve_positive
from labcdp.tracking.outline_kernel import Edges, gone, heights_of, remembered, share_gone
from labcdp.tracking.place_kernel import box_of, shape_change
from labcdp.tracking.scene_kernel import deviations
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


def test_edges_have_heights_part_by_part():
    rng = np.random.default_rng(6)
    values = rng.uniform(0, 255, (12, 9)).astype(np.float32)
    near, parts = np.arange(values.size), rng.integers(0, 4, values.size)
    slopes = rng.normal(0, 1, (2, values.size)).astype(np.float32)
    agrees = np.ones(values.size, np.float32)
    agrees[parts == 3] = np.nan

    heights = heights_of(values.ravel(), agrees, 0.8, Edges(9, near, parts, slopes, np.array([2.0, 3.0, 4.0, 5.0])))

    dy, dx = np.gradient(values)
    products = dx.ravel() * slopes[0] + dy.ravel() * slopes[1]
    sums = np.abs(np.bincount(parts, weights=products)[:3])
    assert heights[:3] == pytest.approx(sums / (0.8 * np.array([2.0, 3.0, 4.0])), rel=1e-4)
    assert np.isnan(heights[3])


def test_what_is_known_of_an_outline_decides_how_much_of_it_is_gone():
    heights = np.array([1.0, 0.1, np.nan, 1.0, 0.0, 0.0])
    usual = np.array([1.0, 1.0, 1.0, 1.0, 0.2, 1.0])
    length = np.array([2.0, 1.0, 9.0, 2.0, 9.0, 0.0])

    # Not the part outside the image, nor that which has become faint, nor that without an edge.
    assert gone(heights, usual, length, 4.0) == pytest.approx(1 / 5)
    assert gone(heights, usual, length, 5.0) == 0


def test_heights_are_remembered_where_they_are_known():
    changed = remembered(np.array([1.0, 1.0, 1.0]), np.array([0.6, np.nan, 9.0]))

    assert changed == pytest.approx([0.9, 1.0, 1.125])


def test_trust_is_a_running_mean_above_its_least():
    trust, agrees = np.array([0.8, 0.8, 0.8], np.float32), np.array([0.4, np.nan, 0.0], np.float32)

    learnt = trust_learnt(trust, np.array([0.1, 0.1, 0.7], np.float32), agrees, 4)

    assert learnt == pytest.approx([0.7, 0.8, 0.7])


def test_the_box_of_a_tilted_template_holds_its_corners():
    matrix = np.array([[1.1, 0.2, 30], [-0.3, 0.9, 20], [1e-3, -2e-3, 1]])
    corners = transform(matrix, np.array([(0.0, 0.0), (48.0, 0.0), (48.0, 40.0), (0.0, 40.0)]))

    assert box_of(matrix, 48, 40) == pytest.approx((*corners.min(axis=0), *corners.max(axis=0)))
    assert np.isnan(box_of(np.zeros((3, 3)), 48, 40)).all()


@given(st.floats(-3, 3), st.floats(0.5, 2), st.floats(0.5, 2), st.floats(-50, 50))
def test_a_change_of_shape_is_told_from_where_it_went(angle, across, down, x):
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    before = shift(7, 9) @ scaling(2)
    to_centred = scaling(2 / 48) @ shift(-24, -20)
    back = np.linalg.inv(to_centred)

    longest, shortest, turned, tilted = shape_change(
        before, before @ back @ shift(x, -x) @ turn @ scaling(across, down) @ to_centred, to_centred
    )

    assert (longest, shortest) == pytest.approx((max(across, down), min(across, down)), rel=1e-6)
    assert turned == pytest.approx(angle, abs=1e-6)
    assert tilted == pytest.approx(0, abs=1e-9)


def test_perspective_is_told_over_half_the_size():
    to_centred = scaling(2 / 48) @ shift(-24, -20)
    tilt = np.array([[1.0, 0, 0], [0, 1, 0], [0.03, -0.05, 1]])

    *_, tilted = shape_change(np.eye(3), np.linalg.inv(to_centred) @ tilt @ to_centred, to_centred)

    assert tilted == pytest.approx(0.05)


@pytest.mark.parametrize("shape", [(3, 4), (32, 48), (97, 210), (480, 640)])
def test_a_frame_is_made_small_by_means_of_its_cells(shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    grey = (y // 5 + x // 5).astype(np.uint8)
    rows, columns = min(32, shape[0]), min(48, shape[1])
    edges = [np.arange(n + 1) * size // n for n, size in ((rows, shape[0]), (columns, shape[1]))]

    small = deviations(grey, rows, columns, (100, 1000))

    cells = np.add.reduceat(np.add.reduceat(grey.astype(float), edges[0][:-1]), edges[1][:-1], axis=1)
    means = cells / np.outer(np.diff(edges[0]), np.diff(edges[1]))
    assert small == pytest.approx(means - means.mean(), abs=1e-4)
    # Some of the rows and columns tell nearly the same.
    assert deviations(grey, rows, columns, (3, 10)) == pytest.approx(small, abs=1.0)


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
