from functools import partial
from math import sqrt
from pathlib import Path

import numpy as np
import pytest

from labcdp.core.luminance import CommonError
from labcdp.core.result import Finding, info
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.evaluate.picture.figures import distribution_of
from labcdp.evaluate.picture.image import ImageRequest, evaluate_image
from labcdp.evaluate.picture.neighbours import evaluate_neighbours
from labcdp.files.picture import ExifFacts, Picture
from labcdp.metrics import cdp, cdp_neighbours_range

from ...metrics.conftest import map_of

SHAPE = (60, 90)
BRIGHT, DARK = Roi.rectangle("bright", 50, 10, 30, 40), Roi.rectangle("dark", 5, 5, 30, 40)
CORNER = Roi.rectangle("corner", 0, 50, 9, 9)
SCENE = np.random.default_rng(0).normal(100.0, 5.0, SHAPE) + 100 * (np.arange(90) >= 45)


_map = partial(map_of, random_rel=0.0)


def _evaluate(request, luminance=SCENE):
    light = luminance.astype(np.float32)
    picture = Picture(Path("night.exr"), "ab" * 32, ExifFacts(), None, light, True)
    return evaluate_image(_map(luminance), picture_conversion(None, None, None).source(picture), request)


def _near(values, contrast):
    return cdp_neighbours_range(values, (contrast,))[0]


def test_all_pairs_or_the_chosen_ones_each_once_with_their_numbers():
    found = _evaluate(ImageRequest((1.0, 2.0), 0.5, (BRIGHT, DARK, CORNER)))
    assert [pair.name for pair in found.pairs] == ["bright / dark", "bright / corner", "dark / corner"]
    a, b = BRIGHT.select(SCENE), DARK.select(SCENE)
    assert found.pairs[0].results[1].result.cdp == cdp(a, b, 2.0).cdp
    assert found.findings == (info("region-correlation-unknown", "corner", pixels=81, recommended=200),)
    distribution, contrasts = distribution_of(found.pairs[0], _map(SCENE)), (a[:, None] / b - 1).ravel()
    middle = len(distribution.edges) // 2
    assert distribution.cumulative[middle] == np.mean(contrasts <= distribution.edges[middle])
    chosen = _evaluate(ImageRequest((1.0,), 0.5, (BRIGHT, DARK, CORNER), (("dark", "bright"), ("bright", "dark"))))
    assert [pair.name for pair in chosen.pairs] == ["bright / dark"]
    assert chosen.findings[0] == Finding("pair-swapped", values={"bright": "bright", "dark": "dark"})
    # A region of no pair has its luminance and SNR all the same.
    assert [region.roi for region in chosen.regions] == [BRIGHT, DARK, CORNER]


def test_without_contrasts_the_measured_one_of_each_pair_is_used():
    found = _evaluate(ImageRequest(None, 0.5, (BRIGHT, DARK, CORNER), neighbours=True))
    for pair in found.pairs[:2]:
        (one,) = pair.results
        assert one.result.contrast == pair.contrast.value
        assert one.result.cdp == cdp(BRIGHT.select(SCENE), pair.b.roi.select(SCENE), one.result.contrast).cdp
    assert found.pairs[0].results[0].result.cdp > 0.9
    pairs = [np.sort(both, axis=0) for both in ((SCENE[:, 1:], SCENE[:, :-1]), (SCENE[1:], SCENE[:-1]))]
    measured = sum(both[1].sum() for both in pairs) / sum(both[0].sum() for both in pairs) - 1
    assert found.neighbours.contrast == pytest.approx(measured)
    assert found.neighbours.results[0].result == _near(SCENE, found.neighbours.contrast)
    for corners in ((3, 4, 40, 30), (40, 30, 3, 4), (3, 30, 40, 4)):
        inside = evaluate_neighbours(_map(SCENE), (0.05,), 0.5, corners)
        assert (inside.results[0].result, inside.rectangle) == (_near(SCENE[4:31, 3:41], 0.05), (3, 4, 40, 30))
    assert {"contrast-is-measured", "neighbour-contrast-is-measured"} < {one.code for one in found.findings}


def test_a_measured_contrast_that_is_not_defined_has_no_cdp():
    half = (np.arange(90) >= 45) * np.ones((60, 1))
    assert (
        _evaluate(ImageRequest(None, 0.5, neighbours=True, rectangle=(0, 0, 20, 20)), half + 1).neighbours.results == ()
    )
    dark = _evaluate(ImageRequest(None, 0.5, (BRIGHT, DARK)), half)
    assert dark.pairs[0].results == ()
    assert dark.findings[0] == Finding("contrast-undefined", subject="bright / dark")


def test_a_shared_factor_cancels_between_neighbours_and_an_offset_does_not():
    luminance = SCENE - 80
    scale = evaluate_neighbours(_map(luminance, (CommonError("scale", 0.2),), slow_rel=0.1), (0.2,)).results[0]
    assert scale.calibration_standard_uncertainty == 0
    assert scale.standard_uncertainty == scale.result.standard_error
    offset = _map(luminance, (CommonError("offset", 0.7 / luminance),))
    found = evaluate_neighbours(offset, (0.2,)).results[0]
    changes = [_near(luminance + s * 0.7, 0.2).cdp - found.result.cdp for s in (1, -1)]
    assert found.calibration_standard_uncertainty == pytest.approx(sqrt(np.mean(np.square(changes))))
    assert found.confidence_interval[1] > found.result.confidence_interval[1]
    slow = evaluate_neighbours(_map(luminance, slow_cd_m2=0.7), (0.2,)).results[0]
    assert slow.calibration_standard_uncertainty == pytest.approx(found.calibration_standard_uncertainty)


def test_the_contrasts_of_all_neighbours_are_counted():
    luminance = np.rint(SCENE[:, :45] - 90)
    found = distribution_of(evaluate_neighbours(_map(luminance), (0.5,)), _map(luminance))
    pairs = [
        *zip(luminance[:, 1:].flat, luminance[:, :-1].flat, strict=True),
        *zip(luminance[1:].flat, luminance[:-1].flat, strict=True),
    ]
    undefined = sum(max(pair) <= 0 for pair in pairs)
    unbounded = sum(min(pair) <= 0 < max(pair) for pair in pairs)
    contrasts = np.array([max(pair) / min(pair) - 1 for pair in pairs if min(pair) > 0], np.float32)
    assert (found.undefined, found.unbounded) == (undefined / len(pairs), unbounded / len(pairs))
    assert unbounded > 0
    for k in np.linspace(0, found.edges.size - 1, 4).astype(int):
        expected = (undefined + (contrasts <= np.float32(found.edges[k])).sum()) / len(pairs)
        assert found.cumulative[k] == pytest.approx(expected, abs=1e-12)
