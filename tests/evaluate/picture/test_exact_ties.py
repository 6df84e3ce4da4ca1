"""Contrasts of two integers that lie exactly on an end of the interval, through a picture file."""

from fractions import Fraction

import cv2
import numpy as np
import pytest

from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.evaluate.picture.image import ImageRequest, evaluate_image
from labcdp.files.read import PictureOptions, read_picture
from labcdp.metrics import cdp_neighbours
from labcdp.regions import RectangleShape

#: Few enough values that many pairs of them have the contrasts 1/2, 1 or 3/2, the middle and ends of the intervals.
DN = (21, 28, 42, 49, 63, 70, 98, 105, 147, 245)


def detected(larger, smaller, contrast):
    """Whether the Weber contrast of two integers lies from half to one and a half times the one asked for."""
    return contrast / 2 <= Fraction(int(larger), int(smaller)) - 1 <= contrast * Fraction(3, 2)


@pytest.fixture(params=[8, 12, 16])
def picture(request, tmp_path):
    """A picture of so many bits, whose right half is brighter."""
    rng = np.random.default_rng(request.param)
    dn = np.concatenate([rng.choice(DN[:7], (12, 10)), rng.choice(DN[3:], (12, 10))], axis=1)
    dn = dn.astype(np.uint8 if request.param == 8 else np.uint16)
    assert cv2.imwrite(str(tmp_path / "a.png"), dn)
    return dn, read_picture(tmp_path / "a.png", PictureOptions(bit_depth=request.param, exposure_s=0.0031))


@pytest.fixture(params=["relative", "12 bits", "depth of the file, black"])
def conversion(request, picture, tmp_path):
    """Relative values, or a camera's of another depth, or of the file's with a black level that is taken off."""
    if request.param == "relative":
        return picture_conversion(None, None, None), 0
    bits, black_dn = (12, 0) if request.param == "12 bits" else (picture[1].frame.bit_depth, 7)
    (tmp_path / "camera.toml").write_text(
        f'name = "any"\nadc_bits = {bits}\nblack_dn = {black_dn}\npixel_pitch_m = 3.45e-6\n'
        "quantum_efficiency = 0.55\nk_dn_per_e = 0.23\nf_number = 2.8\nlens_transmittance = 0.9\nspectrum = 'D65'\n"
    )
    return picture_conversion(None, tmp_path / "camera.toml", None), black_dn


@pytest.mark.parametrize("contrast", [Fraction(1, 2), Fraction(1), Fraction(3)])
def test_pixel_to_pixel_as_by_brute_force_on_the_integers(picture, conversion, contrast):
    dn, taken = picture
    converted, black_dn = conversion
    dn = dn - black_dn
    pairs = [*zip(dn[:, :-1].flat, dn[:, 1:].flat, strict=True), *zip(dn[:-1].flat, dn[1:].flat, strict=True)]
    expected = Fraction(sum(detected(max(pair), min(pair), contrast) for pair in pairs), len(pairs))
    seen = converted.luminance(taken)
    assert cdp_neighbours(seen.luminance_cd_m2, float(contrast)).cdp == float(expected)


@pytest.mark.parametrize("contrast", [Fraction(1, 2), Fraction(1), Fraction(3)])
def test_regions_as_by_brute_force_on_the_integers(picture, conversion, contrast):
    dn, taken = picture
    converted, black_dn = conversion
    dn = dn - black_dn
    pairs = [(bright, dark) for bright in dn[:, 10:].flat for dark in dn[:, :10].flat]
    expected = Fraction(sum(detected(*pair, contrast) for pair in pairs), len(pairs))
    rois = [*RectangleShape("dark", 0, 0, 10, 12).rois(), *RectangleShape("bright", 10, 0, 10, 12).rois()]
    seen = converted.luminance(taken)
    found = evaluate_image(taken, seen, converted.unit_of(taken), ImageRequest((float(contrast),), 0.5, tuple(rois)))
    (pair,) = found.pairs
    assert pair.result.results[0].result.cdp == pytest.approx(float(expected), rel=1e-14)
