import cv2
import numpy as np
import pytest

from labcdp.calibration.emva.images import read_image
from labcdp.calibration.emva.nonuniformity import dark_pattern, flat_variance, spatial_variance
from labcdp.calibration.emva.statistics import FrameSums, NoiseParts
from labcdp.errors import InputError

from .conftest import write_image

NO_NOISE = NoiseParts(0.0, 0.0, 0.0)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_are_read_bit_for_bit(tmp_path, suffix, dtype):
    image = np.arange(6 * 300).reshape(6, 300) % np.iinfo(dtype).max
    image = (image * (np.iinfo(dtype).max // image.max())).astype(dtype)
    write_image(tmp_path / f"a{suffix}", image)
    read = read_image(tmp_path / f"a{suffix}", (6, 300), 8 * dtype().itemsize)
    assert read.dtype == dtype
    assert np.array_equal(read, image)


@pytest.mark.parametrize(
    ("image", "bits", "message"),
    [
        (np.zeros((5, 6), np.uint16), 12, r"a\.png has 6 x 5 pixels, the index says 6 x 4 pixels: give images of one"),
        (np.full((4, 6), 4096, np.uint16), 12, r"a\.png holds 4096 DN, more than the 12 bits of the index can"),
        (np.zeros((4, 6, 3), np.uint16), 12, r"a\.png is a coloured image: give grey ones"),
    ],
)
def test_images_that_do_not_match_are_refused(tmp_path, image, bits, message):
    write_image(tmp_path / "a.png", image)
    with pytest.raises(InputError, match=message.replace("6 x 4 pixels", "6 x 4")):
        read_image(tmp_path / "a.png", (4, 6), bits)


@pytest.mark.parametrize(("name", "data"), [("a.png", b""), ("a.png", b"\x89PNG broken"), ("a.tif", b"II*\0 broken")])
def test_damaged_images_are_refused(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=r"a\.(png|tif) is truncated or damaged: copy it again"):
        read_image(tmp_path / name, (4, 6), 12)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_truncated_images_are_told_and_the_library_is_silent(tmp_path, capfd, suffix, share):
    path = tmp_path / f"a{suffix}"
    write_image(path, np.random.default_rng(1).integers(0, 4096, (60, 80)).astype(np.uint16))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match=r"is truncated or damaged: copy it again"):
        read_image(path, (60, 80), 12)
    assert capfd.readouterr().err == ""


def test_a_png_with_a_flipped_bit_is_told(tmp_path, capfd):
    path = tmp_path / "a.png"
    write_image(path, np.random.default_rng(1).integers(0, 4096, (60, 80)).astype(np.uint16))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"is truncated or damaged"):
        read_image(path, (60, 80), 12)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_compression_with_loss_is_refused_whatever_the_name(tmp_path, name):
    assert cv2.imwrite(str(tmp_path / name), np.zeros((4, 6), np.uint8))
    (tmp_path / name).rename(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"a\.png is compressed with loss, which alters the noise: give PNG or TIFF"):
        read_image(tmp_path / "a.png", (4, 6), 8)


def test_temporal_variance_of_a_pair_is_that_of_the_standard():
    rng = np.random.default_rng(3)
    a, b = rng.integers(0, 4096, (2, 30, 40)).astype(np.uint16)
    sums = FrameSums(4095)
    sums.add(a)
    sums.add(b)
    difference = a.astype(float) - b
    found = sums.result()
    # EMVA 1288 Release 3.1, eq. 18, with n - 1 for the mean that was taken off.
    standard = np.mean(difference**2) / 2 - (a.mean() - b.mean()) ** 2 / 2
    assert found.temporal_variance_dn2 == pytest.approx(standard * a.size / (a.size - 1), rel=1e-12)
    assert found.mean_dn == pytest.approx((a.mean() + b.mean()) / 2, rel=1e-14)


def test_flicker_common_to_all_pixels_is_no_temporal_noise():
    frames = [np.full((8, 8), value, np.uint16) for value in (100, 120, 90)]
    sums = FrameSums(4095)
    for frame in frames:
        sums.add(frame)
    assert sums.result().temporal_variance_dn2 == 0


def test_statistics_of_a_stack_by_brute_force():
    rng = np.random.default_rng(4)
    stack = rng.integers(0, 200, (7, 20, 30)).astype(np.uint16)
    sums = FrameSums(199)
    for frame in stack:
        sums.add(frame)
    found, noise = sums.result(), sums.noise_of_mean()
    free = stack - stack.mean(axis=(1, 2), keepdims=True)
    assert found.temporal_variance_dn2 == pytest.approx(free.var(axis=0, ddof=1).mean() * 600 / 599, rel=1e-12)
    assert np.allclose(sums.mean_image(), stack.mean(axis=0))
    assert found.largest_share == np.mean(stack == 199)
    assert found.black_share == np.mean(stack == 0)
    rows = stack.mean(axis=2) - stack.mean(axis=(1, 2))[:, None]
    assert noise.row == pytest.approx(rows.var(axis=0, ddof=1).mean() / 7, rel=1e-12)


@pytest.mark.parametrize(("factor", "multiple"), [(1, 1), (2, 2), (16, 16), (64, 16)])
def test_values_in_the_upper_bits_are_noticed(factor, multiple):
    sums = FrameSums(65535)
    for _ in range(2):
        sums.add(np.arange(16, dtype=np.uint16).reshape(4, 4) * np.uint16(factor))
    assert sums.result().multiple == multiple


def test_row_column_and_pixel_parts_are_told_apart():
    rng = np.random.default_rng(5)
    row, column, pixel = 2.0, 3.0, 5.0
    shape = (400, 500)
    image = 50 + row * rng.standard_normal((400, 1)) + column * rng.standard_normal(500)
    image = image + pixel * rng.standard_normal(shape)
    found = spatial_variance(image, NO_NOISE)
    # 4 standard deviations of a variance, 2 s^4 / n, with as many values as there are rows, columns and pixels.
    for estimate, sigma, n in ((found.row, row, 400), (found.column, column, 500), (found.pixel, pixel, image.size)):
        assert estimate.value == pytest.approx(sigma**2, abs=4 * (sigma**2 + pixel**2 / 400) * np.sqrt(2 / n))
    parts = found.row.value + found.column.value + found.pixel.value
    assert found.total.value == pytest.approx(parts, rel=1e-3)


def test_noise_of_rows_is_not_taken_for_a_pattern():
    rng = np.random.default_rng(6)
    sums = FrameSums(4095)
    for _ in range(40):
        frame = 500 + 20 * rng.standard_normal((200, 1)) + 10 * rng.standard_normal((200, 300))
        sums.add(np.rint(frame).astype(np.uint16))
    found = spatial_variance(sums.mean_image(), sums.noise_of_mean())
    # Without a pattern: the variance of 200 row means of 20^2 / 40 = 10 DN^2, known to 10 sqrt(2 / 200).
    assert abs(found.row.value) < 4 * 10 * np.sqrt(2 / 200)
    assert abs(found.pixel.value) < 4 * 2.5 * np.sqrt(2 / 60_000) + 0.05


def test_slow_gradients_of_a_patch_are_taken_off():
    rng = np.random.default_rng(7)
    rows, columns = np.indices((60, 70)).reshape(2, -1)
    slow = 1000 + 3.0 * rows - 0.02 * columns**2 + 0.01 * rows * columns
    values = slow + 4.0 * rng.standard_normal(rows.size)
    found = flat_variance(values, rows, columns, noise_dn2=6.0)
    assert found.uncertainty == pytest.approx(16 * np.sqrt(2 / rows.size), rel=0.1)
    assert found.value == pytest.approx(16 - 6, abs=4 * found.uncertainty)


def test_dark_pattern_extrapolates_each_pixel_to_zero_exposure():
    rng = np.random.default_rng(8)
    offset, rate = rng.normal(50, 2, (10, 12)), rng.normal(30, 4, (10, 12))
    exposures = [0.01, 0.04, 0.2]
    noise = NoiseParts(0.5, 0.1, 0.1)
    found = dark_pattern([offset + rate * t for t in exposures], exposures, [noise] * 3)
    assert np.allclose(found.offset_dn, offset)
    assert np.allclose(found.rate_dn_s, rate)
    covariance = 0.5 * np.linalg.inv(np.array([[3.0, sum(exposures)], [sum(exposures), sum(t * t for t in exposures)]]))
    assert found.offset_noise.pixel == pytest.approx(covariance[0, 0])
    assert found.rate_noise.pixel == pytest.approx(covariance[1, 1])
