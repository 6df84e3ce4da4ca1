"""Images as videos: folders of numbered ones, pages of a TIFF, recorded sessions."""

import numpy as np
import pytest
import tifffile
from PIL import Image

from labcdp.core.result import info
from labcdp.files.video.open import open_video
from labcdp.files.video.selection import Position, Selection

from .video_files import frames


def save(path, value, dtype=np.uint8, shape=(20, 30)):
    Image.fromarray(np.full(shape, value, dtype)).save(path)


def test_a_folder_of_images_is_a_video_in_natural_order_with_the_images_numbers(tmp_path):
    for number in (2, 3, 6, 12, 13):
        save(tmp_path / f"run7_{number}_cam2.png", number)
    (tmp_path / "notes.txt").write_text("no image")
    seen = [(one.number, one.time_s, int(one.grey[0, 0])) for one in frames(tmp_path)]
    assert seen == [(2, 0, 2), (3, 1, 3), (6, 4, 6), (12, 10, 12), (13, 11, 13)]
    every = Selection(Position(frames=1), every=Position(frames=2))
    assert [one.number for one in frames(tmp_path, every)] == [2, 6, 12]
    save(tmp_path / "dark.png", 0)
    assert [one.number for one in frames(tmp_path)] == list(range(6))
    assert info("frames-numbered-from-0") in open_video(tmp_path).findings


def test_a_sequence_keeps_16_bits_and_reports_what_does_not_fit(tmp_path):
    for number in range(4):
        save(tmp_path / f"f{number}.png", 1000 * number + 1, np.uint16)
    save(tmp_path / "f4.png", 0, np.uint16, (10, 30))
    (tmp_path / "f5.png").write_bytes((tmp_path / "f3.png").read_bytes()[:60])
    *whole, small, broken = frames(tmp_path)
    assert [int(one.frame.dn[0, 0]) for one in whole] == [1, 1001, 2001, 3001]
    assert (small.fault.code, broken.fault.code) == ("frame-size-differs", "frame-broken")


@pytest.mark.parametrize(("bright", "bits"), [(0, 12), (3, 16), (11, 12)])
def test_the_bits_of_a_sequence_are_estimated_once(tmp_path, bright, bits):
    """By nine frames from the first to the last: where one of them reaches the end of 12 bits, all frames have 12."""
    assert (bright in np.linspace(0, 11, 9).astype(int)) == (bits == 12)
    for number in range(12):
        save(tmp_path / f"{number}.png", 4095 if number == bright else 900 + number, np.uint16)
    assert {one.frame.bit_depth for one in frames(tmp_path)} == {bits}
    assert {one.frame.bit_depth for one in frames(tmp_path, bit_depth=12)} == {12}


def test_a_black_frame_among_coloured_ones_is_black(tmp_path):
    colours = np.random.default_rng(1).integers(50, 200, (20, 30, 3), dtype=np.uint8)
    for number, image in enumerate((0 * colours, colours, colours)):
        Image.fromarray(image).save(tmp_path / f"{number}.png")
    found = [one.frame for one in frames(tmp_path)]
    assert [(one.bit_depth, bool(one.dn.mean() > 0)) for one in found] == [(16, False), (16, True), (16, True)]


def test_pages_of_a_tiff_are_frames(tmp_path):
    stack = np.random.default_rng(2).integers(0, 4096, (5, 20, 30), dtype=np.uint16)
    stack[0, 0, 0] = 4095
    tifffile.imwrite(tmp_path / "stack.tif", stack, photometric="minisblack", compression="zlib")
    found = [one.frame for one in frames(tmp_path / "stack.tif")]
    np.testing.assert_array_equal([one.dn for one in found], stack)
    assert {one.bit_depth for one in found} == {12}
