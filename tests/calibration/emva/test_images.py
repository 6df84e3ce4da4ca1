import cv2
import numpy as np
import pytest

from labcdp.calibration.emva.images import read_image
from labcdp.core.errors import InputError

from .conftest import write_image


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_are_read_bit_for_bit(tmp_path, suffix, dtype):
    image = np.arange(6 * 300).reshape(6, 300) % np.iinfo(dtype).max
    image = (image * (np.iinfo(dtype).max // image.max())).astype(dtype)
    write_image(tmp_path / f"a{suffix}", image)
    read = read_image(tmp_path / f"a{suffix}", (6, 300), 8 * dtype().itemsize)
    assert read.dtype == dtype
    assert np.array_equal(read, image)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((5, 6), np.uint16), "has 6 x 5 pixels, the index says 6 x 4"),
        (np.full((4, 6), 4096, np.uint16), "holds 4096 DN, more than the 12 bits of the index"),
        (np.zeros((4, 6, 3), np.uint16), "is a coloured image"),
    ],
)
def test_images_that_do_not_match_are_refused(tmp_path, image, message):
    write_image(tmp_path / "a.png", image)
    with pytest.raises(InputError, match=message):
        read_image(tmp_path / "a.png", (4, 6), 12)


def test_a_flipped_bit_and_compression_with_loss_are_refused_whatever_the_name(tmp_path):
    path = tmp_path / "a.png"
    write_image(path, np.random.default_rng(1).integers(0, 4096, (60, 80)).astype(np.uint16))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"is truncated or damaged"):
        read_image(path, (60, 80), 12)
    assert cv2.imwrite(str(tmp_path / "a.jpg"), np.zeros((4, 6), np.uint8))
    (tmp_path / "a.jpg").rename(path)
    with pytest.raises(InputError, match=r"a\.png is compressed with loss, which alters the noise: give PNG or TIFF"):
        read_image(path, (4, 6), 8)
