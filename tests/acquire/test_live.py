"""Live numbers against numpy on the whole stack, and against known noise."""

from dataclasses import replace
from itertools import pairwise
from math import sqrt

import numpy as np
import pytest

from labcdp.acquire.live import LiveNumbers
from labcdp.core.roi import Roi

RECTANGLE = Roi.rectangle("rectangle", 5, 3, 40, 30)
TRIANGLE = Roi("triangle", ((50, 5), (90, 10), (60, 50)))


def stack(factors, sigma_dn, mean_dn=1064.0):
    """Frames above a black level of 64 DN, whose light has these factors."""
    noise = np.random.default_rng(1).normal(0, sigma_dn, (len(factors), 60, 100))
    dn = 64 + (mean_dn - 64) * np.asarray(factors)[:, None, None] + noise
    return np.clip(np.rint(dn), 0, 4095).astype(np.uint16)


@pytest.fixture
def numbers_of(new_frame):
    def numbers(images, region=RECTANGLE):
        live = LiveNumbers([region])
        for image in images:
            live.add(new_frame(image))
        return replace(live.numbers[0], black_dn=64.0)

    return numbers


@pytest.mark.parametrize("region", [RECTANGLE, TRIANGLE])
@pytest.mark.parametrize("n", [2, 7])
def test_numbers_are_those_of_the_whole_stack(numbers_of, region, n):
    images = stack(np.ones(n), 20.0, mean_dn=4060.0)
    numbers = numbers_of(images, region)
    values = np.array([region.select(image) for image in images], dtype=float)
    means = values.mean(axis=1)
    assert (numbers.frames, numbers.pixels) == values.shape
    assert numbers.mean_dn == pytest.approx(values.mean(), rel=1e-12)
    assert numbers.saturated_share == pytest.approx((values >= 4095).mean(), rel=1e-12)
    variance = np.mean([np.var(b - a) for a, b in pairwise(values)]) / 2
    assert numbers.temporal_noise_dn == pytest.approx(sqrt(variance), rel=1e-5)
    assert numbers.flicker_dn == pytest.approx(sqrt(np.mean(np.diff(means) ** 2) / 2), rel=1e-6)
    slope = np.polyfit(np.arange(n), means, 1)[0]
    assert numbers.drift_dn == pytest.approx(slope * (n - 1), rel=1e-6, abs=1e-9)
    assert numbers.drift_rel == pytest.approx(slope * (n - 1) / (means.mean() - 64), rel=1e-6, abs=1e-9)


def test_temporal_noise_is_that_of_the_camera_whatever_the_lamp_does(numbers_of):
    sigma = 12.0
    numbers = numbers_of(stack(1 + 0.05 * np.cos(np.arange(20)), sigma))
    # A pair's variance estimate of 1200 pixels scatters by sqrt(2 / 1200); successive pairs share a frame (Kendall).
    spread = sqrt(2 / 1200 / 19 * 1.5) * sigma / 2
    # Rounding to whole DN adds 1/12 DN^2.
    assert abs(numbers.temporal_noise_dn - sqrt(sigma**2 + 1 / 12)) < 4 * spread


def test_a_steady_drift_is_not_a_flicker_and_the_other_way_round(numbers_of):
    drifting = numbers_of(stack(1 + np.linspace(0, 0.04, 40), 5.0))
    assert drifting.drift_rel == pytest.approx(0.04 / 1.02, abs=4 * 5.0 / sqrt(1200) / 1000)
    assert drifting.flicker_rel < 0.001
    flickering = numbers_of(stack(1 + 0.04 * (-1.0) ** np.arange(40), 5.0))
    # Successive differences of +-0.08: standard deviation 0.08 / sqrt 2.
    assert flickering.flicker_rel == pytest.approx(0.08 / sqrt(2), rel=0.01)
    assert abs(flickering.drift_rel) < 0.01
