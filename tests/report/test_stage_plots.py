"""Plots of a simulated chain: bars of the density, moments, and pictures of awkward values."""

import cv2
import numpy as np
import pytest
from numpy.typing import ArrayLike

from labcdp.metrics import Distribution, cdp_range, contrast_distribution
from labcdp.report.plots import _bars, _drawn_contrasts, stage_figure

VERMILLION, BLUE, GREY = (213, 94, 0), (0, 114, 178), (153, 153, 153)


def area(png: bytes, colour: tuple[int, int, int]) -> int:
    """Pixels of exactly a colour."""
    decoded = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return int(np.all(decoded[..., ::-1] == colour, axis=-1).sum())


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(1).normal(5, 1, 3000),
        np.random.default_rng(1).poisson(900, 3000),
        np.arange(1000).repeat(7),
        [1.0, 1.0, 1.01, 1.01, 500.0, 500.0],
        [0.1 + 0.2, 0.3, 0.3, 0.1 + 0.2],
        [0.0],
        [-3.5],
    ],
)
def test_bars_hold_all_of_a_distribution(values: ArrayLike) -> None:
    edges, density = _bars(Distribution.from_array(values))
    assert (np.diff(edges) >= 0).all()
    assert density @ np.diff(edges) == pytest.approx(1.0, rel=1e-9)
    assert (density > 0).sum() <= 256


@pytest.mark.parametrize("values", [[7], np.random.default_rng(0).normal(5, 1, 500)])
def test_stage_figure_draws_line_and_bars(values: ArrayLike) -> None:
    png = stage_figure("Stage $x_{", Distribution.from_array(values), "signal in $", Distribution.from_array(values))
    assert area(png, BLUE) > 300
    assert area(png, GREY) > 300
    assert area(png, VERMILLION) > 50


def test_contrasts_are_drawn_as_far_as_interval_and_bulk_can_be_read() -> None:
    rng = np.random.default_rng(0)
    dark, bright = np.abs(rng.normal(3.0, 2.0, 2000)) + 0.01, rng.normal(6.0, 2.0, 2000)
    result, edges = cdp_range(dark, bright, [1.0])[0], np.linspace(-1, 420, 2000)
    start, stop, beyond = _drawn_contrasts(contrast_distribution(dark, bright, edges), result)
    contrasts = np.divide.outer(bright, dark) - 1
    assert start == -1.0
    assert result.interval[1] < stop < 5 * result.interval[1]
    assert beyond == pytest.approx((contrasts > stop).mean(), abs=1e-9)
    assert 0.005 < beyond <= 0.1
