"""Images made small, pictures of luminance maps, and histograms."""

import cv2
import numpy as np
import pytest

from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.metrics import Distribution
from labcdp.report.drawing import block_mean
from labcdp.report.maps import luminance_picture
from labcdp.report.plots import _bars, stage_figure

VERMILLION, BLUE = (213, 94, 0), (0, 114, 178)
VALUES = [np.random.default_rng(1).normal(5, 1, 3000), [1.0, 1.0, 1.01, 1.01, 500.0, 500.0], [0.1 + 0.2, 0.3], [0.0]]


@pytest.mark.parametrize(("shape", "side"), [((7, 9), 3), ((5, 1), 4), ((1, 1), 1), ((8, 8), 1)])
def test_block_mean_against_a_loop(shape, side):
    image, starts = np.random.default_rng(0).normal(size=shape), [range(0, n, side) for n in shape]
    expected = [[image[y : y + side, x : x + side].mean() for x in starts[1]] for y in starts[0]]
    np.testing.assert_allclose(block_mean(image, side), expected, rtol=0, atol=1e-15)


def coloured(png, colour):
    """Pixels of a picture that have exactly a colour."""
    return np.all(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1] == colour, axis=-1)


def drawn(invalid, luminance_cd_m2):
    """Picture of a map calibrated from 1 to 100 cd/m²."""
    image = LuminanceMap(np.full(invalid.shape, luminance_cd_m2), np.full(invalid.shape, 0.01), 0.01, invalid)
    return luminance_picture(image, "luminance", False, (1.0, 100.0))


def test_one_saturated_pixel_of_nine_shows():
    invalid = np.zeros((2040, 2040), dtype=np.uint8)  # drawn pixels stand for 3 x 3
    invalid[0, 0] = Invalid.SATURATED
    dot = coloured(drawn(invalid, 5.0), VERMILLION).sum()
    invalid[500:1700, 1001] = Invalid.SATURATED
    # Of the line, each third pixel at least; the legend is in both.
    assert coloured(drawn(invalid, 5.0), VERMILLION).sum() >= dot + 400


@pytest.mark.parametrize("values", VALUES)
def test_bars_hold_all_of_a_distribution_and_are_drawn(values):
    distribution = Distribution.from_array(values)
    edges, density = _bars(distribution)
    assert (np.diff(edges) >= 0).all()
    assert density @ np.diff(edges) == pytest.approx(1.0, rel=1e-9)
    assert (density > 0).sum() <= 256
    assert coloured(stage_figure("Stage $x_{", distribution, "signal in $", distribution), BLUE).sum() > 300


def test_values_of_8_bits_have_a_bar_each():
    """Bins of another width than one value would show gaps and teeth that the data does not have."""
    values = np.rint(np.random.default_rng(2).normal(100, 15, 20_000))
    edges, density = _bars(Distribution.from_array(values))
    numbers, counts = np.unique(values, return_counts=True)
    for number, count in zip(numbers, counts, strict=True):
        bar = np.searchsorted(edges, number) - 1
        assert edges[bar] < number < edges[bar + 1]
        assert density[bar] * np.diff(edges)[bar] == pytest.approx(count / values.size)
