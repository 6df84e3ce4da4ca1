"""All regions of the live image against all: what Python gives for the same pixels, card and map."""

from types import SimpleNamespace

import numpy as np
import pytest

import labcdp
from labcdp.core.luminance import LuminanceMap
from labcdp.core.roi import Roi
from labcdp.web.bench.cards import matrix_card
from labcdp.web.bench.matrix import LiveMatrix, MatrixPlot, live_matrix
from labcdp.web.bench.pair import Target
from labcdp.web.regions.page_image import PageImage

N, SIDE = 9, 12
ROIS = [Roi.rectangle(f"P{number}", SIDE * number + 1, 1, SIDE - 2, SIDE - 2) for number in range(N)]


@pytest.fixture
def image():
    rng = np.random.default_rng(3)
    levels = np.repeat(np.geomspace(1000, 60, N), SIDE)
    dn = np.clip(np.rint(rng.normal(levels, 0.05 * levels, (SIDE, N * SIDE))), 0, 1000).astype(np.uint16)
    light = LuminanceMap(dn / 10.0, np.zeros(dn.shape), 0.0, np.zeros(dn.shape, np.uint8))
    return PageImage("live", dn, True, None, light, "relative", saturation_dn=1000.0)


def test_the_matrix_is_that_of_python_without_saturated_regions(image):
    # Drawn in another order than they are bright, and a region outside the image.
    drawn = [*ROIS[::-1], Roi.rectangle("outside", 500, 0, 5, 5)]
    (matrix,) = live_matrix(image, drawn, Target((0.4,), 0.5))
    assert matrix.names == tuple(f"P{number}" for number in range(N))
    pixels = {roi.name: roi.select(image.luminance.luminance_cd_m2) for roi in ROIS}
    expected = labcdp.cdp_matrix(pixels, 0.4)
    np.testing.assert_array_equal(matrix.cdp[1:, 1:], expected["cdp"].values[1:, 1:])
    # Half of the first region is clipped.
    assert np.isnan(matrix.cdp[0]).all()
    (measured,) = live_matrix(image, ROIS, Target())
    np.testing.assert_array_equal(measured.target[1:, 1:], labcdp.cdp_matrix(pixels)["contrast"].values[1:, 1:])
    assert [*live_matrix(image, drawn[-1:], Target())] == [None]


def test_card_and_map_show_it(image):
    (matrix,) = live_matrix(image, ROIS, Target((0.4,), 0.5))
    known = matrix.cdp[np.triu_indices(N, 1)]
    card = matrix_card(SimpleNamespace(matrix=matrix))
    assert f"<b>{int((known >= 0.9).sum())} of {8 * 7 // 2} pairs</b>" in card
    pair, cdp = matrix.weakest
    assert cdp == np.nanmin(np.diagonal(matrix.cdp, 1))
    assert f"{cdp:.3f}, {pair}" in card
    assert matrix_card(SimpleNamespace(matrix=None)) == ""
    nothing = np.full((2, 2), np.nan)
    assert "saturated" in matrix_card(SimpleNamespace(matrix=LiveMatrix(("a", "b"), nothing, nothing, nothing)))
    plot = MatrixPlot()
    plot.update(matrix)
    (rectangles,) = plot.figure.renderers
    data = rectangles.data_source.data
    assert data["bright"][:2] == ["P0", "P0"]
    np.testing.assert_array_equal(data["cdp"], known)
    assert plot.figure.x_range.factors == [f"P{number}" for number in range(N)]
