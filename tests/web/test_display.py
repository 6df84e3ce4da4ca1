import numpy as np
import pytest

from labcdp.web.regions.display import SCALES, DisplayScale, any_in_blocks, tile


@pytest.mark.parametrize("name", SCALES)
def test_a_scale_rises_from_black_to_white(name: str) -> None:
    values = np.linspace(100, 4000, 5000).reshape(50, 100)
    scale = DisplayScale.of(values, name)  # type: ignore[arg-type]
    tones = scale.to_8_bit(values).ravel().astype(int)
    assert (tones[0], tones[-1]) == (0, 255)
    assert (np.diff(tones) >= 0).all()
    # Percentiles 0.1 and 99.9 of even steps.
    assert (scale.black, scale.white) == pytest.approx((103.9, 3996.1), abs=0.2)


def test_the_scale_that_suits_is_chosen() -> None:
    rng = np.random.default_rng(3)
    assert DisplayScale.of(rng.normal(500, 30, (80, 80))).name == "gamma"
    night = rng.normal(5, 1, (80, 80))
    night[:20, :20] = 4000
    assert DisplayScale.of(night).name == "logarithm"


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_a_single_pixel_marks_its_block(n: int) -> None:
    flags = np.random.default_rng(2).random((20, 31)) < 0.05
    rows, columns = -(-20 // n), -(-31 // n)
    brute = [[flags[n * y : n * y + n, n * x : n * x + n].any() for x in range(columns)] for y in range(rows)]
    assert any_in_blocks(flags, n).tolist() == brute


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_larger_parts_are_means_of_blocks_that_stay_while_the_picture_is_moved(dtype: type) -> None:
    values = np.random.default_rng(5).integers(0, 250, (64, 64)).astype(dtype)
    scale = DisplayScale("linear", 0, 255)
    whole = tile(values, scale, (0, 0, 64, 64), (16, 16))
    assert np.abs(whole.pixels - values.reshape(16, 4, 16, 4).mean(axis=(1, 3))).max() <= 1
    part = tile(values, scale, (9, 5, 41, 37), (8, 8))
    assert (part.x, part.y) == (8, 4)
    assert part.pixels.tolist() == whole.pixels[1:10, 2:11].tolist()
    # A part no larger than its place is shown pixel by pixel.
    shown = tile(values, scale, (2.4, 1.2, 6.0, 5.9), (400, 400))
    assert (shown.x, shown.y, shown.width, shown.height) == (2, 1, 4, 5)
    assert shown.pixels.tolist() == values[1:6, 2:6].tolist()
