"""The parts of a tracker: noise, alignment, search, scene changes, points."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.roi import Roi
from labcdp.tracking.alignment import Aligner
from labcdp.tracking.geometry import carried, inverse, shift, transform
from labcdp.tracking.scene import SceneWatch, common_motion
from labcdp.tracking.sight import Sight, view_around
from labcdp.tracking.template import make_template, place_uncertainty_px

from .simulated import pose

SIGN = Roi.rectangle("sign", 80, 60, 30, 24)


def scene(shape=(160, 200), seed=1, coarse=3.0):
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), coarse), None, 20, 220, cv2.NORM_MINMAX)


def rounded(light):
    return Sight(np.clip(np.rint(light), 0, 255).astype(np.uint8))


def aligned(template, light, start, margin, *known_light, planar=False):
    view = view_around(rounded(light), template.shape, template.to_image, margin)
    return Aligner(template, planar=planar).align(view, start, *known_light)


def test_a_place_is_found_as_well_as_the_bound_allows():
    """Spread over 30 frames, which is known to 1 / sqrt(60) = 13 %."""
    light, sigma_dn, rng = 50 + 0.5 * scene(coarse=4), 6.0, np.random.default_rng(2)
    template = make_template(rounded(light + sigma_dn * rng.standard_normal(light.shape)), SIGN)
    places = []
    for _ in range(30):
        fit = aligned(template, light + sigma_dn * rng.standard_normal(light.shape), template.to_image, 10)
        places.append(carried(SIGN, fit.to_image @ inverse(template.to_image)).centre)
    spread = np.linalg.eigvalsh(np.cov(np.array(places).T))[-1] ** 0.5
    # Scale and rotation are found as well, and the bound is for known ones and for Gaussian weights.
    assert 0.7 < spread / place_uncertainty_px(template) < 2.5


@pytest.mark.parametrize("planar", [False, True])
def test_the_light_does_not_move_a_region(planar):
    light = scene()
    template = make_template(rounded(light), SIGN)
    for gain, offset in ((1.0, 0.0), (0.4, 5.0), (0.5, 120.0)):
        fit = aligned(template, gain * light + offset, shift(3, -2) @ template.to_image, 20, planar=planar)
        assert fit.light[0] == pytest.approx(gain, rel=0.01)
        assert fit.quality > 0.98
        assert np.abs(transform(fit.to_image, template.corners) - SIGN.corners).max() < 0.1


def test_the_quality_is_the_share_of_structure_in_sight():
    light = scene(coarse=2)
    template = make_template(rounded(light), SIGN)
    (x0, _), (x1, _) = transform(template.to_image, np.array([(0.0, 0.0), (template.shape[1], 0.0)]))
    for share in (0.0, 0.2, 0.4):
        covered = np.where(np.arange(200) < round(x0 + share * (x1 - x0)), 255, light)
        fit = aligned(template, covered, template.to_image, 10, (1.0, 0.0))
        assert fit.quality == pytest.approx(1 - share, abs=0.08)


def test_the_motion_of_the_scene_is_known_whatever_the_light_and_after_another_scene():
    light = scene((300, 420), seed=5, coarse=4)
    watch = SceneWatch(rounded(light[20:260, 40:360]))
    first = watch.now
    for number in (3, 6, 9, 12):
        now = watch.look(rounded((1 - 0.05 * number) * light[20:260, 40 - number : 360 - number] + number))
        assert now.moved_since(first)[:2, 2] == pytest.approx((number, 0), abs=0.3)
    other = watch.look(rounded(scene((240, 320), seed=6, coarse=12)))
    assert other.moved_since(first) is None
    again = watch.look(rounded(light[20:260, 38:358]))
    assert again.moved_since(other) is None
    assert again.moved_since(first)[:2, 2] == pytest.approx((2, 0), abs=0.3)


@settings(max_examples=40)
@given(
    scale=st.floats(0.8, 1.25), angle=st.floats(-0.3, 0.3), x=st.floats(-9, 9), y=st.floats(-9, 9),
    seed=st.integers(0, 10**6),
)  # fmt: skip
def test_the_common_motion_does_not_mind_a_quarter_of_wrong_points(scale, angle, x, y, seed):
    rng = np.random.default_rng(seed)
    before = rng.uniform(0, 60, (40, 2))
    motion = shift(30, 30) @ pose(x, y, scale, angle) @ shift(-30, -30)
    after = transform(motion, before) + rng.normal(0, 0.02, before.shape)
    after[:10] += rng.uniform(-25, 25, (10, 2))
    corners = np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 60.0)])
    assert np.abs(transform(common_motion(before, after), corners) - transform(motion, corners)).max() < 0.2
