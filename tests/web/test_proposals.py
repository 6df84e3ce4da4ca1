import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.core.luminance import LuminanceMap
from labcdp.regions import rois_of
from labcdp.web.regions import proposals
from labcdp.web.regions.page_image import PageImage
from labcdp.web.regions.proposals import propose


def bayer(light: np.ndarray) -> PageImage:
    """Frame of a colour sensor whose map has a pixel for four."""
    none = np.zeros(light.shape, dtype=np.uint8)
    dn = light.repeat(2, axis=0).repeat(2, axis=1).astype(np.uint16)
    return PageImage("a", dn, True, "RG", LuminanceMap(light, np.zeros_like(light), 0.0, none, step=2), "relative")


def test_superpixels_of_a_colour_sensor_are_joined_and_in_pixels_of_the_image() -> None:
    light = np.random.default_rng(2).normal(100, 1, (60, 80)).astype(np.float32)
    light[:, 40:] *= 3
    found = propose(bayer(light), "superpixels", 20)
    # The edge is at 80; each half is one region, less a margin.
    assert len(found) == 2
    left, right = sorted(roi.bounds for roi in rois_of(found))
    assert left == pytest.approx((0, 0, 80, 120), abs=9)
    assert right == pytest.approx((80, 0, 160, 120), abs=9)
    assert left[2] < 80 < right[0]


def test_more_proposals_than_a_person_confirms_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    squares = np.random.default_rng(2).uniform(50, 500, (6, 8)).repeat(20, axis=0).repeat(20, axis=1)
    image = bayer(squares.astype(np.float32))
    n = len(propose(image, "superpixels", 20))
    assert 40 < n < 60
    monkeypatch.setattr(proposals, "MOST_PROPOSALS", 40)
    with pytest.raises(InputError, match=rf"{n} regions were found, .* limit of 40: give a larger size"):
        propose(image, "superpixels", 20)
