import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from labcdp.regions import require_simple
from labcdp.regions.superpixels.proposals import propose_regions


def _patches():
    """Dark ground with three patches, one of which is a ring around another."""
    truth = np.zeros((240, 320), dtype=int)
    truth[40:140, 30:120] = 1
    truth[60:200, 170:300] = 2
    truth[100:160, 210:260] = 3
    return truth


def test_patches_are_proposed_whole_and_inside_their_outlines():
    truth = _patches()
    image = np.array([20.0, 60.0, 120.0, 30.0])[truth]
    image = gaussian_filter(image, 0.7) + 2 * np.random.default_rng(0).normal(size=image.shape)
    found = propose_regions(image, 24)
    covered = np.zeros(truth.shape, dtype=int)
    of_patch = {1: 0.0, 2: 0.0, 3: 0.0}
    for shape in found:
        (roi,) = shape.rois()
        require_simple(roi)
        patches, counts = np.unique(roi.select(truth), return_counts=True)
        # An outline strays a pixel here and there.
        assert counts.max() / counts.sum() > 0.98
        patch = int(patches[np.argmax(counts)])
        if patch:
            of_patch[patch] += counts.max() / np.count_nonzero(truth == patch)
        window = covered[roi.window(truth.shape)]
        window += roi.mask(truth.shape)
    assert covered.max() == 1
    # All but a margin: 3 pixels around the smallest are a fifth of it.
    assert min(of_patch.values()) > 0.7
    # Joined, not a superpixel each: 4 areas, of which the ground and the ring are cut at their holes.
    assert len(found) < 15
    assert [shape.name for shape in found] == [f"region {n}" for n in range(1, len(found) + 1)]


@settings(max_examples=20)
@given(seed=st.integers(0, 1000), size=st.integers(8, 20), noise=st.floats(0, 30))
def test_every_proposal_is_a_simple_polygon_inside_the_image(seed, size, noise):
    rng = np.random.default_rng(seed)
    image = gaussian_filter(rng.normal(size=(70, 90)), 6) * 600 + 100 + noise * rng.normal(size=(70, 90))
    covered = np.zeros(image.shape, dtype=int)
    for shape in propose_regions(image, size):
        (roi,) = shape.rois()
        require_simple(roi)
        window = covered[roi.window(image.shape)]
        window += roi.mask(image.shape)
    assert covered.max() <= 1


def test_light_that_changes_slowly_is_not_joined_from_end_to_end():
    image = np.linspace(100, 200, 300) * np.ones((80, 1))
    found = propose_regions(image, 20)
    assert len(found) > 5
    for shape in found:
        seen = shape.rois()[0].select(image)
        assert np.ptp(seen) < 40
