"""Rounding to DN: means between two of them, and contrasts that lie exactly on an end of the interval."""

from fractions import Fraction
from math import sqrt

import cv2
import numpy as np
import pytest

from labcdp.core.roi import Roi
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.evaluate.picture.image import ImageRequest, evaluate_image
from labcdp.files.read import PictureOptions, read_picture
from labcdp.metrics.pair import evaluate_pair
from labcdp.metrics.region import rounding_uncertainty

#: Few enough values that many pairs of them have the contrasts 1/2, 1 or 3/2, the middle and ends of the intervals.
DN = (21, 28, 42, 49, 63, 70, 98, 105, 147, 245)


def share(pairs, contrast):
    """Share of pairs of integers whose Weber contrast is from half to one and a half times the one asked for."""
    contrasts = [Fraction(int(large), int(small)) - 1 for large, small in pairs]
    return float(Fraction(sum(contrast / 2 <= one <= contrast * Fraction(3, 2) for one in contrasts), len(contrasts)))


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("camera", ["none", "of 12 bits", "of the depth of the file, with a black level"])
def test_cdp_as_by_brute_force_on_the_integers(tmp_path, bits, camera):
    rng = np.random.default_rng(bits)
    dn = np.concatenate([rng.choice(DN[:7], (12, 10)), rng.choice(DN[3:], (12, 10))], axis=1)
    assert cv2.imwrite(str(tmp_path / "a.png"), dn.astype(np.uint8 if bits == 8 else np.uint16))
    black_dn = 7 if "black" in camera else 0
    (tmp_path / "camera.toml").write_text(
        f'name = "any"\nadc_bits = {bits if black_dn else 12}\nblack_dn = {black_dn}\npixel_pitch_m = 3.45e-6\n'
        "quantum_efficiency = 0.55\nk_dn_per_e = 0.23\nf_number = 2.8\nlens_transmittance = 0.9\nspectrum = 'D65'\n"
    )
    conversion = picture_conversion(None, None if camera == "none" else tmp_path / "camera.toml", None)
    picture = read_picture(tmp_path / "a.png", PictureOptions(bit_depth=bits, exposure_s=0.0031))
    contrasts = (Fraction(1, 2), Fraction(1), Fraction(3))
    rois = Roi.rectangle("dark", 0, 0, 10, 12), Roi.rectangle("bright", 10, 0, 10, 12)
    request = ImageRequest(tuple(map(float, contrasts)), 0.5, rois, neighbours=True)
    found = evaluate_image(conversion.luminance(picture), conversion.source(picture), request)
    dn = dn - black_dn
    near = [*zip(dn[:, :-1].flat, dn[:, 1:].flat, strict=True), *zip(dn[:-1].flat, dn[1:].flat, strict=True)]
    near = [(max(pair), min(pair)) for pair in near]
    far = [(bright, dark) for bright in dn[:, 10:].flat for dark in dn[:, :10].flat]
    assert [one.result.cdp for one in found.neighbours.results] == [share(near, one) for one in contrasts]
    expected = [share(far, one) for one in contrasts]
    assert [one.result.cdp for one in found.pairs[0].results] == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("noise_dn", [0.0, 0.1, 0.3, 0.5, 2.0])
def test_the_interval_of_a_mean_has_the_light_in_it(noise_dn):
    """With means anywhere between two DN; 3 sigma below 95 % of 500."""
    rng = np.random.default_rng(int(100 * noise_dn))
    means = rng.uniform(10, 11, 500)
    dn = np.rint(means[:, None] + noise_dn * rng.normal(size=(500, 1000)))
    uncertainty = [np.hypot(rounding_uncertainty(one.std(), 1.0), one.std() / sqrt(1000)) for one in dn]
    covered = np.mean(abs(dn.mean(axis=1) - means) <= 1.96 * np.array(uncertainty))
    assert covered >= 0.95 - 3 * sqrt(0.95 * 0.05 / 500)


def test_flat_regions_state_the_rounding_of_each(tmp_path):
    light = np.where(np.arange(60) < 30, 5.6, 4.4) * np.ones((40, 1))
    assert cv2.imwrite(str(tmp_path / "a.png"), np.rint(light).astype(np.uint8))
    seen = picture_conversion(None, None, None).luminance(read_picture(tmp_path / "a.png", PictureOptions()))
    left, right = Roi.rectangle("left", 0, 0, 30, 40), Roi.rectangle("right", 30, 0, 30, 40)
    found = evaluate_pair(seen, left, right, (0.5, 1.0))
    assert found.a.standard_uncertainty == pytest.approx(1 / 256 / sqrt(12), rel=1e-6)
    assert found.contrast.value == 0.5
    assert found.contrast.standard_error == pytest.approx(1.5 / sqrt(12) * np.hypot(1 / 6, 1 / 4), rel=1e-6)
    assert abs(5.6 / 4.4 - 1 - found.contrast.value) < 1.96 * found.contrast.standard_error
    # Of a contrast of 100 % the lower end, 50 %, is just met.
    assert found.results[1].result.cdp == 1
    assert found.results[1].calibration_standard_uncertainty > 0.5
