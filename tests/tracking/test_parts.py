"""The parts of a tracker: noise, alignment, search, scene changes, points."""

import cv2
import numpy as np
import pytest

from labcdp.core.roi import Roi
from labcdp.tracking.alignment import Aligner
from labcdp.tracking.geometry import carried, inverse, transform
from labcdp.tracking.scene import SceneWatch
from labcdp.tracking.sight import Sight, view_around
from labcdp.tracking.template import make_template, place_uncertainty_px

SIGN = Roi.rectangle("sign", 80, 60, 30, 24)


def scene(shape=(160, 200), seed=1, coarse=3.0):
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), coarse), None, 20, 220, cv2.NORM_MINMAX)


def rounded(light):
    return Sight(np.clip(np.rint(light), 0, 255).astype(np.uint8))


def aligned(template, light, start, margin, *known_light):
    view = view_around(rounded(light), template.shape, template.to_image, margin)
    return Aligner(template, planar=False).align(view, start, *known_light)


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
