"""What speaks against using a region."""

import numpy as np
import pytest

from labcdp.errors import InputError
from labcdp.regions import check_region
from labcdp.roi import Roi

ROI = Roi.rectangle("grey", 30, 30, 40, 40)


def noisy(seed, level=100.0, sigma=2.0):
    return np.random.default_rng(seed).normal(level, sigma, (100, 100))


def warnings(image, roi=ROI, saturated=None):
    return check_region(image, saturated, roi)


@pytest.mark.parametrize(
    "make",
    [
        lambda rng: rng.normal(100, 5, (100, 100)),
        lambda rng: rng.poisson(0.5, (100, 100)),
        lambda rng: np.rint(rng.normal(100, 0.3, (100, 100))).astype(np.uint16),
        lambda rng: np.full((100, 100), 7.0),
        lambda rng: np.zeros((100, 100)),
    ],
    ids=["normal", "few photons", "whole numbers", "all alike", "zero"],
)
def test_nothing_speaks_against_noise_alone(make):
    # 40 images: a check that is wrong once in a thousand times fails here in 4 % of all seeds.
    assert [warnings(make(np.random.default_rng(seed))) for seed in range(40)] == [()] * 40


def test_few_pixels():
    assert warnings(noisy(1), Roi.rectangle("dot", 30, 30, 6, 6)) == (
        "region 'dot' holds 36 pixels: intervals will be wide; use 100 or more",
    )


def test_saturated_pixels():
    saturated = np.zeros((100, 100), dtype=bool)
    saturated[30:34, 30:70] = True
    saturated[:20] = True
    assert warnings(noisy(1), saturated=saturated) == (
        "10 % of the pixels of region 'grey' are saturated: shorten the exposure",
    )


def test_pixels_without_a_value():
    image = noisy(1)
    image[40:42, 30:70] = np.nan
    assert warnings(image) == ("5 % of the pixels of region 'grey' have no value: leave them out",)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_an_edge_within_the_border(depth):
    image = noisy(2)
    image[:, : 30 + depth] -= 50
    assert warnings(image) == (
        f"the outer {depth} pixels of region 'grey' differ from its middle: it touches an edge; "
        f"leave a margin of {depth} pixels or more",
    )


def test_an_edge_beside_the_region_is_none_of_its_business():
    image = noisy(2)
    image[:, :30] -= 50
    assert warnings(image) == ()


@pytest.mark.parametrize(("across", "down"), [(0.2, 0.0), (0.0, -0.2), (0.12, 0.12)])
def test_uneven_light(across, down):
    ramp = 1 + across * np.linspace(-0.5, 0.5, 100) + down * np.linspace(-0.5, 0.5, 100)[:, None]
    (warning,) = warnings(ramp * noisy(3))
    assert "region 'grey' is uneven by" in warning
    # 40 of 100 pixels: 8 % across or down; of a diagonal 98 % are seen, and 4.8 % + 4.8 % made of it.
    told = float(warning.split(" by ")[1].split(" %")[0])
    assert told == pytest.approx(8 if 0 in (across, down) else 8.4, abs=0.8)


def test_a_slope_that_noise_hides_is_not_told():
    assert warnings((1 + 0.02 * np.linspace(-0.5, 0.5, 100)) * noisy(4)) == ()


@pytest.mark.parametrize(("count", "off"), [(1, 60), (3, 20), (1, 1000)])
def test_odd_pixels(count, off):
    image = noisy(5)
    image[50, 50 : 50 + count] += off
    assert warnings(image) == (
        f"{count} of 1600 pixels of region 'grey' lie 6 standard deviations or more off: "
        "look for defects, dust or an object in it",
    )


def test_a_region_outside_the_image_is_refused():
    with pytest.raises(InputError, match=r"region 'grey' spans x 30 to 70, y 30 to 70, but the image is 60 x 60"):
        warnings(noisy(1)[:60, :60])


def test_a_mask_of_another_shape_is_refused():
    with pytest.raises(InputError, match=r"a mask of the same shape, got \(\(100, 100\), \(50, 50\)\)"):
        warnings(noisy(1), saturated=np.zeros((50, 50), dtype=bool))
