import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, label

from labcdp.regions.superpixels.segment import inner, neighbours, superpixel_labels


def _neighbours_one_by_one(labels):
    lengths, places = {}, {}
    height, width = labels.shape
    for y in range(height):
        for x in range(width):
            for dy, dx in ((0, 1), (1, 0)):
                if y + dy < height and x + dx < width and labels[y, x] != labels[y + dy, x + dx]:
                    pair = tuple(sorted((int(labels[y, x]), int(labels[y + dy, x + dx]))))
                    lengths[pair] = lengths.get(pair, 0) + 1
                    places.setdefault(pair, []).append((x + (1 if dx else 0.5), y + (1 if dy else 0.5)))
    return lengths, places


def _crossed(labels, x):
    """Pixels on the wrong side of a border at column x, per row: those a superpixel has on its smaller side."""
    left = np.bincount(labels[:, :x].ravel(), minlength=labels.max() + 1)
    whole = np.bincount(labels.ravel())
    return np.minimum(left, whole - left).sum() / labels.shape[0]


@settings(max_examples=15)
@given(
    height=st.integers(12, 60),
    width=st.integers(12, 60),
    size=st.integers(6, 12),
    scale=st.floats(-6, 6),
    half=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_labels_are_counted_from_0_and_connected(height, width, size, scale, half, seed):
    image = 10**scale * np.random.default_rng(seed).lognormal(0, 1.5, (height, width))
    labels = superpixel_labels(image, size, half=half)
    assert labels.shape == (height, width)
    assert labels.dtype == np.int32
    assert np.array_equal(np.unique(labels), np.arange(labels.max() + 1))
    assert all(label(labels == one)[1] == 1 for one in range(labels.max() + 1))
    assert np.array_equal(labels, superpixel_labels(image, size, half=half))


def test_labels_do_not_depend_on_the_number_of_threads():
    import cv2

    image = np.random.default_rng(0).normal(100, 10, (300, 400))
    threads = cv2.getNumThreads()
    found = []
    try:
        for n in (1, 3):
            cv2.setNumThreads(n)
            found.append(superpixel_labels(image, 20))
    finally:
        cv2.setNumThreads(threads)
    assert np.array_equal(*found)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize(("contrast", "ratio", "crossed"), [(0.1, 5, 0.2), (0.3, 2, 0.5), (10.0, 3, 0.5)])
def test_borders_follow_a_step_in_noise_within_a_pixel(contrast, ratio, crossed, half):
    image = np.full((240, 320), 10.0)
    image[:, 133:] *= 1 + contrast
    noise = 10 * contrast / ratio / np.sqrt(2)
    image += noise * np.random.default_rng(3).normal(size=image.shape)
    labels = superpixel_labels(image, 40, half=half)
    assert _crossed(labels, 133) < crossed
    # Away from the step they are about as large as asked for.
    assert 0.6 * 1600 < np.median(np.bincount(labels.ravel())) < 1.4 * 1600


@pytest.mark.parametrize("level", [1e-3, 1.0, 1e4])
def test_steps_of_one_contrast_are_found_at_any_level(level):
    image = np.full((200, 200), level)
    image[:, 71:] *= 1.2
    image *= np.random.default_rng(0).normal(1, 0.02, image.shape)
    assert _crossed(superpixel_labels(image, 30), 71) < 0.1


@given(seed=st.integers(0, 1000), n=st.integers(1, 6))
def test_neighbours_are_those_of_a_walk_over_all_pixels(seed, n):
    labels = np.random.default_rng(seed).integers(0, n, (7, 9)).astype(np.int32)
    found = neighbours(labels)
    lengths, places = _neighbours_one_by_one(labels)
    assert {tuple(pair): length for pair, length in zip(found.pairs.tolist(), found.border_px, strict=True)} == lengths
    for pair, middle in zip(found.pairs.tolist(), found.middle_px, strict=True):
        own = np.array(places[tuple(pair)])
        distances = np.linalg.norm(own - own.mean(axis=0), axis=1)
        assert tuple(middle) in places[tuple(pair)]
        assert np.linalg.norm(middle - own.mean(axis=0)) == pytest.approx(distances.min(), abs=1e-6)


@pytest.mark.parametrize(("contrast", "crossed"), [(10, 1.5), (100, 2.5)])
def test_a_strong_edge_that_the_lens_has_blurred_makes_no_strips(contrast, crossed):
    image = np.full((300, 400), 1.0)
    image[80:220, 120:280] = 1 + contrast
    image = gaussian_filter(image, 1.2) + 0.02 * np.random.default_rng(0).normal(size=image.shape)
    labels = superpixel_labels(image, 36)
    deep = np.bincount(labels[inner(labels, 3)], minlength=labels.max() + 1) / np.bincount(labels.ravel())
    assert deep.min() > 0.2
    inside = np.zeros(image.shape, dtype=bool)
    inside[80:220, 120:280] = True
    of_object = np.bincount(labels[inside], minlength=labels.max() + 1)
    wrong = np.minimum(of_object, np.bincount(labels.ravel()) - of_object).sum()
    # The outline is 600 pixels long; half the logarithm is reached outside of it.
    assert wrong / 600 < crossed
