"""Plots of a simulated chain: bars of the density, moments, and pictures of awkward values."""

from math import inf, nan

import cv2
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from labcdp.contrast import Distribution, cdp, contrast_distribution
from labcdp.errors import InputError
from labcdp.report.plots import _drawn_contrasts, contrasts_figure
from labcdp.report.stage_plots import _bars, _moments, chain_figure, stage_figure

VERMILLION, BLUE, GREEN, GREY = (213, 94, 0), (0, 114, 178), (0, 158, 115), (153, 153, 153)


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


def test_whole_numbers_get_a_bar_each_and_their_luminances_the_same() -> None:
    counts = np.random.default_rng(0).integers(5, 50, 120)
    native = Distribution(np.arange(300, 420), counts)
    for values in (native, native.map(lambda dn: 0.137 * (dn - 64))):
        np.testing.assert_allclose(heights(values) / heights(values).max(), counts / counts.max(), rtol=1e-9)


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


def test_moments_of_one_value() -> None:
    assert _moments(distribution([7, 7])) == "mean 7, std 0, SNR (mean/std) ∞"


@pytest.mark.parametrize("values", [[7], [10.0, 20.0], np.arange(5000), np.random.default_rng(0).normal(5, 1, 500)])
def test_stage_figure_draws_line_and_bars(values: ArrayLike) -> None:
    png = stage_figure("Stage $x_{", distribution(values), "signal in $", distribution(values), simulated=False)
    assert area(png, BLUE) > 300
    assert area(png, GREY) > 300
    assert area(png, VERMILLION) == 0


def test_a_simulated_chain_is_called_so() -> None:
    one = distribution([1, 2, 2])
    assert area(stage_figure("Sensor", one, "DN", one), VERMILLION) > 50


def test_chain_figure_draws_what_is_known() -> None:
    stages, unknown = ["scene", "sensor", "isp <b>$"], [(nan, nan)] * 3
    known, decibels = [30.0, 20.0, 10.0], [29.5, 26.0, 20.0]
    full = chain_figure(stages, [0.9, 0.8, 0.7], [(0.88, 0.92)] * 3, known, decibels, [20.0, 15.0, 8.0], False)
    none = chain_figure(stages, [nan] * 3, unknown, [nan] * 3, [nan] * 3, [nan] * 3, False)
    native = chain_figure(stages, [nan] * 3, unknown, known, decibels, [nan] * 3, False)
    assert area(full, BLUE) > area(native, BLUE) > area(none, BLUE) + 200
    # Of what is not drawn, there are the lines of the legend.
    assert area(full, GREEN) > area(native, GREEN) + 200 == area(none, GREEN) + 200
    assert area(full, VERMILLION) == 0


def test_chain_figure_draws_an_snr_without_noise_as_infinite() -> None:
    stages, unknown = ["scene", "sensor"], [(nan, nan)] * 2
    two = [
        chain_figure(stages, [1.0, 0.8], unknown, [endless, 20.0], [endless, 13.0], [endless, 10.0])
        for endless in (inf, 3e13)
    ]
    assert two[0] == two[1]


@pytest.mark.parametrize("ratio", [[inf, inf], [0.0, -1.0], [5.0, 5.0]])
def test_chain_figure_survives_any_snr(ratio: list[float]) -> None:
    assert chain_figure(["a", "b"], [0.5, 0.5], [(0.6, 0.7), (0.4, nan)], ratio, ratio, ratio)


def test_chain_figure_refuses_lists_that_do_not_fit() -> None:
    with pytest.raises(InputError, match=r"lists have lengths \[2, 1, 1, 1, 1, 1\]: give one value of each"):
        chain_figure(["a", "b"], [0.5], [(0.4, 0.6)], [1.0], [0.0], [1.0])
    with pytest.raises(InputError, match=r"lists have lengths \[0, 0, 0, 0, 0, 0\]"):
        chain_figure([], [], [], [], [], [])


def test_contrasts_figure_of_exact_weights_has_no_interval() -> None:
    a, b = Distribution([100.0, 110.0], [0.5, 0.5]), Distribution([120.0, 130.0], [0.5, 0.5])
    drawn = contrasts_figure(contrast_distribution(a, b, np.linspace(-0.2, 0.6, 50)), cdp(a, b, 0.2), "exact $")
    assert area(drawn, BLUE) > 300


def test_contrasts_figure_says_what_is_simulated() -> None:
    a, b = Distribution([100.0, 110.0], [0.5, 0.5]), Distribution([120.0, 130.0], [0.5, 0.5])
    contrasts, result = contrast_distribution(a, b, np.linspace(-0.2, 0.6, 50)), cdp(a, b, 0.2)
    neither, bench, chain = (contrasts_figure(contrasts, result, "pair", what) for what in ("", "bench", "chain"))
    assert area(neither, VERMILLION) == 0
    assert 0 < area(chain, VERMILLION) != area(bench, VERMILLION) > 0


def test_contrasts_are_drawn_as_far_as_interval_and_bulk_can_be_read() -> None:
    rng = np.random.default_rng(0)
    dark, bright = np.abs(rng.normal(3.0, 2.0, 2000)) + 0.01, rng.normal(6.0, 2.0, 2000)
    result, edges = cdp(dark, bright, 1.0), np.linspace(-1, 420, 2000)
    start, stop, beyond = _drawn_contrasts(contrast_distribution(dark, bright, edges), result)
    contrasts = np.divide.outer(bright, dark) - 1
    assert start == -1.0
    assert result.interval[1] < stop < 5 * result.interval[1]
    assert beyond == pytest.approx((contrasts > stop).mean(), abs=1e-9)
    assert 0.005 < beyond <= 0.1


def test_contrasts_beside_the_interval_are_drawn_with_it() -> None:
    a, b = Distribution([100.0], [1.0]), Distribution([101.0], [1.0])
    result = cdp(a, b, 1.0)
    start, stop, beyond = _drawn_contrasts(contrast_distribution(a, b, [0.0, 0.01, 0.02]), result)
    assert start == 0.0
    assert stop > result.interval[1]
    assert beyond == 0.0
