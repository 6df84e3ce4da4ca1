"""What values look like whose file does not say it, against values that were made so."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from labcdp.files.doubts import doubts_of, encodings, histogram_of, mosaic_of

RNG = np.random.default_rng(4)
#: Luminance as in photographs: logarithms that are normal around 18 % of white, in soft patches, and the brightest cut.
SCENE = np.clip(0.18 * np.exp(0.9 * gaussian_filter(RNG.normal(size=(300, 400)), 12) * 42), 0.0005, 1)


def srgb(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def dn(values, top=255):
    return np.rint(top * values).astype(np.uint8 if top == 255 else np.uint16)


def behind(values, pattern):
    parts = {"R": 0.6, "G": 1.0, "B": 0.45}
    found = values.copy()
    for at, name in enumerate(pattern):
        found[at // 2 :: 2, at % 2 :: 2] *= parts[name]
    return found


def taken(values, bits=8, coloured=False):
    return encodings(histogram_of(values), 2.0**bits - 1, bits, coloured)


def test_a_photograph_is_for_screens_and_its_light_is_not():
    assert taken(dn(srgb(SCENE))) == ("srgb", "linear")
    assert taken(dn(SCENE)) == ("linear", "srgb")
    # Neither are two patches, noise, or a few pixels.
    assert taken(np.repeat(np.uint8([[60, 150]]), 3000, axis=0))[0] == "linear"
    assert taken(RNG.integers(0, 256, (200, 200), np.uint8))[0] == "linear"
    target = np.full((200, 200), 90, np.uint8)
    target[:20], target[20:40], target[40:60] = 10, 230, 150
    assert taken(target)[0] == "linear"
    assert taken(dn(srgb(SCENE[:20, :20])))[0] == "linear"


def test_more_bits_are_a_cameras_and_colours_are_for_screens():
    assert taken(dn(SCENE, 65535), 16) == ("linear", None)
    assert taken(dn(srgb(SCENE), 65535), 16) == ("linear", "srgb")
    assert taken(np.dstack(3 * [dn(SCENE)]), 8, True) == ("srgb", "linear")


@pytest.mark.parametrize(("bits", "black"), [(8, 16), (12, 64), (12, 256), (14, 1024), (16, 64)])
def test_a_histogram_that_begins_above_0_is_found(bits, black):
    """Also of 12 bits of which nothing says so; with noise that is below the black level."""
    top = 4095 if (bits, black) == (16, 64) else 2**bits - 1
    light = np.clip(SCENE - 0.01, 0, 1)
    noisy = black + light * (top - black) + RNG.normal(0, 0.001 * top, SCENE.shape)
    values = np.clip(np.rint(noisy), 0, top).astype(np.uint8 if bits == 8 else np.uint16)
    found = doubts_of(values, 2.0**bits - 1, "linear", None, as_stored=True).black_dn
    assert found == pytest.approx(black, abs=0.005 * top)
    assert doubts_of(values, 2.0**bits - 1, "srgb", None, as_stored=True).black_dn is None
    assert doubts_of(values, 2.0**bits - 1, "linear", None, as_stored=False).black_dn is None


def test_pictures_that_begin_at_0_or_are_bright_have_no_black_level():
    for values in (dn(np.clip(SCENE - 0.02, 0, 1)), dn(0.3 + 0.7 * SCENE)):
        assert doubts_of(values, 255.0, "linear", None, as_stored=True).black_dn is None


@pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
@pytest.mark.parametrize("top", [255, 4095])
def test_a_mosaic_is_found(pattern, top):
    noisy = SCENE * (1 + 0.05 * RNG.normal(size=SCENE.shape))
    found = mosaic_of(dn(np.clip(behind(noisy, pattern), 0, 1), top))
    assert pattern in found.split(" or ")
    # A camera's values are in proportion to light, whatever else they may look like.
    doubts = doubts_of(dn(behind(SCENE, pattern)), 255.0, "srgb", "linear", as_stored=True)
    assert (doubts.encoding, doubts.other_encoding) == ("linear", None)


def test_patterns_of_single_pixels_lines_and_edges_are_no_mosaic():
    rows, columns = np.mgrid[:200, :300]
    grid = np.full((200, 300), 100, np.uint8)
    grid[::10] = grid[:, ::10] = 10
    patterns = [
        (rows + columns) % 2, rows % 2, columns % 2, columns // 2 % 2, (rows // 20 + columns // 20) % 2,
        columns / 300, rows * columns / 6e4,
    ]  # fmt: skip
    for values in (*(dn(0.2 + 0.6 * one) for one in patterns), grid, dn(SCENE), np.zeros((40, 40), np.uint8)):
        assert mosaic_of(values) == ""
    assert mosaic_of(np.arange(16, dtype=np.uint8).reshape(4, 4)) == ""


def test_two_contrasts_show_what_it_matters():
    values = np.repeat(np.uint8([[100, 180]]), 50, axis=0)
    doubts = doubts_of(values, 255.0, "linear", "srgb", as_stored=True)
    assert doubts.contrast() == pytest.approx(0.8)
    low, high = srgb_light(100 / 255), srgb_light(180 / 255)
    assert doubts.contrast("encoding-assumed") == pytest.approx(high / low - 1)
    dark = doubts_of(np.repeat(np.uint16([[164, 264]]), 50, axis=0), 4095.0, "linear", None, as_stored=True)
    assert dark.contrast() == pytest.approx(264 / 164 - 1)
    assert dark.contrast("black-level-doubtful") == float("inf")


def srgb_light(value):
    return ((value + 0.055) / 1.055) ** 2.4
