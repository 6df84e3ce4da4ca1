"""The one accumulator, against brute force over all frames and known sources of noise."""

import numpy as np
import pytest

from labcdp.calibration.emva.quantities import dark_pattern_variances, flat_variance
from labcdp.calibration.frames.measure import FrameSums
from labcdp.calibration.frames.nonuniformity import spatial_variance
from labcdp.calibration.frames.observations import CameraState
from labcdp.calibration.frames.statistics import LineVariances
from labcdp.core.frame import CameraIdentity


def statistics(stack, used=None):
    frames = [np.rint(frame).astype(np.uint16) for frame in stack]
    state = CameraState(CameraIdentity("", "", ""), "Mono12", 12, frames[0].shape, 0.0, 199, 0.0)
    sums = FrameSums(state, 0.01, used)
    for frame in frames:
        sums.add(frame)
    return sums.result()


@pytest.mark.parametrize("n_frames", [2, 7])
@pytest.mark.parametrize("masked", [False, True])
def test_all_values_by_brute_force(n_frames, masked):
    rng = np.random.default_rng(4)
    stack = rng.integers(0, 200, (n_frames, 20, 30)).astype(np.uint16)
    used = rng.random((20, 30)) < (0.7 if masked else 1.1)
    found, values = statistics(stack, used if masked else None), stack[:, used].astype(float)
    own = values - values.mean(axis=1, keepdims=True)
    size = used.sum()
    # EMVA 1288, with n - 1 for the mean that was taken off.
    assert found.temporal_variance_dn2 == pytest.approx(own.var(axis=0, ddof=1).mean() * size / (size - 1), rel=1e-12)
    assert np.allclose(found.image_dn[used], values.mean(axis=0))
    assert np.allclose(found.variance_image_dn2, stack.var(axis=0, ddof=1), rtol=1e-5)
    assert np.array_equal(found.clipped, ((stack == 0) | (stack >= 199)).any(axis=0))
    assert found.frame_means_variance_dn2 == pytest.approx(values.mean(axis=1).var(ddof=1))
    assert (found.mean_dn, found.n_pixels, found.n_frames) == (pytest.approx(values.mean()), size, n_frames)
    assert (found.saturated_share, found.black_share) == (np.mean(values == 199), np.mean(values == 0))
    rows = np.array([[frame[i, used[i]].mean() for i in range(20)] for frame in stack])
    rows -= values.mean(axis=1)[:, None]
    assert found.temporal.row == pytest.approx(rows.var(axis=0, ddof=1).mean(), rel=1e-9)


def test_parts_of_noise_and_pattern_are_distinguished_and_add_up():
    """Rows, columns and pixels, as noise and as a pattern: each part within 4 standard deviations of a variance."""
    rng = np.random.default_rng(5)
    shape, n_frames = (200, 300), 24
    noise, pattern = LineVariances(9.0, 2.25, 4.0), LineVariances(16.0, 4.0, 1.0)

    def draw(parts):
        image = np.sqrt(parts.pixel) * rng.standard_normal(shape) + np.sqrt(parts.column) * rng.standard_normal(300)
        return image + np.sqrt(parts.row) * rng.standard_normal((200, 1))

    fixed = 100 + draw(pattern)
    s = statistics(fixed + draw(noise) for _ in range(n_frames))
    spatial = spatial_variance(s.image_dn, s.temporal.scaled(1 / n_frames))
    counts = {"pixel": 60_000, "column": 300, "row": 200}
    for name, n in counts.items():
        drawn, left = getattr(noise, name), 13 / 200
        chance = 4 * (drawn + left) * np.sqrt(2 / (n * (n_frames - 1)))
        assert getattr(s.temporal_parts, name) == pytest.approx(drawn + (name == "pixel") / 12, abs=chance)
        drawn = getattr(pattern, name)
        assert getattr(spatial, name).value == pytest.approx(drawn, abs=4 * (drawn + 0.2) * np.sqrt(2 / n))
    parts = spatial.row.value + spatial.column.value + spatial.pixel.value
    assert spatial.total.value == pytest.approx(parts, rel=2e-3)


def test_slow_gradients_of_a_patch_are_taken_off():
    rng = np.random.default_rng(7)
    rows, columns = np.indices((60, 70)).reshape(2, -1)
    slow = 1000 + 3.0 * rows - 0.02 * columns**2 + 0.01 * rows * columns
    values = slow + 4.0 * rng.standard_normal(rows.size)
    found = flat_variance(values, rows, columns, noise_dn2=6.0)
    assert found.u == pytest.approx(16 * np.sqrt(2 / rows.size), rel=0.1)
    assert found.value == pytest.approx(16 - 6, abs=4 * found.u)


def test_dark_pattern_extrapolates_each_pixel_to_zero_exposure():
    rng = np.random.default_rng(8)
    offset, rate = rng.normal(90, 4, (120, 130)), rng.normal(30, 20, (120, 130))
    exposures = [0.01, 0.2, 0.8]
    frames = [statistics(offset + rate * t + rng.normal(0, 1, (30, 120, 130))) for t in exposures]
    at_zero, growth = dark_pattern_variances(frames, exposures)
    assert at_zero.total.value == pytest.approx(16, abs=4 * at_zero.total.u)
    assert growth.total.value == pytest.approx(400, abs=4 * growth.total.u)
