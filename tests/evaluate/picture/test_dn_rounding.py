from math import sqrt

import cv2
import numpy as np
import pytest

from labcdp.core.roi import Roi
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.files.read import PictureOptions, read_picture
from labcdp.metrics.pair import evaluate_pair, evaluate_region
from labcdp.metrics.region import rounding_uncertainty

LEFT, RIGHT = Roi.rectangle("left", 0, 0, 30, 40), Roi.rectangle("right", 30, 0, 30, 40)


def _map(tmp_path, light, conversion=None):
    """Map of a picture of the light, in DN, rounded to 8 bits."""
    assert cv2.imwrite(str(tmp_path / "a.png"), np.rint(light).astype(np.uint8))
    conversion = conversion or picture_conversion(None, None, None)
    return conversion.luminance(read_picture(tmp_path / "a.png", PictureOptions(exposure_s=0.01)))


def _scene(left, right):
    return np.where(np.arange(60) < 30, left, right) * np.ones((40, 1))


@pytest.mark.parametrize("noise_dn", [0.0, 0.1, 0.3, 0.5, 2.0])
def test_the_interval_of_a_mean_has_the_light_in_it(noise_dn):
    """With means anywhere between two DN; 3 sigma below 95 % of 500."""
    rng = np.random.default_rng(int(100 * noise_dn))
    covered = 0
    for mean in rng.uniform(10, 11, 500):
        dn = np.rint(mean + noise_dn * rng.normal(size=1000))
        uncertainty = np.hypot(rounding_uncertainty(dn.std(), 1.0), dn.std() / sqrt(1000))
        covered += abs(dn.mean() - mean) <= 1.96 * uncertainty
    assert covered / 500 >= 0.95 - 3 * sqrt(0.95 * 0.05 / 500)


def test_flat_regions_state_the_rounding_of_each(tmp_path):
    found = evaluate_pair(_map(tmp_path, _scene(5.6, 4.4)), LEFT, RIGHT, (0.5, 1.0))
    step = 1 / 256
    assert found.a.standard_uncertainty == pytest.approx(step / sqrt(12), rel=1e-6)
    assert evaluate_region(_map(tmp_path, _scene(5.6, 4.4)), LEFT).standard_uncertainty == found.a.standard_uncertainty
    assert found.contrast.value == 0.5
    assert found.contrast.standard_error == pytest.approx(1.5 / sqrt(12) * np.hypot(1 / 6, 1 / 4), rel=1e-6)
    assert abs(5.6 / 4.4 - 1 - found.contrast.value) < 1.96 * found.contrast.standard_error
    # Of a contrast of 100 % the lower end, 50 %, is just met.
    assert found.results[1].result.cdp == 1
    assert found.results[1].calibration_standard_uncertainty > 0.5
