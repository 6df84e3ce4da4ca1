"""Colour separation against closed forms, brute force and coverage."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import multivariate_normal, norm

import labcdp


def exact_pixels(mean, covariance, rng, n=400):
    """Pixels whose mean and covariance are exactly these."""
    values = rng.normal(size=(n, len(mean)))
    values -= values.mean(axis=0)
    values = values @ np.linalg.inv(np.linalg.cholesky(np.cov(values, rowvar=False))).T
    return mean + values @ np.linalg.cholesky(covariance).T


def test_known_distance_and_csp():
    rng = np.random.default_rng(2)
    first = exact_pixels((60, 50, 50), 25 * np.eye(3), rng)
    second = exact_pixels((50, 50, 50), 25 * np.eye(3), rng)
    separation = labcdp.colour_separation(first, second)
    assert separation.distance.value == pytest.approx(2, rel=1e-12)
    assert separation.csp.value == pytest.approx(0.8413447460685429, rel=1e-12)
    # Equal covariances: D_B = D^2 / 8.
    assert separation.csp_bound == pytest.approx(1 - np.exp(-0.5) / 2, rel=1e-12)
    gained = labcdp.colour_separation(first * (3, 0.5, 20), second * (3, 0.5, 20))
    assert gained.distance.value == pytest.approx(2, rel=1e-9), "factors of the planes do not change the distance"


def test_correlated_covariance_by_hand():
    covariance = np.array([[9.0, 4.0], [4.0, 16.0]])
    rng = np.random.default_rng(3)
    first, second = (exact_pixels(mean, covariance, rng) for mean in ((20, 33), (14, 25)))
    # S^-1 = [[16, -4], [-4, 9]] / 128.
    expected = sqrt((16 * 36 - 2 * 4 * 48 + 9 * 64) / 128)
    assert labcdp.colour_separation(first, second).distance.value == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("planes", [2, 3, 4])
def test_pairs_and_counted_share_equal_brute_force(planes):
    rng = np.random.default_rng(planes)
    first = np.round(rng.normal(20, 4, (60, planes)))
    second = np.round(rng.normal(20, 6, (45, planes)) + np.arange(planes))
    second[0] = -second[0]
    separation = labcdp.colour_separation(first, second, "40%")
    chromaticities = [region / region.sum(axis=1, keepdims=True) for region in (first, second)]
    chromaticities[1][0] = np.nan
    means = [region.mean(axis=0) / region.mean(axis=0).sum() for region in (first, second)]
    direction = means[0] - means[1]
    deviations = chromaticities[0][:, None] - chromaticities[1][None] - direction
    inside = np.linalg.norm(deviations, axis=2) <= 0.4 * np.linalg.norm(direction)
    assert separation.detected.value == pytest.approx(inside.mean(), abs=1e-12)
    right = []
    for region, other in ((first, second), (second, first)):
        share = 0
        for i, pixel in enumerate(region):
            rest = np.delete(region, i, axis=0)
            log_density = [
                multivariate_normal.logpdf(pixel, part.mean(axis=0), np.cov(part, rowvar=False))
                for part in (rest, other)
            ]
            share += log_density[0] > log_density[1]
        right.append(share / len(region))
    assert separation.csp_counted.value == pytest.approx(np.mean(right), abs=1e-12)


@pytest.mark.parametrize(("delta", "smooth_px"), [(0.0, 0), (2.0, 0), (10.0, 0), (10.0, 1.0)])
def test_intervals_hold(delta, smooth_px):
    """Each interval holds in 95 % of 80 repeats, less 4 standard deviations; of smoothed noise it may be wider."""
    rng, repeats, size = np.random.default_rng(11), 80, 20
    means = np.array((50 + delta, 50, 50)), np.array((50.0, 50, 50))
    direction = means[0] / means[0].sum() - 1 / 3
    truth = delta / 5, norm.cdf(delta / 10)
    held = np.zeros(2)
    for _ in range(repeats):
        noise = rng.normal(size=(2, size, size, 3))
        if smooth_px:
            noise = gaussian_filter(noise, (0, smooth_px, smooth_px, 0), mode="wrap")
            # Of a Gaussian of 1 px over white noise.
            noise *= sqrt(4 * np.pi) * smooth_px
        first, second = (mean + 5 * part for mean, part in zip(means, noise, strict=True))
        separation = labcdp.colour_separation(first, second, difference=direction if delta else None)
        for at, quantity in enumerate((separation.distance, separation.csp_counted)):
            low, high = quantity.interval
            held[at] += low - 1e-12 <= truth[at] <= high
            assert low <= quantity.value <= high
    assert (held / repeats > 0.95 - 4 * sqrt(0.95 * 0.05 / repeats)).all(), held / repeats


def test_share_of_pairs_of_normal_regions():
    """The share of pairs equals that of independent draws; its interval holds in 200 repeats."""
    rng = np.random.default_rng(5)
    means = (64.0, 50.0, 50.0), (50.0, 50.0, 50.0)
    direction = np.array(means[0]) / sum(means[0]) - 1 / 3
    draws = [rng.normal(mean, 4, (400_000, 3)) for mean in means]
    difference = np.subtract(*(draw / draw.sum(axis=1, keepdims=True) for draw in draws)) - direction
    truth = np.mean(np.linalg.norm(difference, axis=1) <= 0.5 * np.linalg.norm(direction))
    held = 0
    for _ in range(200):
        regions = [rng.normal(mean, 4, (300, 3)) for mean in means]
        low, high = labcdp.colour_separation(*regions, difference=direction).detected.interval
        held += low <= truth <= high
    assert held / 200 > 0.95 - 4 * sqrt(0.95 * 0.05 / 200)


def test_findings_and_errors():
    rng = np.random.default_rng(7)
    grey = rng.normal(50, 3, (20, 20, 3))
    alike = labcdp.colour_separation(grey, rng.normal(50, 3, (20, 20, 3)))
    assert "colours-not-separated" in [finding.code for finding in alike.findings]
    small = labcdp.colour_separation(rng.normal(50, 3, (5, 5, 3)), grey + 10)
    assert "region-correlation-unknown" in [finding.code for finding in small.findings]
    for first, second, text in (
        (grey, grey[..., :2], "3 and 2 planes"),
        (grey[..., :1], grey[..., :1], "one plane only"),
        (grey[0, :4], grey[1], "4 pixels of 3 planes"),
        (np.repeat(grey[..., :1], 3, axis=2), grey, "no noise of their own"),
        (np.where(grey > 55, np.nan, grey), grey, "not finite"),
        (grey * 1e300, grey, "the first region reaches"),
        ("red", grey, "the first region has type"),
    ):
        with pytest.raises(labcdp.InputError, match=text):
            labcdp.colour_separation(first, second)
    with pytest.raises(labcdp.InputError, match="epsilon is 2"):
        labcdp.colour_separation(grey, grey, 2)
