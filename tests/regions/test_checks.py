"""What speaks against using a region."""

import numpy as np
import pytest

from labcdp.core.finding import warning
from labcdp.core.roi import Roi
from labcdp.regions import check_region

ROI = Roi.rectangle("grey", 30, 30, 40, 40)


def noisy(seed, level=100.0, sigma=2.0):
    return np.random.default_rng(seed).normal(level, sigma, (100, 100))


def findings(image, roi=ROI, saturated=None):
    return check_region(image, saturated, roi)


@pytest.mark.parametrize(
    "make",
    [
        lambda rng: rng.normal(100, 5, (100, 100)),
        lambda rng: rng.poisson(0.5, (100, 100)),
        lambda rng: np.rint(rng.normal(100, 0.3, (100, 100))).astype(np.uint16),
        lambda rng: np.full((100, 100), 7.0),
        lambda rng: np.zeros((100, 100)),
    ],
    ids=["normal", "few photons", "whole numbers", "all alike", "zero"],
)
def test_nothing_speaks_against_noise_alone(make):
    # 40 images: a check that is wrong once in a thousand times fails here in 4 % of all seeds.
    assert [findings(make(np.random.default_rng(seed))) for seed in range(40)] == [()] * 40


def test_few_pixels():
    assert findings(noisy(1), Roi.rectangle("dot", 30, 30, 6, 6)) == (
        warning("region-few-pixels", "dot", pixels=36, recommended=100),
    )


def test_saturated_pixels():
    saturated = np.zeros((100, 100), dtype=bool)
    saturated[30:34, 30:70] = True
    saturated[:20] = True
    assert findings(noisy(1), saturated=saturated) == (warning("region-saturated", "grey", share=0.1),)


def test_pixels_without_a_value():
    image = noisy(1)
    image[40:42, 30:70] = np.nan
    assert findings(image) == (warning("region-missing-values", "grey", share=pytest.approx(0.05)),)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_an_edge_within_the_border(depth):
    image = noisy(2)
    image[:, : 30 + depth] -= 50
    assert findings(image) == (warning("region-edge", "grey", margin_px=depth),)


@pytest.mark.parametrize(("across", "down"), [(0.2, 0.0), (0.0, -0.2), (0.12, 0.12)])
def test_non_uniform_light(across, down):
    ramp = 1 + across * np.linspace(-0.5, 0.5, 100) + down * np.linspace(-0.5, 0.5, 100)[:, None]
    (found,) = findings(ramp * noisy(3))
    assert found.code == "region-uneven"
    # 40 of 100 pixels: 8 % across or down; of a diagonal 98 % are seen, and 4.8 % + 4.8 % made of it.
    assert found.values["share"] == pytest.approx(0.08 if 0 in (across, down) else 0.084, abs=0.008)


@pytest.mark.parametrize(("count", "off"), [(1, 60), (3, 20), (1, 1000)])
def test_odd_pixels(count, off):
    image = noisy(5)
    image[50, 50 : 50 + count] += off
    assert findings(image) == (warning("region-odd-pixels", "grey", odd=count, pixels=1600, sigma=6.0),)
