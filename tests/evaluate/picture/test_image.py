from dataclasses import replace
from datetime import UTC, datetime
from math import sqrt
from pathlib import Path

import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.luminance import CommonError, LuminanceMap, PixelErrors
from labcdp.core.result import Finding, info
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.image import ImageRequest, evaluate_image
from labcdp.evaluate.picture.neighbours import evaluate_neighbours
from labcdp.files.picture import Picture
from labcdp.metrics import cdp, cdp_neighbours_range

SHAPE = (60, 90)
BRIGHT, DARK = Roi.rectangle("bright", 50, 10, 30, 40), Roi.rectangle("dark", 5, 5, 30, 40)
CORNER = Roi.rectangle("corner", 0, 50, 9, 9)
CONVERSION = info("bits-scaled", bits=8, adc_bits=12)


def _scene(seed=0):
    luminance = np.random.default_rng(seed).normal(100.0, 5.0, SHAPE)
    luminance[:, 45:] += 100
    return luminance


def _map(luminance, common=(), **more):
    errors = PixelErrors(np.zeros(luminance.shape), **more)
    return LuminanceMap(luminance, errors, common, np.zeros(luminance.shape, dtype=np.uint8))


def _picture(luminance):
    light = luminance.astype(np.float32)
    return Picture(Path("night.exr"), "ab" * 32, None, light, True, "linear", (), None, None, False, False)


def _evaluate(request, luminance=None, **more):
    values = _scene() if luminance is None else luminance
    return evaluate_image(_picture(values), _map(values, **more), "cd/m^2", request, (CONVERSION,))


def _near(values, contrast):
    return cdp_neighbours_range(values, (contrast,))[0]


def test_pairs_of_all_regions_with_their_numbers():
    request = ImageRequest((1.0, 2.0), 0.5, (BRIGHT, DARK, CORNER))
    found = _evaluate(request)
    assert [(pair.result.a.roi.name, pair.result.b.roi.name) for pair in found.pairs] == [
        ("bright", "dark"),
        ("bright", "corner"),
        ("dark", "corner"),
    ]
    expected = cdp(BRIGHT.select(_scene()), DARK.select(_scene()), 2.0)
    assert found.pairs[0].result.results[1].result.cdp == expected.cdp
    assert found.pairs[0].name == "bright / dark"
    assert [region.roi for region in found.regions] == [BRIGHT, DARK, CORNER]
    small = info("region-correlation-unknown", "corner", pixels=81, recommended=200)
    assert found.findings == (CONVERSION, small)
    assert (found.shape, found.unit, found.exposure_s) == (SHAPE, "cd/m²", None)
    assert found.neighbours is None


def test_the_picture_of_a_simulated_camera_says_so():
    frame = Frame(
        dn=np.rint(_scene()).astype(np.uint8),
        exposure_s=0.008,
        gain_db=0.0,
        bit_depth=8,
        saturation_dn=255.0,
        black_level_dn=0.0,
        pixel_format="Mono8",
        colour_filter=None,
        temperature_c=None,
        timestamp=datetime(2026, 3, 2, tzinfo=UTC),
        camera_timestamp_ns=0,
        frame_id=1,
        camera=CameraIdentity("Allied Vision", "Manta", "1", simulated=True),
    )
    taken = replace(
        _picture(_scene()), frame=frame, light=None, camera_stated=True, exposure_stated=True, exposure_known=True
    )
    found = evaluate_image(taken, _map(_scene()), "relative", ImageRequest((1.0,), 0.5, (BRIGHT, DARK)))
    assert (found.findings, found.simulated) == ((info("camera-simulated"),), True)
    assert found.camera == "Allied Vision Manta (1, simulated)"
    assert found.exposure_s == 0.008


def test_the_distribution_of_the_contrasts_is_that_of_all_pairs():
    found = _evaluate(ImageRequest((1.0,), 0.5, (BRIGHT, DARK))).pairs[0].distribution
    a, b = BRIGHT.select(_scene()), DARK.select(_scene())
    contrasts = (a[:, None] / b - 1).ravel()
    middle = len(found.edges) // 2
    assert found.cumulative[middle] == np.mean(contrasts <= found.edges[middle])


def test_without_contrasts_the_measured_one_of_each_pair_is_used():
    found = _evaluate(ImageRequest(None, 0.5, (BRIGHT, DARK, CORNER), neighbours=True))
    for pair in found.pairs[:2]:
        (one,) = pair.result.results
        assert one.result.contrast == pair.result.contrast.value
        assert (
            one.result.cdp == cdp(BRIGHT.select(_scene()), pair.result.b.roi.select(_scene()), one.result.contrast).cdp
        )
    assert found.pairs[0].result.results[0].result.cdp > 0.9
    values = _scene()
    pairs = [np.sort(both, axis=0) for both in ((values[:, 1:], values[:, :-1]), (values[1:], values[:-1]))]
    measured = sum(both[1].sum() for both in pairs) / sum(both[0].sum() for both in pairs) - 1
    assert found.neighbours.contrast == pytest.approx(measured)
    assert found.neighbours.results[0].result == _near(values, found.neighbours.contrast)
    for corners in ((3, 4, 40, 30), (40, 30, 3, 4), (3, 30, 40, 4)):
        inside = evaluate_neighbours(_map(values), (0.05,), 0.5, corners)
        assert (inside.results[0].result, inside.rectangle) == (_near(values[4:31, 3:41], 0.05), (3, 4, 40, 30))
    codes = [(one.code, one.severity) for one in found.findings]
    assert ("contrast-is-measured", "info") in codes
    assert ("neighbour-contrast-is-measured", "info") in codes


@pytest.mark.parametrize(
    ("rois", "more", "message"),
    [
        ((), {}, r"no evaluation was chosen: give regions, or ask for the nearest-neighbour CDP"),
        ((DARK,), {}, r"region 'dark' is alone: a contrast needs two regions"),
        ((DARK, BRIGHT), {"pairs": (("dark", "dark"),)}, r"region 'dark' is paired with itself: give two regions"),
        (
            tuple(Roi.rectangle(f"r{n}", 10 * n, 0, 5, 5) for n in range(7)),
            {},
            r"7 regions make 21 pairs: choose pairs among r0, r1, r2, r3, r4, r5, r6",
        ),
    ],
)
def test_requests_that_ask_nothing_are_refused(rois, more, message):
    with pytest.raises(InputError, match=message):
        ImageRequest((1.0,), 0.5, rois, **more)


def test_a_shared_factor_cancels_between_neighbours_and_an_offset_does_not():
    luminance = _scene() - 80
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
    luminance = np.rint(_scene()[:, :45] - 90)
    found = evaluate_neighbours(_map(luminance), (0.5,)).distribution
    contrasts, undefined, unbounded = [], 0, 0
    for y in range(60):
        for x in range(45):
            for other in ([luminance[y, x + 1]] if x < 44 else []) + ([luminance[y + 1, x]] if y < 59 else []):
                small, large = sorted((luminance[y, x], other))
                if large <= 0:
                    undefined += 1
                elif small <= 0:
                    unbounded += 1
                else:
                    contrasts.append(np.float32(large / small - 1))
    pairs = 60 * 44 + 59 * 45
    assert found.undefined == undefined / pairs
    assert found.unbounded == unbounded / pairs
    assert unbounded > 0
    for k in np.linspace(0, found.edges.size - 1, 4).astype(int):
        edge = np.float32(found.edges[k])
        expected = (undefined + sum(c <= edge for c in contrasts)) / pairs
        assert found.cumulative[k] == pytest.approx(expected, abs=1e-12)


def test_chosen_pairs_are_evaluated_once_and_their_order_is_checked():
    request = ImageRequest((1.0,), 0.5, (BRIGHT, DARK, CORNER), (("dark", "bright"), ("bright", "dark")))
    found = _evaluate(request)
    assert len(found.pairs) == 1
    assert found.pairs[0].name == "bright / dark"
    assert found.findings[0] == Finding("pair-swapped", values={"bright": "bright", "dark": "dark"})
    # A region of no pair has its luminance and SNR all the same.
    assert found.regions[2].n_pixels == 81


def test_a_measured_contrast_that_is_not_defined_has_no_cdp():
    luminance = np.zeros(SHAPE)
    luminance[:, 45:] = 1.0
    found = _evaluate(ImageRequest(None, 0.5, (BRIGHT, DARK), neighbours=True, rectangle=(0, 0, 20, 20)), luminance + 1)
    assert found.neighbours.results == ()
    assert [one.subject for one in found.findings if one.code == "contrast-undefined"] == ["nearest-neighbour"]
    dark = _evaluate(ImageRequest(None, 0.5, (BRIGHT, DARK)), luminance)
    assert dark.pairs[0].result.results == ()
    assert dark.findings[0] == Finding("contrast-undefined", subject="bright / dark")
