import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.errors import InputError
from labcdp.luminance import LuminanceMap
from labcdp.regions import PolygonShape, rois_of
from labcdp.roi import Roi
from labcdp.roi_page.drawing import Drawing
from labcdp.roi_page.page_image import PageImage
from labcdp.roi_page.proposals import default_size_px, outlines, propose


def bayer(light: np.ndarray) -> PageImage:
    """Frame of a colour sensor whose map has a pixel for four."""
    none = np.zeros(light.shape, dtype=np.uint8)
    dn = light.repeat(2, axis=0).repeat(2, axis=1).astype(np.uint16)
    return PageImage("a", dn, True, "RG", LuminanceMap(light, np.zeros_like(light), 0.0, none, step=2), "relative")


@given(seed=st.integers(0, 10_000), colours=st.integers(1, 3))
def test_outlines_hold_exactly_the_pixels_of_their_label(seed: int, colours: int) -> None:
    from scipy.ndimage import label

    # Connected areas of random pixels: with corners that touch, holes, and areas of a single pixel.
    pixels = np.random.default_rng(seed).integers(0, colours, (9, 12))
    labels, n = np.zeros(pixels.shape, dtype=np.int32), 0
    for colour in range(colours):
        found, count = label(pixels == colour)
        labels[found > 0] = (found + n - 1)[found > 0]
        n += count
    polygons = outlines(labels)
    assert len(polygons) == n
    rois_of([PolygonShape(f"p{number}", corners) for number, corners in enumerate(polygons)])
    for number, corners in enumerate(polygons):
        roi = Roi("p", corners)
        seen = np.zeros(labels.shape, dtype=bool)
        seen[roi.window(labels.shape)] = roi.mask(labels.shape)
        # What is surrounded completely is in it too: what cannot be reached from outside along rows and columns.
        outside, _ = label(np.pad(labels != number, 1, constant_values=True))
        filled = (outside != outside[0, 0])[1:-1, 1:-1]
        assert (seen >= (labels == number)).all()
        assert (seen <= filled | (labels == number)).all()


def test_superpixels_of_a_colour_sensor_are_in_pixels_of_the_image_and_cover_it() -> None:
    light = np.random.default_rng(2).normal(100, 1, (60, 80)).astype(np.float32)
    light[:, 40:] *= 3
    image = bayer(light)
    found = propose(image, "superpixels", 20)
    drawing = Drawing(image.size).proposed(found).accepted()
    covered = np.zeros((120, 160), dtype=int)
    for roi in drawing.rois:
        covered[roi.window(covered.shape)] += roi.mask(covered.shape)
    assert (covered == 1).all()
    # No proposal reaches over the edge, at 80, by more than three pixels of the map.
    for roi in drawing.rois:
        x0, _, x1, _ = roi.bounds
        assert not x0 < 74 < 86 < x1


def test_too_many_proposals_are_refused_with_the_size_that_works() -> None:
    image = bayer(np.random.default_rng(2).normal(100, 1, (300, 400)).astype(np.float32))
    assert default_size_px(image) == 33
    with pytest.raises(InputError, match=r"superpixels of 9 pixels would be about 5926 proposals.*at least 16"):
        propose(image, "superpixels", 9)


def test_a_checkerboard_of_a_colour_sensor_is_found_where_it_is() -> None:
    rng = np.random.default_rng(1)
    squares = np.where(np.indices((4, 5)).sum(axis=0) % 2 == 0, 200.0, 40.0).repeat(40, axis=0).repeat(40, axis=1)
    light = rng.normal(np.pad(squares, 30, constant_values=120), 4).astype(np.float32)
    rois = rois_of(propose(bayer(light), "checkerboard"))
    assert len(rois) == 20
    assert rois[0].centre == pytest.approx((100, 100), abs=2)
