"""Images as videos: folders of numbered ones, pages of a TIFF, recorded sessions."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from labcdp.core.finding import info
from labcdp.files import PictureOptions
from labcdp.files.video.open import frames_of, open_video
from labcdp.files.video.selection import Position, Selection
from labcdp.report.findings import finding_text
from tests.files.video_files import Pixels


def save(path: Path, values: Pixels) -> None:
    Image.fromarray(values).save(path)


def grey(value: int, dtype: type = np.uint8) -> Pixels:
    return np.full((20, 30), value, dtype)


def test_a_folder_of_images_is_a_video_in_natural_order(tmp_path: Path) -> None:
    for number in range(12):
        save(tmp_path / f"img{number + 1}.png", grey(20 * number))
    (tmp_path / "notes.txt").write_text("no image")
    source = open_video(tmp_path)
    found = [(one.number, one.time_s, int(one.grey[0, 0])) for one in frames_of(source, Selection())]
    assert found == [(n + 1, float(n), 20 * n) for n in range(12)]
    first = source.sha256
    save(tmp_path / "img3.png", grey(1))
    assert open_video(tmp_path).sha256 != first


def test_a_sequence_keeps_16_bits_and_reports_what_does_not_fit(tmp_path: Path) -> None:
    for number in range(4):
        save(tmp_path / f"f{number}.png", grey(1000 * number + 1, np.uint16))
    save(tmp_path / "f4.png", np.zeros((10, 30), np.uint16))
    (tmp_path / "f5.png").write_bytes((tmp_path / "f3.png").read_bytes()[:60])
    frames = list(frames_of(open_video(tmp_path), Selection()))
    assert [int(frame.frame.dn[0, 0]) for frame in frames[:4] if frame.frame is not None] == [1, 1001, 2001, 3001]
    faults = [frame.fault for frame in frames[4:6]]
    assert [one and one.code for one in faults] == ["frame-size-differs", "frame-broken"]
    assert "truncated" in finding_text(faults[1])


@pytest.mark.parametrize("bright", [0, 3, 11])
def test_the_bits_of_a_sequence_are_estimated_once(tmp_path: Path, bright: int) -> None:
    """Whichever frame reaches the end of 12 bits, all frames have 12."""
    for number in range(12):
        image = grey(900 + number, np.uint16)
        image[0, 0] = 4095 if number == bright else 900
        save(tmp_path / f"{number}.png", image)
    found = [one.frame for one in frames_of(open_video(tmp_path), Selection())]
    assert {one.bit_depth for one in found if one is not None} == (
        {12} if bright in (0, 11) or _looked_at(bright) else {16}
    )
    given = open_video(tmp_path, PictureOptions(bit_depth=12))
    assert {one.frame.bit_depth for one in frames_of(given, Selection()) if one.frame is not None} == {12}


def _looked_at(at: int) -> bool:
    return at in {int(one) for one in np.linspace(0, 11, 9)}


def test_a_black_frame_among_coloured_ones_is_black(tmp_path: Path) -> None:
    colours = np.random.default_rng(1).integers(50, 200, (20, 30, 3), dtype=np.uint8)
    save(tmp_path / "0.png", np.zeros((20, 30, 3), np.uint8))
    for number in (1, 2):
        save(tmp_path / f"{number}.png", colours)
    frames = [one.frame for one in frames_of(open_video(tmp_path), Selection())]
    assert [one.bit_depth for one in frames if one is not None] == [16, 16, 16]
    assert [float(one.dn.mean()) > 0 for one in frames if one is not None] == [False, True, True]


def test_pages_of_a_tiff_are_frames(tmp_path: Path) -> None:
    stack = np.random.default_rng(2).integers(0, 4096, (5, 20, 30), dtype=np.uint16)
    stack[0, 0, 0] = 4095
    tifffile.imwrite(tmp_path / "stack.tif", stack, photometric="minisblack", compression="zlib")
    source = open_video(tmp_path / "stack.tif")
    frames = [one.frame for one in frames_of(source, Selection())]
    np.testing.assert_array_equal([one.dn for one in frames if one is not None], stack)
    assert (source.frame_count, {one.bit_depth for one in frames if one is not None}) == (5, {12})


def test_a_recorded_session_is_a_video() -> None:
    source = open_video(Path(__file__).parents[2] / "labcdp/data/example-session")
    frames = list(frames_of(source, Selection()))
    assert len(frames) == source.frame_count
    assert all(frame.frame is not None and frame.frame.shape == source.shape for frame in frames)
    assert frames[0].time_s == 0.0
    assert all(a.time_s <= b.time_s for a, b in pairwise(frames))


def test_numbers_of_images_are_those_of_the_frames(tmp_path: Path) -> None:
    for number in (1001, 1002, 1005, 1011, 1012):
        save(tmp_path / f"run7_{number}_cam2.png", grey(number - 1000))
    frames = [(one.number, one.time_s, int(one.grey[0, 0])) for one in frames_of(open_video(tmp_path), Selection())]
    assert frames == [(1001, 0.0, 1), (1002, 1.0, 2), (1005, 4.0, 5), (1011, 10.0, 11), (1012, 11.0, 12)]
    every = Selection(Position(frames=1000), every=Position(frames=2))
    assert [one.number for one in frames_of(open_video(tmp_path), every)] == [1001, 1005, 1011]
    save(tmp_path / "dark.png", grey(0))
    source = open_video(tmp_path)
    assert [one.number for one in frames_of(source, Selection())] == list(range(6))
    assert info("frames-numbered-from-0") in source.findings
