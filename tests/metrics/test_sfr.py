"""Spatial frequency response at slanted edges, against the closed form of a Gaussian blur with square pixels."""

from math import inf, sqrt

import numpy as np
import pytest
from scipy.ndimage import convolve1d

import labcdp
from labcdp.core.errors import InputError
from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.core.roi import Roi
from labcdp.metrics import lens_mtf, mean_sfr, sfr

from .slanted_edges import edge_image, frequency_at, response


@pytest.mark.parametrize("angle_deg", [2.5, 5, 12, 33])
@pytest.mark.parametrize("sigma_px", [0.0, 0.3, 0.5, 1, 2])
def test_response_is_that_of_the_closed_form(sigma_px, angle_deg):
    measured = sfr(edge_image(100, 60, angle_deg, sigma_px))
    np.testing.assert_allclose(
        measured.response.value, response(measured.frequency, angle_deg, sigma_px), atol=5e-4 if sigma_px else 3e-3
    )
    assert measured.mtf50.value == pytest.approx(frequency_at(0.5, angle_deg, sigma_px), rel=5e-4)
    if not (sigma_px == 0 and angle_deg == 33):  # at 1 cycle/pixel it is still above 10 %
        assert measured.mtf10.value == pytest.approx(frequency_at(0.1, angle_deg, sigma_px), rel=1e-3)
    assert (measured.direction, measured.angle_deg) == ("horizontal", pytest.approx(angle_deg, abs=0.01))
    assert (measured.bright, measured.dark) == (pytest.approx(100, abs=0.02), pytest.approx(20, abs=0.02))
    assert measured.overshoot.value == pytest.approx(0, abs=4e-3)


def test_a_turned_or_mirrored_picture_has_the_same_response():
    image = edge_image(90, 60, 6, 0.8)
    upright = sfr(image)
    for turned, direction, angle_deg in (
        (image[:, ::-1], "horizontal", -6),
        (image[::-1], "horizontal", -6),
        (image.T, "vertical", 6),
        (np.rot90(image), "vertical", -6),
    ):
        measured = sfr(turned)
        assert (measured.direction, measured.angle_deg) == (direction, pytest.approx(angle_deg, abs=0.01))
        np.testing.assert_allclose(measured.response.value, upright.response.value, atol=1e-6)
    np.testing.assert_allclose(sfr(image.T).line_px, upright.line_px[:, ::-1], atol=1e-6)


def test_a_bent_edge_is_followed():
    measured = sfr(edge_image(200, 100, 4, 0.7, bend=5e-4))
    assert measured.mtf50.value == pytest.approx(frequency_at(0.5, 4, 0.7), rel=2e-3)


# Noise of the pixels in parts of the step, blur, height and slope of the edge.
COVERED = [(0.0125, 0.7, 80, 5), (0.025, 2.0, 80, 5), (0.1, 0.7, 60, 8)]
MORE = [(0.0125, 0.3, 80, 5), (0.025, 0.7, 40, 8)]


@pytest.mark.parametrize(
    ("noise_rel", "sigma_px", "height", "angle_deg", "repeats"),
    [
        *((*case, 20) for case in COVERED),
        *(pytest.param(*case, 400, marks=pytest.mark.long) for case in COVERED + MORE),
    ],
)
def test_95_percent_intervals_hold_the_truth_in_95_of_100_repeats(noise_rel, sigma_px, height, angle_deg, repeats):
    clean = edge_image(height, 40, angle_deg, sigma_px)
    random, truth = np.random.default_rng(7), frequency_at(0.5, angle_deg, sigma_px)
    measured = [sfr(clean + random.normal(0, 80 * noise_rel, clean.shape)).mtf50 for _ in range(repeats)]
    inside = np.mean([quantity.interval.low <= truth <= quantity.interval.high for quantity in measured])
    assert inside == pytest.approx(0.95, abs=3 * sqrt(0.95 * 0.05 / repeats))
    values, u = (np.array([getattr(quantity, name) for quantity in measured]) for name in ("value", "u"))
    assert values.mean() == pytest.approx(truth, abs=max(0.01 * truth, 4 * u.mean() / sqrt(repeats)))
    assert u.mean() == pytest.approx(values.std(), rel=4 / sqrt(2 * repeats))


def test_noise_is_no_response():
    """At a frequency that the blur takes away, the noise alone would seem to be one."""
    clean, random = edge_image(60, 40, 5, 2.0), np.random.default_rng(3)
    measured = [sfr(clean + random.normal(0, 4, clean.shape)).response for _ in range(8)]
    values, noise, low = (
        np.array([get(quantity)[100] for quantity in measured])
        for get in (lambda q: q.value, lambda q: q.u, lambda q: q.interval.low)
    )
    assert np.median(values) < noise.mean()
    assert (low <= 1e-3).sum() >= 7


def test_overshoot_of_sharpening():
    image = edge_image(100, 80, 5, 0.7)
    sharpened = convolve1d(image, [-0.5, 2.0, -0.5], axis=1, mode="nearest")
    # The profile itself, at every distance from the edge: rows are shifted by all phases.
    largest = (sharpened.max() - 100) / 80
    measured = sfr(sharpened)
    assert measured.overshoot.value == pytest.approx(largest, abs=0.002)
    assert measured.undershoot.value == pytest.approx(largest, abs=0.002)
    assert measured.response.value.max() > 1.08
    kernel = 2 - np.cos(2 * np.pi * measured.frequency * np.cos(np.radians(5)))
    np.testing.assert_allclose(
        measured.response.value[:100], (kernel * response(measured.frequency, 5, 0.7))[:100], atol=2e-3
    )


def test_noise_alone_makes_no_overshoot():
    clean, random = edge_image(60, 40, 5, 0.7), np.random.default_rng(5)
    measured = [sfr(clean + random.normal(0, 1, clean.shape)).overshoot for _ in range(10)]
    # A maximum over the profile would be at 1 % and more in each.
    assert np.mean([quantity.value for quantity in measured]) < 0.004
    assert sum(quantity.interval.low > 0 for quantity in measured) <= 1


def test_regions_of_arrays_and_maps():
    image = np.full((200, 300), 20.0)
    image[40:140, 100:160] = edge_image(100, 60, 5, 0.7)
    inside = Roi.rectangle("edge", 100, 40, 60, 100)
    measured = labcdp.sfr(image, inside)
    np.testing.assert_allclose(measured.line_px[[0, -1]], [[125.67, 40.5], [134.33, 139.5]], atol=0.02)
    luminance = LuminanceMap(image, np.zeros(image.shape), 0.0, np.zeros(image.shape, np.uint8))
    assert labcdp.sfr(luminance, inside).mtf50.value == measured.mtf50.value
    # Each value of such a map stands for 2 x 2 pixels.
    cells = LuminanceMap(image, np.zeros(image.shape), 0.0, np.zeros(image.shape, np.uint8), step=2)
    of_cells = labcdp.sfr(cells, Roi.rectangle("edge", 200, 80, 120, 200))
    assert of_cells.mtf50.value == pytest.approx(measured.mtf50.value / 2)
    np.testing.assert_allclose(of_cells.line_px, 2 * measured.line_px)
    with pytest.raises(InputError, match="with and without a colour filter"):
        mean_sfr([measured, of_cells])


def test_a_polygon_and_defects_leave_pixels_out():
    image = edge_image(100, 60, 5, 0.7)
    invalid = np.zeros(image.shape, np.uint8)
    image[30, 20:40], invalid[30, 20:40] = 1000.0, Invalid.DEFECT
    luminance = LuminanceMap(image, np.zeros(image.shape), 0.0, invalid)
    slanted = Roi("edge", ((10, 0), (45, 0), (55, 100), (20, 100)))
    assert sfr(luminance, slanted).mtf50.value == pytest.approx(frequency_at(0.5, 5, 0.7), rel=1e-3)
    invalid[:, 50:] = Invalid.SATURATED
    with pytest.raises(InputError, match="pixels are saturated, which makes an edge seem sharper"):
        sfr(luminance)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.ones(40), "the light has the shape"),
        ([["dark", "bright"]], "the light has type"),
        (np.full((40, 40), 1e300), "the light reaches 1e.300"),
        (np.ones((10, 60)), "the region is 60 x 10 pixels: give at least 20 on each side"),
        (np.full((40, 40), np.nan), "no pixel has a value"),
        (np.ones((40, 40)), "0 rows have 4 pixels and more on both sides of an edge"),
        (np.random.default_rng(1).normal(100, 1, (60, 60)), "there is no edge in the noise"),
        (edge_image(60, 60, 1e-3, 0.7), "the rows cross the edge at phases 1 pixels apart: slant the edge"),
        (edge_image(60, 60, 45, 0.7), "the edge is slanted by 4[5-9]°: slant it by 5°, at most 40°"),
        (edge_image(60, 60, 26.56505, 0.7), "the rows cross the edge at phases 0.4"),
    ],
)
def test_refusals(image, message):
    with pytest.raises(InputError, match=message):
        sfr(image)


def test_a_frequency_that_noise_hides_is_not_known():
    image = edge_image(80, 50, 5, 0.7) + np.random.default_rng(2).normal(0, 16, (80, 50))
    measured = sfr(image)
    assert np.isfinite(measured.mtf50.value)
    assert np.isnan(measured.mtf10.value)


def test_mean_of_edges_has_the_scatter_of_edges():
    edges = [sfr(edge_image(80, 50, 5, sigma)) for sigma in (0.7, 0.8, 0.9)]
    values = np.array([edge.mtf50.value for edge in edges])
    mean = mean_sfr(edges)
    assert mean.mtf50.value == pytest.approx(values.mean())
    assert (mean.mtf50.u, mean.mtf50.dof) == (pytest.approx(values.std(ddof=1) / sqrt(3)), 2)
    assert mean_sfr(edges[:1]).mtf50 == edges[0].mtf50
    with pytest.raises(InputError, match="there is no edge"):
        mean_sfr([])


@pytest.mark.parametrize("sigma_px", [0.3, 0.7, 2.0])
def test_lens_mtf_is_without_the_pixel(sigma_px):
    pitch_m = 3e-6
    edges = [sfr(edge_image(100, 60, angle_deg, sigma_px)) for angle_deg in (5, 30)]
    lp_per_mm, modulation = np.array(lens_mtf(edges, pitch_m)).T
    cycles = 1e3 * lp_per_mm * pitch_m
    np.testing.assert_allclose(modulation, np.exp(-2 * (np.pi * sigma_px * cycles) ** 2), atol=2e-3)
    assert modulation[-1] < 0.01
    assert lp_per_mm.size < 60
    with pytest.raises(InputError, match="the pixel pitch is inf m"):
        lens_mtf(edges, inf)


@pytest.mark.parametrize("angle_deg", [5, -7, 12])
@pytest.mark.parametrize("transposed", [False, True])
def test_lens_mtf_behind_a_colour_filter_is_without_the_places_of_its_pixels(angle_deg, transposed):
    """Values are means of the two green pixels of each 2 x 2, which lie across: the sum has a response of its own."""
    image = edge_image(200, 160, angle_deg, 0.7)
    image = image.T if transposed else image
    greens = (image[::2, 1::2] + image[1::2, ::2]) / 2
    luminance = LuminanceMap(greens, np.zeros(greens.shape), 0.0, np.zeros(greens.shape, np.uint8), step=2)
    measured = sfr(luminance, pixels={(0, 1): 1.0, (1, 0): 1.0})
    lp_per_mm, modulation = np.array(lens_mtf([measured], 3e-6)).T
    expected = np.exp(-2 * (np.pi * 0.7 * 3e-3 * lp_per_mm) ** 2)
    np.testing.assert_allclose(modulation, expected, atol=3e-3)
    # As if each value were one square of 2 x 2 pixels it would be far off.
    alike = np.interp(lp_per_mm, *np.array(lens_mtf([sfr(luminance)], 3e-6)).T)
    assert np.abs(alike - expected).max() > 0.02


def test_lens_mtf_of_unlike_edges_is_their_mean():
    edges = [sfr(edge_image(100, 60, 5, sigma)) for sigma in (0.4, 0.9)]
    lp_per_mm, modulation = np.array(lens_mtf(edges, 3e-6)).T
    expected = np.mean([np.exp(-2 * (np.pi * sigma * 3e-3 * lp_per_mm) ** 2) for sigma in (0.4, 0.9)], axis=0)
    measured = lp_per_mm < 0.6 / 3e-3
    np.testing.assert_allclose(modulation[measured], expected[measured], atol=2e-3)
