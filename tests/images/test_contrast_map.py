from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter
from scipy.special import ndtr

from labcdp.contrast import DetectionInterval, cdp, cdp_with_common_errors
from labcdp.errors import InputError
from labcdp.evaluate.contrast_map import ContrastMapSettings, contrast_map
from labcdp.evaluate.contrast_map_edges import EdgeKind
from labcdp.luminance import CommonError, Invalid, LuminanceMap


def _map(luminance, common=(), invalid=None, **more):
    nothing = np.zeros(luminance.shape, dtype=np.uint8)
    return LuminanceMap(
        luminance, np.full(luminance.shape, 0.01), common, nothing if invalid is None else invalid, **more
    )


def _halves(dark=100.0, bright=150.0, noise=8.0, shape=(400, 480), seed=0):
    image = np.full(shape, dark)
    image[:, shape[1] // 2 + 9 :] = bright
    return image + noise * np.random.default_rng(seed).normal(size=shape)


def _across(found, x=249):
    """Edges between the two halves, but those that are too short."""
    edges = found.edges
    left, right = (found.regions.centre_px[side, 0] < x for side in (edges.bright, edges.dark))
    return np.flatnonzero((left != right) & (edges.kind != EdgeKind.SMALL))


def _pixels(found, image, region):
    """Measured pixels of a region, found in another way: no other region within 2 pixels, and odd row plus column."""
    own = found.regions.labels == region
    inside = own & (minimum_filter(own, 5, mode="nearest") & maximum_filter(own, 5, mode="nearest"))
    rows, columns = np.nonzero(inside)
    odd = (rows + columns) % 2 == 1
    return image[rows[odd], columns[odd]]


def _share(bright, dark, noise, low, high):
    """Share of the pairs of two normal patches with a contrast of `low` to `high`."""

    def up_to(contrast):
        ratio = 1 + contrast
        return ndtr((ratio * dark - bright) / (noise * sqrt(ratio**2 + 1)))

    return up_to(high) - up_to(low)


@pytest.mark.parametrize("epsilon", [0.5, 0.2, DetectionInterval.at_least(0.3)])
def test_contrast_and_cdp_of_an_edge_are_those_of_its_pixels(epsilon):
    image = _halves()
    found = contrast_map(_map(image), ContrastMapSettings(epsilon=epsilon))
    edges = found.edges
    assert _across(found).size >= 8
    for edge in _across(found):
        bright, dark = (_pixels(found, image, side[edge]) for side in (edges.bright, edges.dark))
        assert edges.contrast[edge] == pytest.approx(bright.mean() / dark.mean() - 1, rel=1e-9)
        expected = cdp(bright, dark, float(edges.contrast[edge]), epsilon)
        assert edges.cdp[edge] == expected.cdp
        inflation = found.noise.inflation
        assert edges.cdp_standard_error[edge] == pytest.approx(expected.standard_error * sqrt(inflation), rel=1e-9)
        of_means = (
            bright.var(ddof=1) / bright.size / bright.mean() ** 2 + dark.var(ddof=1) / dark.size / dark.mean() ** 2
        )
        assert edges.contrast_standard_uncertainty[edge] == pytest.approx(
            (1 + edges.contrast[edge]) * sqrt(inflation * of_means), rel=1e-9
        )


def test_cdp_and_its_interval_agree_with_the_closed_form_for_normal_noise():
    inside, seen, deviations = 0, 0, []
    for seed in range(3):
        found = contrast_map(_map(_halves(noise=14.0, seed=seed)))
        for edge in _across(found):
            contrast = found.edges.contrast[edge]
            truth = _share(150.0, 100.0, 14.0, 0.5 * contrast, 1.5 * contrast)
            deviations.append(found.edges.cdp[edge] - truth)
            inside += found.edges.cdp_low[edge] <= truth <= found.edges.cdp_high[edge]
            seen += 1
    # At least 16 independent pairs of regions, since an edge shares its regions with others.
    assert abs(np.mean(deviations)) < 4 * np.std(deviations) / 4
    assert np.std(deviations) < 0.02
    assert inside / seen > 0.85


def test_steps_are_edges_and_noise_is_none():
    found = contrast_map(_map(_halves(noise=3.0)))
    across = np.isin(np.arange(found.edges.kind.size), _across(found))
    assert set(found.edges.kind[across]) == {EdgeKind.SEEN}
    assert set(found.edges.kind[~across]) <= {EdgeKind.NOISE, EdgeKind.SMALL}
    assert found.detected_share == found.detected_border_share == 1.0
    # The border's middle lies on the step.
    assert np.abs(found.edges.middle_px[across, 0] - 249).max() < 1


def test_a_noisy_step_is_lost():
    found = contrast_map(_map(_halves(bright=130.0, noise=20.0)))
    across = found.edges.kind[_across(found)]
    assert set(across) == {EdgeKind.LOST}
    assert found.detected_share == found.detected_border_share == 0.0
    weakest = found.weakest(5)
    assert np.array_equal(found.edges.cdp[weakest], np.sort(found.edges.cdp[found.of_kind(EdgeKind.LOST)])[:5])


@pytest.mark.parametrize("size", [16, 30])
@pytest.mark.parametrize("blur_px", [0.0, 0.7])
def test_an_image_of_noise_has_no_edges(size, blur_px):
    # The chance of an edge is 1 % an image, so that 1 in 4 images fails in 4 % of all seeds.
    for seed in range(4):
        noise = np.random.default_rng(seed).normal(size=(320, 400))
        noise = gaussian_filter(noise, blur_px) if blur_px else noise
        found = contrast_map(_map(100 + 15 * noise / noise.std()), ContrastMapSettings(size))
        assert found.count(EdgeKind.NOISE, EdgeKind.SMALL) == found.edges.kind.size
        assert np.isnan(found.edges.cdp).all()
        assert np.isnan(found.detected_share)
        assert (found.noise.inflation > 3) == (blur_px > 0)
        assert any("correlated from pixel to pixel" in one for one in found.warnings) == (blur_px > 0)


def test_contrasts_of_noise_are_as_large_as_stated():
    # Borders laid by the noise of the pixels they are judged by would raise this to 1.4 and 1.2.
    for size in (16, 40):
        found = contrast_map(_map(np.random.default_rng(5).normal(100, 15, (500, 600))), ContrastMapSettings(size))
        ratios = found.edges.contrast / found.edges.contrast_standard_uncertainty * sqrt(found.noise.inflation)
        assert 0.88 < sqrt(np.nanmean(np.square(ratios))) < 1.12


def test_an_exact_power_of_two_in_the_unit_changes_nothing():
    image = _halves(noise=10.0).astype(np.float32)
    one, other = (contrast_map(_map(image * np.float32(factor))) for factor in (1, 1024))
    assert np.array_equal(one.regions.labels, other.regions.labels)
    for name in ("kind", "contrast", "cdp", "cdp_low", "cdp_high"):
        assert np.array_equal(getattr(one.edges, name), getattr(other.edges, name), equal_nan=True)


def test_each_edge_is_of_one_kind():
    rng = np.random.default_rng(0)
    image = np.full((480, 640), 100.0)
    image[:, 160:320] = 103.0  # faint
    image[:, 320:480] = 3000.0  # saturated
    image[:, 480:] = -0.5  # black
    image += rng.normal(0, 2, image.shape)
    invalid = np.where(image > 2900, Invalid.SATURATED, 0).astype(np.uint8)
    found = contrast_map(_map(image, invalid=invalid))
    assert sum(found.count(kind) for kind in EdgeKind) == found.edges.kind.size
    x = np.where(found.of_kind(EdgeKind.SMALL), np.nan, found.edges.middle_px[:, 0])
    for kind, place in ((EdgeKind.FAINT, 160), (EdgeKind.SATURATED, 320), (EdgeKind.SATURATED, 480)):
        assert set(found.edges.kind[np.abs(x - place) < 1]) == {kind}
    black = found.edges.kind[x > 540]
    # Contrasts of nothing to nothing are not defined.
    assert set(black) == {EdgeKind.BLACK}
    assert np.isnan(found.edges.contrast[x > 540]).all()
    assert np.isnan(found.edges.cdp[np.abs(x - 320) < 1]).all()
    assert found.regions.saturated_share.max() == 1.0
    assert np.isnan(found.detected_share)


def test_an_edge_of_a_region_of_two_surfaces_is_not_blamed_on_noise():
    image = np.full((400, 480), 100.0)
    # Stripes of 4 pixels are too fine for regions of 40.
    image[:, 249:] = np.where(np.arange(231) // 4 % 2, 110.0, 390.0)
    image += np.random.default_rng(0).normal(0, 1, image.shape)
    found = contrast_map(_map(image))
    assert EdgeKind.UNEVEN in found.edges.kind[_across(found)]
    assert found.count(EdgeKind.LOST) == 0


def test_the_least_contrast_divides_faint_from_judged():
    image = _halves(bright=112.0, noise=2.0)
    for least, kinds in ((0.11, {EdgeKind.SEEN}), (0.13, {EdgeKind.FAINT})):
        found = contrast_map(_map(image), ContrastMapSettings(minimum_contrast=least))
        assert set(found.edges.kind[_across(found)]) == kinds


def test_errors_alike_for_neighbours_cancel_and_others_count():
    image = _halves(noise=14.0)
    plain = contrast_map(_map(image))
    alike = contrast_map(_map(image, (CommonError("meter", 0.05), CommonError("fit", np.full(image.shape, 0.05)))))
    pattern = np.where(np.arange(480) >= 249, 0.04, 0.01) * np.ones((400, 1))
    errors = (CommonError("fit", pattern), CommonError("dark", -pattern / 3))
    differing = contrast_map(_map(image, errors))
    edges, across = plain.edges, _across(plain)
    for name in ("contrast_standard_uncertainty", "cdp_standard_error"):
        assert getattr(alike.edges, name)[across] == pytest.approx(getattr(edges, name)[across], rel=1e-9)
    added = 0.03 * sqrt(1 + 1 / 9) * (1 + edges.contrast[across])
    # A few pixels of the regions are on the other side of the step.
    expected = np.hypot(edges.contrast_standard_uncertainty[across], added)
    assert differing.edges.contrast_standard_uncertainty[across] == pytest.approx(expected, rel=0.02)
    edge = across[3]
    bright, dark = (_pixels(plain, image, side[edge]) for side in (edges.bright, edges.dark))
    one = cdp_with_common_errors(
        bright, dark, float(edges.contrast[edge]), errors=[(0.04, 0.01), (-0.04 / 3, -0.01 / 3)]
    )
    by_calibration = sqrt(differing.edges.cdp_standard_error[edge] ** 2 - edges.cdp_standard_error[edge] ** 2)
    assert by_calibration == pytest.approx(one.calibration_standard_uncertainty, rel=0.1)


def test_an_error_of_the_darkness_counts_by_the_light_of_a_region():
    image = _halves(dark=20.0, bright=60.0, noise=8.0)
    # 0.5 cd/m^2 alike in all pixels; some of them have hardly any light.
    with_dark = contrast_map(_map(image, (CommonError("dark", 0.5 / image),)))
    plain = contrast_map(_map(image)).edges
    across = _across(with_dark)
    added = (0.5 / 20 - 0.5 / 60) * (1 + plain.contrast[across])
    expected = np.hypot(plain.contrast_standard_uncertainty[across], added)
    assert with_dark.edges.contrast_standard_uncertainty[across] == pytest.approx(expected, rel=0.03)
    assert (with_dark.edges.cdp_standard_error[across] >= plain.cdp_standard_error[across]).all()


def test_a_map_of_every_second_pixel_has_regions_of_the_size_in_the_image():
    image = _halves()
    found = contrast_map(_map(image, step=2), ContrastMapSettings(80))
    assert np.array_equal(found.regions.labels, contrast_map(_map(image)).regions.labels)
    with pytest.raises(InputError, match=r"regions of 12 pixels have 6 of each colour plane .* give 20 or more"):
        contrast_map(_map(image, step=2), ContrastMapSettings(12))


def test_pixels_that_are_not_finite_are_left_out():
    image = _halves(noise=3.0)
    spoilt = image.copy()
    spoilt[::7, ::11] = np.nan
    found = contrast_map(_map(spoilt))
    assert found.count(EdgeKind.SEEN) >= 8
    assert np.isfinite(found.regions.mean).all()


def test_where_noise_hides_the_least_contrast_is_told():
    image = _halves(bright=400.0, noise=60.0)
    found = contrast_map(_map(image))
    blind = found.edges.least_told > 0.1
    assert found.blind_share == pytest.approx(blind[~found.of_kind(EdgeKind.SMALL)].mean())
    assert "could not be told from noise: give larger regions" in found.warnings[-1]
    assert replace(found, settings=ContrastMapSettings(minimum_contrast=1.0)).blind_share == 0


def test_regions_too_small_to_judge_are_counted():
    image = _halves(noise=3.0, shape=(200, 240))
    image[:, 60:64] = 400.0
    found = contrast_map(_map(image), ContrastMapSettings(10))
    small = np.minimum(found.regions.n_pixels[found.edges.bright], found.regions.n_pixels[found.edges.dark]) < 20
    short = found.edges.border_px < 10 / 8
    assert small.any()
    assert short.any()
    assert np.array_equal(small | short, found.of_kind(EdgeKind.SMALL))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size_px": 9}, "the size of the regions is 9 pixels: give 10 or more"),
        ({"minimum_contrast": 0.0}, r"the least contrast is 0.0: give a fraction above 0"),
        ({"detected": 1.5}, "the CDP of a detected edge is 1.5: give a fraction above 0, up to 1"),
        ({"epsilon": 2.0}, "epsilon is 2.0: give a fraction above 0, up to 1"),
    ],
)
def test_settings_out_of_range(changes, message):
    with pytest.raises(InputError, match=message):
        ContrastMapSettings(**changes)


@pytest.mark.parametrize(
    ("image", "kind"),
    [
        (np.zeros((60, 80)), EdgeKind.BLACK),
        (np.full((60, 80), 7.0), EdgeKind.NOISE),
        (np.full((12, 12), 7.0), None),
    ],
)
def test_images_without_noise_or_edges(image, kind):
    found = contrast_map(_map(image), ContrastMapSettings(10))
    assert set(found.edges.kind.tolist()) == (set() if kind is None else {kind})
    assert np.isnan(found.detected_share)
    assert found.weakest(3).size == 0


def test_steps_without_noise_are_seen_by_all_pairs():
    image = np.full((100, 160), 4.0)
    image[:, 83:] = 5.0
    found = contrast_map(_map(image), ContrastMapSettings(20))
    assert found.count(EdgeKind.SEEN) >= 4
    assert (found.edges.cdp[found.of_kind(EdgeKind.SEEN)] == 1).all()
    assert found.edges.contrast[found.of_kind(EdgeKind.SEEN)] == pytest.approx(0.25)
