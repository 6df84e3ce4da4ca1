from math import sqrt

import cv2
import numpy as np
import pytest

from labcdp.evaluate.dn_rounding import rounding_uncertainty_dn
from labcdp.evaluate.light import picture_conversion
from labcdp.evaluate.pair import evaluate_pair, evaluate_region
from labcdp.roi import Roi
from labcdp.sources.picture import PictureOptions, read_picture

LEFT, RIGHT = Roi.rectangle("left", 0, 0, 30, 40), Roi.rectangle("right", 30, 0, 30, 40)
CAMERA = """
name = "any"
adc_bits = 8
black_dn = 0
pixel_pitch_m = 3.45e-6
quantum_efficiency = 0.55
k_dn_per_e = 0.02
f_number = 2.8
lens_transmittance = 0.9
spectrum = "D65"
"""


def _map(tmp_path, light, conversion=None):
    """Map of a picture of the light, in DN, rounded to 8 bits."""
    assert cv2.imwrite(str(tmp_path / "a.png"), np.rint(light).astype(np.uint8))
    conversion = conversion or picture_conversion(None, None, None)
    return conversion.luminance(read_picture(tmp_path / "a.png", PictureOptions(exposure_s=0.01)))


def _scene(left, right):
    return np.where(np.arange(60) < 30, left, right) * np.ones((40, 1))


@pytest.mark.parametrize("noise_dn", [0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 2.0])
def test_the_interval_of_a_mean_has_the_light_in_it(noise_dn):
    """With means anywhere between two DN; 3 sigma below 95 % of 500."""
    rng = np.random.default_rng(int(100 * noise_dn))
    covered = 0
    for mean in rng.uniform(10, 11, 500):
        dn = np.rint(mean + noise_dn * rng.normal(size=1000))
        uncertainty = np.hypot(rounding_uncertainty_dn(dn.std()), dn.std() / sqrt(1000))
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


def test_noise_of_a_dn_leaves_no_error_by_rounding(tmp_path):
    light = _scene(50.3, 40.4) + np.random.default_rng(1).normal(0, 1.0, (40, 60))
    found = evaluate_pair(_map(tmp_path, light), LEFT, RIGHT, (0.2,))
    assert found.results[0].calibration_standard_uncertainty == 0
    assert found.a.standard_uncertainty == pytest.approx(found.a.std / sqrt(1200), rel=1e-6)


def test_a_camera_specification_has_steps_of_luminance(tmp_path):
    (tmp_path / "camera.toml").write_text(CAMERA)
    conversion = picture_conversion(None, tmp_path / "camera.toml", None)
    relative, specified = (
        evaluate_pair(_map(tmp_path, _scene(6, 4), given), LEFT, RIGHT, (0.5,)) for given in (None, conversion)
    )
    assert specified.contrast.standard_error == pytest.approx(relative.contrast.standard_error, rel=1e-5)
