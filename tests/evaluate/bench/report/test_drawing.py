"""Images made small, and pictures of them."""

import cv2
import numpy as np
import pytest

from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.report.drawing import block_mean
from labcdp.report.maps import luminance_picture

VERMILLION, BLACK, GREY, PINK = (213, 94, 0), (0, 0, 0), (154, 154, 154), (204, 121, 167)


@pytest.mark.parametrize(("shape", "side"), [((7, 9), 3), ((6, 9), 3), ((5, 1), 4), ((1, 1), 1), ((8, 8), 1)])
def test_block_mean_against_a_loop(shape, side):
    image, starts = np.random.default_rng(0).normal(size=shape), [range(0, n, side) for n in shape]
    expected = [[image[y : y + side, x : x + side].mean() for x in starts[1]] for y in starts[0]]
    np.testing.assert_allclose(block_mean(image, side), expected, rtol=0, atol=1e-15)


def share(invalid, luminance_cd_m2, colour):
    """Share of a picture, calibrated from 1 to 100 cd/m², that has exactly a colour; and its number of pixels."""
    values = np.full(invalid.shape, luminance_cd_m2)
    image = LuminanceMap(values, np.full(invalid.shape, 0.01), 0.01, invalid)
    png = luminance_picture(image, "luminance", False, (1.0, 100.0))
    found = np.all(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1] == colour, axis=-1)
    return found.mean(), found.sum()


def test_one_saturated_pixel_of_nine_shows():
    invalid = np.zeros((2040, 2040), dtype=np.uint8)  # drawn pixels stand for 3 x 3
    invalid[0, 0] = Invalid.SATURATED
    _, dot = share(invalid, 5.0, VERMILLION)
    invalid[500:1700, 1001] = Invalid.SATURATED
    _, line = share(invalid, 5.0, VERMILLION)
    assert line >= dot + 400  # of the line, each third pixel at least; the legend is in both


@pytest.mark.parametrize(
    ("flag", "luminance_cd_m2", "colour"),
    [
        (Invalid.SATURATED, 1.0, VERMILLION),
        (Invalid.BELOW_BLACK | Invalid.OUTSIDE_CALIBRATED, -0.1, BLACK),
        (Invalid.OUTSIDE_CALIBRATED, 0.5, GREY),
        (Invalid.OUTSIDE_CALIBRATED, 1e4, PINK),
    ],
)
def test_each_reason_has_its_colour(flag, luminance_cd_m2, colour):
    assert share(np.full((50, 60), flag, dtype=np.uint8), luminance_cd_m2, colour)[0] > 0.3
