"""The parts of a tracker: noise, alignment, search, scene changes, points."""

import cv2
import numpy as np

from labcdp.core.roi import Roi
from labcdp.tracking.alignment import Aligner
from labcdp.tracking.geometry import carried, inverse
from labcdp.tracking.sight import Sight, view_around
from labcdp.tracking.template import make_template, place_uncertainty_px

SIGN = Roi.rectangle("sign", 80, 60, 30, 24)


def scene(shape=(160, 200), seed=1, coarse=3.0):
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), coarse), None, 20, 220, cv2.NORM_MINMAX)


def rounded(light):
    return Sight(np.clip(np.rint(light), 0, 255).astype(np.uint8))


def test_a_place_is_found_as_well_as_the_bound_allows():
    """Spread over 30 frames, which is known to 1 / sqrt(60) = 13 %."""
    light, sigma_dn, rng = 50 + 0.5 * scene(coarse=4), 6.0, np.random.default_rng(2)
    template = make_template(rounded(light + sigma_dn * rng.standard_normal(light.shape)), SIGN)
    places = []
    for _ in range(30):
        now = rounded(light + sigma_dn * rng.standard_normal(light.shape))
        view = view_around(now, template.shape, template.to_image, 10)
        fit = Aligner(template, planar=False).align(view, template.to_image)
        places.append(carried(SIGN, fit.to_image @ inverse(template.to_image)).centre)
    spread = np.linalg.eigvalsh(np.cov(np.array(places).T))[-1] ** 0.5
    # Scale and rotation are found as well, and the bound is for known ones and for Gaussian weights.
    assert 0.7 < spread / place_uncertainty_px(template) < 2.5
