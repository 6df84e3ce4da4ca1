"""Plots of a simulated chain: bars of the density, moments, and pictures of awkward values."""

import cv2
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from labcdp.metrics import Distribution, cdp_range, contrast_distribution
from labcdp.report.plots import _drawn_contrasts
from labcdp.report.stage_plots import _bars, _moments, stage_figure

VERMILLION, BLUE, GREY = (213, 94, 0), (0, 114, 178), (153, 153, 153)


def area(png: bytes, colour: tuple[int, int, int]) -> int:
    """Pixels of exactly a colour."""
    decoded = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return int(np.all(decoded[..., ::-1] == colour, axis=-1).sum())


def distribution(values: ArrayLike) -> Distribution:
    return Distribution.from_array(values)


def heights(values: Distribution) -> NDArray[np.float64]:
    """Density of the bars that are not empty."""
    density = _bars(values)[1]
    return density[density > 0]


@pytest.mark.parametrize("n", [257, 700, 1000])
def test_many_values_share_bars_that_all_hold_as_many(n: int) -> None:
    found = heights(Distribution(np.arange(n), np.full(n, 7)))
    assert 100 <= found.size <= 256
    np.testing.assert_allclose(found, found[0], rtol=1e-9)


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(1).normal(5, 1, 3000),
        np.random.default_rng(1).poisson(900, 3000),
        [10, 10, 20, 20],
        [1.0, 1.0, 1.01, 1.01, 500.0, 500.0],
        [0.1 + 0.2, 0.3, 0.3, 0.1 + 0.2],
        [7],
        [0.0],
        [-3.5],
    ],
)
def test_bars_hold_all_of_a_distribution(values: ArrayLike) -> None:
    edges, density = _bars(distribution(values))
    assert (np.diff(edges) >= 0).all()
    assert density @ np.diff(edges) == pytest.approx(1.0, rel=1e-9)


def test_moments_are_those_of_the_values() -> None:
    values = np.random.default_rng(2).normal(200.0, 4.0, 5000)
    text = _moments(distribution(values))
    snr = values.mean() / values.std()
    assert text == f"mean {values.mean():.2f}, std {values.std():.2f}, SNR (mean/std) {snr:.1f}"


@pytest.mark.parametrize("values", [[7], [10.0, 20.0], np.arange(5000), np.random.default_rng(0).normal(5, 1, 500)])
def test_stage_figure_draws_line_and_bars(values: ArrayLike) -> None:
    png = stage_figure("Stage $x_{", distribution(values), "signal in $", distribution(values))
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
