import numpy as np
import pytest

from labcdp.web.regions.display import DisplayScale, tile


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
