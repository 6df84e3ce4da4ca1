"""Superpixels, their neighbours, and the regions that are proposed from them."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, label

from labcdp.regions import require_simple
from labcdp.regions.proposals import propose_regions
from labcdp.regions.superpixels import neighbours, superpixel_labels


def astray(labels, inside):
    """Pixels on the wrong side of an outline: those a superpixel has on its smaller side."""
    whole = np.bincount(labels.ravel())
    of_object = np.bincount(labels[inside], minlength=labels.max() + 1)
    return np.minimum(of_object, whole - of_object).sum()


@settings(max_examples=15)
@given(
    shape=st.tuples(st.integers(12, 60), st.integers(12, 60)), size=st.integers(6, 12), scale=st.floats(-6, 6),
    half=st.booleans(), seed=st.integers(0, 1000),
)  # fmt: skip
def test_labels_are_counted_from_0_connected_and_the_same_with_any_number_of_threads(shape, size, scale, half, seed):
    image = 10**scale * np.random.default_rng(seed).lognormal(0, 1.5, shape)
    threads = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        labels = superpixel_labels(image, size, half=half)
    finally:
        cv2.setNumThreads(threads)
    assert np.array_equal(labels, superpixel_labels(image, size, half=half))
    assert (labels.shape, labels.dtype) == (shape, np.int32)
    assert np.array_equal(np.unique(labels), np.arange(labels.max() + 1))
    assert all(label(labels == one)[1] == 1 for one in range(labels.max() + 1))


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize(
    ("level", "contrast", "ratio", "crossed"),
    [(10, 0.1, 5, 0.2), (10, 0.3, 2, 0.5), (10, 10.0, 3, 0.5), (1e4, 0.2, 7, 0.1)],
)
def test_borders_follow_a_step_in_noise_within_a_pixel_at_any_level(level, contrast, ratio, crossed, half):
    left = np.arange(320) < np.full((240, 1), 133)
    image = level * np.where(left, 1, 1 + contrast)
    image += level * contrast / ratio / np.sqrt(2) * np.random.default_rng(3).normal(size=image.shape)
    labels = superpixel_labels(image, 40, half=half)
    assert astray(labels, left) / 240 < crossed
    # Away from the step they are about as large as asked for.
    assert 0.6 * 1600 < np.median(np.bincount(labels.ravel())) < 1.4 * 1600


@given(seed=st.integers(0, 1000), n=st.integers(1, 6))
def test_neighbours_are_those_of_a_walk_over_all_pixels(seed, n):
    labels = np.random.default_rng(seed).integers(0, n, (7, 9)).astype(np.int32)
    places = {}
    for y, x in np.ndindex(labels.shape):
        for v, u in ((y, x + 1), (y + 1, x)):
            if v < 7 and u < 9 and labels[y, x] != labels[v, u]:
                pair = tuple(sorted((int(labels[y, x]), int(labels[v, u]))))
                places.setdefault(pair, []).append(((x + u + 1) / 2, (y + v + 1) / 2))
    found = neighbours(labels)
    pairs = [tuple(pair) for pair in found.pairs.tolist()]
    assert dict(zip(pairs, found.border_px, strict=True)) == {pair: len(own) for pair, own in places.items()}
    for pair, middle in zip(pairs, found.middle_px, strict=True):
        own = np.array(places[pair])
        distances = np.linalg.norm(own - own.mean(axis=0), axis=1)
        assert tuple(middle) in places[pair]
        assert np.linalg.norm(middle - own.mean(axis=0)) == pytest.approx(distances.min(), abs=1e-6)


def proposed(image, size):
    """Proposals as regions: simple polygons inside the image, none over another, named in order."""
    found = propose_regions(image, size)
    covered = np.zeros(image.shape, dtype=int)
    rois = [roi for shape in found for roi in shape.rois()]
    for roi in rois:
        require_simple(roi)
        window = covered[roi.window(image.shape)]
        window += roi.mask(image.shape)
    assert covered.max() <= 1
    assert [shape.name for shape in found] == [f"region {n}" for n in range(1, len(found) + 1)]
    return rois


def test_patches_are_proposed_whole_and_inside_their_outlines():
    """Dark ground with three patches, one of which is a ring around another."""
    truth = np.zeros((240, 320), dtype=int)
    for patch, window in enumerate((np.s_[40:140, 30:120], np.s_[60:200, 170:300], np.s_[100:160, 210:260]), start=1):
        truth[window] = patch
    image = gaussian_filter(np.array([20.0, 60.0, 120.0, 30.0])[truth], 0.7)
    rois = proposed(image + 2 * np.random.default_rng(0).normal(size=image.shape), 24)
    held = np.array([np.bincount(roi.select(truth), minlength=4) for roi in rois])
    # An outline strays a pixel here and there.
    assert (held.max(axis=1) / held.sum(axis=1)).min() > 0.98
    # All but a margin: 3 pixels around the smallest are a fifth of it.
    assert (held.sum(axis=0) / np.bincount(truth.ravel()))[1:].min() > 0.7
    # Joined, not a superpixel each: 4 areas, of which the ground and the ring are cut at their holes.
    assert len(rois) < 15


@settings(max_examples=15)
@given(seed=st.integers(0, 1000), size=st.integers(8, 20), noise=st.floats(0, 30))
def test_every_proposal_is_a_simple_polygon_inside_the_image(seed, size, noise):
    rng = np.random.default_rng(seed)
    proposed(gaussian_filter(rng.normal(size=(70, 90)), 6) * 600 + 100 + noise * rng.normal(size=(70, 90)), size)
