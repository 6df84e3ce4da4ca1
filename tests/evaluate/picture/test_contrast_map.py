"""Contrast maps: edges against brute force on their pixels and closed forms, and the files that say the same."""

from dataclasses import replace
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from openpyxl import load_workbook
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from labcdp.core.luminance import CommonError, Invalid
from labcdp.evaluate.picture.converter import PictureSource
from labcdp.evaluate.picture.edges.edges import ContrastMapSettings, EdgeKind
from labcdp.evaluate.picture.edges.map import contrast_map
from labcdp.evaluate.picture.edges.page import contrast_map_files
from labcdp.evaluate.picture.edges.result import KINDS, contrast_map_dataset, edge_table, map_result
from labcdp.metrics import DetectionInterval, cdp

from ...conftest import valid
from ...metrics.closed_forms import share_of_normal
from ...metrics.conftest import map_of
from ...output.test_results_folder import write


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


@pytest.mark.parametrize("epsilon", [0.5, 0.2, DetectionInterval.at_least(0.3)])
def test_contrast_and_cdp_of_an_edge_are_those_of_its_pixels(epsilon):
    image = _halves()
    found = contrast_map(map_of(image), ContrastMapSettings(epsilon=epsilon))
    edges = found.edges
    assert _across(found).size >= 8
    for edge in _across(found):
        bright, dark = (_pixels(found, image, side[edge]) for side in (edges.bright, edges.dark))
        assert edges.contrast[edge] == pytest.approx(bright.mean() / dark.mean() - 1, rel=1e-9)
        expected = cdp(bright, dark, float(edges.contrast[edge]), epsilon)
        assert edges.cdp[edge] == expected.cdp
        inflation = found.noise.inflation
        assert edges.cdp_standard_error[edge] == pytest.approx(expected.u * sqrt(inflation), rel=1e-9)
        of_means = sum(side.var(ddof=1) / side.size / side.mean() ** 2 for side in (bright, dark))
        assert edges.contrast_standard_uncertainty[edge] == pytest.approx(
            (1 + edges.contrast[edge]) * sqrt(inflation * of_means), rel=1e-9
        )


def test_cdp_and_its_interval_agree_with_the_closed_form_for_normal_noise():
    inside, seen, deviations = 0, 0, []
    for seed in range(3):
        found = contrast_map(map_of(_halves(noise=14.0, seed=seed)))
        for edge in _across(found):
            contrast = found.edges.contrast[edge]
            truth = share_of_normal((150, 14), (100, 14), 0.5 * contrast, 1.5 * contrast)
            deviations.append(found.edges.cdp[edge] - truth)
            inside += found.edges.cdp_low[edge] <= truth <= found.edges.cdp_high[edge]
            seen += 1
    # At least 16 independent pairs of regions, since an edge shares its regions with others.
    assert abs(np.mean(deviations)) < 4 * np.std(deviations) / 4
    assert np.std(deviations) < 0.02
    assert inside / seen > 0.85


@pytest.mark.parametrize("size", [16, 30])
@pytest.mark.parametrize("blur_px", [0.0, 0.7])
def test_an_image_of_noise_has_no_edges(size, blur_px):
    # The chance of an edge is 1 % an image, so that 1 in 4 images fails in 4 % of all seeds.
    for seed in range(4):
        noise = np.random.default_rng(seed).normal(size=(320, 400))
        noise = gaussian_filter(noise, blur_px) if blur_px else noise
        found = contrast_map(map_of(100 + 15 * noise / noise.std()), ContrastMapSettings(size))
        assert found.count(EdgeKind.NOISE, EdgeKind.SMALL) == found.edges.kind.size
        assert np.isnan(found.edges.cdp).all()
        assert np.isnan(found.detected_share)
        assert (found.noise.inflation > 3) == (blur_px > 0)
        assert ("correlated-noise" in {one.code for one in found.findings}) == (blur_px > 0)


def test_each_edge_is_of_one_kind():
    rng = np.random.default_rng(0)
    image = np.full((480, 640), 100.0)
    image[:, 160:320] = 103.0  # faint
    image[:, 320:480] = 3000.0  # saturated
    image[:, 480:] = -0.5  # black
    image += rng.normal(0, 2, image.shape)
    invalid = np.where(image > 2900, Invalid.SATURATED, 0).astype(np.uint8)
    found = contrast_map(map_of(image, invalid=invalid))
    assert sum(found.count(kind) for kind in EdgeKind) == found.edges.kind.size
    x = np.where(found.mask_of_kinds(EdgeKind.SMALL), np.nan, found.edges.middle_px[:, 0])
    for kind, place in ((EdgeKind.FAINT, 160), (EdgeKind.SATURATED, 320), (EdgeKind.SATURATED, 480)):
        assert set(found.edges.kind[np.abs(x - place) < 1]) == {kind}
    black = found.edges.kind[x > 540]
    # Contrasts of nothing to nothing are not defined.
    assert set(black) == {EdgeKind.BLACK}
    assert np.isnan(found.edges.contrast[x > 540]).all()
    assert np.isnan(found.edges.cdp[np.abs(x - 320) < 1]).all()
    assert found.regions.saturated_share.max() == 1.0
    assert np.isnan(found.detected_share)


def test_errors_alike_for_neighbours_cancel_and_others_count():
    image = _halves(noise=14.0)
    plain = contrast_map(map_of(image))
    alike = contrast_map(map_of(image, (CommonError("meter", 0.05), CommonError("fit", np.full(image.shape, 0.05)))))
    pattern = np.where(np.arange(480) >= 249, 0.04, 0.01) * np.ones((400, 1))
    differing = contrast_map(map_of(image, (CommonError("fit", pattern), CommonError("dark", -pattern / 3)))).edges
    edges, across = plain.edges, _across(plain)
    for name in ("contrast_standard_uncertainty", "cdp_standard_error"):
        assert getattr(alike.edges, name)[across] == pytest.approx(getattr(edges, name)[across], rel=1e-9)
    # A few pixels of the regions are on the other side of the step.
    added = 0.03 * sqrt(1 + 1 / 9) * (1 + edges.contrast[across])
    expected = np.hypot(edges.contrast_standard_uncertainty[across], added)
    assert differing.contrast_standard_uncertainty[across] == pytest.approx(expected, rel=0.02)
    edge = across[3]
    sides = (_pixels(plain, image, side[edge]) for side in (edges.bright, edges.dark))
    bright, dark = sides
    # Each error is added and subtracted; only its ratio in the two regions counts.
    changes = [
        cdp(bright * (1 + sign * x), dark * (1 + sign * y), float(edges.contrast[edge])).cdp - edges.cdp[edge]
        for x, y in ((np.hypot(0.03, 0.01), 0.0),)
        for sign in (1, -1)
    ]
    one = sqrt(np.mean(np.square(changes)))
    by_calibration = sqrt(differing.cdp_standard_error[edge] ** 2 - edges.cdp_standard_error[edge] ** 2)
    assert by_calibration == pytest.approx(one, rel=0.1)


def test_contrasts_of_a_texture_are_not_called_noise():
    """Clear against the noise of the pixels, and less than the texture of their regions."""
    stones = np.random.default_rng(1).uniform(0.3, 1.7, (50, 60)).repeat(8, axis=0).repeat(8, axis=1)
    found = contrast_map(map_of(_halves(dark=100.0, bright=160.0, noise=0.5) * stones))
    high = (found.edges.contrast > 0.1) & ~found.mask_of_kinds(EdgeKind.SMALL)
    assert high.sum() > 100
    assert set(found.edges.kind[high]) <= {EdgeKind.SEEN, EdgeKind.UNEVEN}


def test_shading_is_no_lost_edge_and_contrast_never_survives_a_veil():
    """Asked for 50 %: light that rises steadily, and a step of 50 % under a veil, which may also be shaded."""
    noise = 2 * np.random.default_rng(0).normal(size=(400, 480))
    y, x = np.mgrid[-1:1:400j, -1:1:480j]
    step, asked = np.where(np.arange(480) < 249, 100.0, 150.0), ContrastMapSettings(contrast=0.5)
    for light in (150 + 50 * x, 200 / (1 + x**2 + y**2) ** 2):
        found = contrast_map(map_of(light + noise), asked)
        assert (found.count(EdgeKind.SEEN), found.count(EdgeKind.LOST)) == (0, 0)
        assert found.count(EdgeKind.UNEVEN) > 100
    for veil, kind in (
        (0.0, EdgeKind.SEEN),
        (100.0, EdgeKind.LOST),
        (600.0, EdgeKind.LOST),
        (150 + 30 * y, EdgeKind.LOST),
    ):
        found = contrast_map(map_of(step + veil + noise), asked)
        assert set(found.edges.kind[_across(found)]) == {kind}
    # So faint that regions do not follow the step, which runs through those of one side.
    found = contrast_map(map_of(np.where(np.arange(480) < 256, 100.0, 150.0) + 1900 + noise), asked)
    assert set(found.edges.kind[_across(found, 256)]) == {EdgeKind.LOST}


def test_pixels_that_are_not_finite_are_left_out():
    image = _halves(noise=3.0)
    image[::7, ::11] = np.nan
    found = contrast_map(map_of(image))
    assert found.count(EdgeKind.SEEN) >= 8
    assert np.isfinite(found.regions.mean).all()


def test_several_contrasts_are_asked_of_the_same_edges():
    image, source = map_of(_halves(noise=3.0)), PictureSource(Path("a.png"), "0" * 64, (300, 340), "cd/m²", "c")
    found = contrast_map(image, ContrastMapSettings(30, contrast=(0.3, 0.5)))
    result = map_result(found, source)
    dataset = contrast_map_dataset(found, source, result)
    for row in result.table("contrasts").rows():
        alone = contrast_map(image, ContrastMapSettings(30, contrast=row["contrast"]))
        assert row["detected_share"] == alone.detected_share
        assert np.array_equal(dataset["cdp"].sel(contrast_to_detect=row["contrast"]), alone.edges.cdp, equal_nan=True)


def test_the_files_hold_the_edges_and_escape_names(tmp_path):
    levels = np.repeat([100.0, 200, 260], (130, 120, 90))
    image = levels + np.where(levels < 250, 4.0, 25.0) * np.random.default_rng(0).normal(size=(300, 340))
    found = contrast_map(map_of(image), ContrastMapSettings(30))
    source = PictureSource(Path("a <b>scene</b>.png"), "0" * 64, (300, 340), "cd/m²", "c")
    write(tmp_path, contrast_map_files(found, source, map_result(found, source)))
    values = valid((tmp_path / "results.json").read_text())
    said = {row["quantity"]: row["value"] for row in values["tables"]["summary"]["rows"]}
    seen, lost = found.count(EdgeKind.SEEN), found.count(EdgeKind.LOST)
    assert min(seen, lost) > 5
    assert said["detected edges"] == seen / (seen + lost)
    weakest = [row["cdp"] for row in values["tables"]["weakest"]["rows"]]
    assert weakest == sorted(found.edges.cdp[found.mask_of_kinds(EdgeKind.SEEN, EdgeKind.LOST)])[:10]
    head, *rows = load_workbook(tmp_path / "results.xlsx")["edges"].iter_rows(values_only=True)
    cdps = [row[head.index("CDP")] for row in rows if row[0] == "lost"]
    assert cdps == pytest.approx(sorted(found.edges.cdp[found.mask_of_kinds(EdgeKind.LOST)]), rel=1e-14)
    with xr.open_dataset(tmp_path / "results.nc") as read:
        assert np.array_equal(read["label"], found.regions.labels)
        for name, one in (("cdp", found.edges.cdp), ("region_mean", found.regions.mean), ("kind", found.edges.kind)):
            assert np.array_equal(read[name], one, equal_nan=True)
    assert "<b>scene" not in (tmp_path / "report.html").read_text()


def test_edges_that_are_not_above_their_u_come_last():
    levels = np.repeat([100.0, 200, 260], (130, 120, 90))
    image = levels + np.where(levels < 250, 4.0, 25.0) * np.random.default_rng(0).normal(size=(300, 340))
    found = contrast_map(map_of(image), ContrastMapSettings(30))
    weakest, u = found.weakest(10), found.edges.contrast_standard_uncertainty.copy()
    assert found.n_uncertain == 0
    # As by a vignetting that was not measured: U just above the contrast, and just below.
    u[weakest[:2]] = found.edges.contrast[weakest[:2]] / 1.96 * (1.01, 0.98)
    doubtful = replace(found, edges=replace(found.edges, contrast_standard_uncertainty=u))
    assert (doubtful.n_uncertain, weakest[0] in doubtful.weakest(10)) == (1, False)
    assert doubtful.weakest(9).tolist() == weakest[1:].tolist()
    source = PictureSource(Path("a.png"), "0" * 64, (300, 340), "cd/m²", "c")
    named = {finding.code: finding.values for finding in map_result(doubtful, source).findings}
    assert named["edges-uncertain"]["count"] == 1
    kind = found.edges.kind[weakest[0]]
    of_kind = [row for row in edge_table(doubtful, source).rows() if row["kind"] == KINDS[EdgeKind(kind)][0]]
    assert of_kind[-1]["cdp"] == found.edges.cdp[weakest[0]] == min(row["cdp"] for row in of_kind)
    # What a reference shows is evidence, however little is left of it.
    assert replace(doubtful, has_reference=True).n_uncertain == 0


def test_a_textured_picture_has_no_headline():
    """Fewer than a third of its borders in sight are judged; those of a plain step all are."""
    rng = np.random.default_rng(0)
    texture = gaussian_filter(rng.normal(size=(400, 480)), 5)
    textured = contrast_map(map_of(100 * np.exp(texture / texture.std()) + 2 * rng.normal(size=(400, 480))))
    assert textured.judged_share < 1 / 3
    assert "few-edges-judged" in {finding.code for finding in textured.findings}
    plain = contrast_map(map_of(_halves()))
    assert plain.judged_share > 0.9
    assert "few-edges-judged" not in {finding.code for finding in plain.findings}
    source = PictureSource(Path("texture.png"), "0" * 64, (400, 480), "cd/m²", "c")
    pages = [
        contrast_map_files(found, source, map_result(found, source))["report.html"].decode()
        for found in (textured, plain)
    ]
    assert ["too few judged" in page for page in pages] == [True, False]
