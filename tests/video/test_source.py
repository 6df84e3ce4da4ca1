"""Videos as frames: every pixel, number and time against what was written."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp.errors import InputError
from labcdp.sources.picture import PictureOptions
from labcdp.sources.video import frames_of, left_out, open_video, video_paths
from labcdp.sources.video_selection import Chooser, Position, Selection
from labcdp.sources.video_timeline import jpeg_size

SIZE = (160, 120)
N = 12


@pytest.fixture(autouse=True)
def _quiet() -> None:
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def images(n: int = N, size: tuple[int, int] = SIZE, dtype: type = np.uint8) -> list[np.ndarray]:
    """Noise that no codec compresses away, and a bar whose value is 20 times the number of the frame."""
    rng = np.random.default_rng(7)
    made = []
    for number in range(n):
        image = rng.integers(0, 30, (size[1], size[0])).astype(dtype)
        image[:, :16] = 20 * (number % N)
        made.append(image)
    return made


def write(path: Path, codec: str, frames: list[np.ndarray], fps: float = 25.0) -> Path:
    height, width = frames[0].shape[:2]
    settings = [cv2.VIDEOWRITER_PROP_IS_COLOR, int(frames[0].ndim == 3)]
    if frames[0].dtype == np.uint16:
        settings += [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), fps, (width, height), settings)
    assert writer.isOpened()
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


def packets(path: Path) -> list[bytes]:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    capture.set(cv2.CAP_PROP_FORMAT, -1)
    found = []
    while capture.grab():
        found.append(capture.retrieve()[1].tobytes())
    return found


def mux(path: Path, packed: list[bytes], times_ms: list[int]) -> Path:
    """Motion JPEG packets with time stamps of their own."""
    settings = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 1000, SIZE, settings)
    assert writer.isOpened()
    for data, time_ms in zip(packed, times_ms, strict=True):
        writer.set(cv2.VIDEOWRITER_PROP_PTS, time_ms)
        writer.set(cv2.VIDEOWRITER_PROP_KEY_FLAG, 1)
        writer.write(np.frombuffer(data, np.uint8))
    writer.release()
    return path


def broken(path: Path, number: int, name: str) -> Path:
    """Copy of a video in which the packet of a frame is zeros."""
    data = path.read_bytes()
    packet = packets(path)[number]
    at = data.find(packet[:600])
    assert at > 0
    assert data.find(packet[:600], at + 1) < 0
    copy = path.with_name(name)
    copy.write_bytes(data[:at] + bytes(len(packet)) + data[at + len(packet) :])
    return copy


def bars(path: Path, selection: Selection | None = None) -> list[tuple[int, float, float | str]]:
    """Number, time, and the bar over 20 or the fault, of each frame."""
    found: list[tuple[int, float, float | str]] = []
    for frame in frames_of(open_video(path), selection or Selection()):
        value = frame.fault if frame.frame is None else round(float(frame.grey[:, 3:10].mean()) / 20, 1)
        found.append((frame.number, round(frame.time_s, 4), value))
    return found


@pytest.mark.parametrize(("codec", "suffix"), [("FFV1", "mkv"), ("FFV1", "avi"), ("Y800", "avi")])
def test_lossless_grey_is_read_as_it_was_written(tmp_path: Path, codec: str, suffix: str) -> None:
    written = images()
    source = open_video(write(tmp_path / f"a.{suffix}", codec, written))
    frames = list(frames_of(source, Selection()))
    assert [frame.number for frame in frames] == list(range(N))
    assert [frame.time_s for frame in frames] == pytest.approx([number / 25 for number in range(N)])
    for frame, image in zip(frames, written, strict=True):
        assert frame.frame is not None
        np.testing.assert_array_equal(frame.frame.dn, image)
    assert (source.shape, source.frame_count, source.frame_rate) == ((120, 160), N, 25.0)
    assert source.notes == ()
    assert source.warnings == ()


def test_sixteen_bits_stay_sixteen_bits(tmp_path: Path) -> None:
    written = [(1000 * (image.astype(np.uint16) + 1) + 7).astype(np.uint16) for image in images(3)]
    written = [np.minimum(image, 40_000).astype(np.uint16) for image in written]
    source = open_video(write(tmp_path / "a.mkv", "FFV1", written))
    frames = list(frames_of(source, Selection()))
    for frame, image in zip(frames, written, strict=True):
        assert frame.frame is not None
        assert frame.frame.bit_depth == 16
        np.testing.assert_array_equal(frame.frame.dn, image)
        np.testing.assert_array_equal(frame.grey, image >> 8)


def test_limited_range_is_stretched_and_full_range_is_not(tmp_path: Path) -> None:
    ramp = np.repeat(np.arange(0, 256, 8, dtype=np.uint8), 5)[None, :].repeat(64, axis=0)
    for codec, suffix, notes in (("mp4v", "mp4", 1), ("MJPG", "avi", 0)):
        source = open_video(write(tmp_path / f"ramp.{suffix}", codec, [ramp] * 3))
        assert len(source.notes) == notes
        (first, *_) = frames_of(source, Selection())
        assert first.frame is not None
        assert np.abs(first.frame.dn.astype(float) - ramp).mean() < 4


@pytest.mark.parametrize(("codec", "suffix"), [("PNG ", "avi"), ("HFYU", "avi"), ("MPNG", "avi"), ("FFV1", "mkv")])
def test_red_green_and_blue_are_no_luma(tmp_path: Path, codec: str, suffix: str) -> None:
    # The first frames are black, so that only later ones differ from the bytes that are stored.
    written = [np.zeros((120, 160), np.uint8)] * 3 + images(3)
    path = write(tmp_path / f"a.{suffix}", codec, [cv2.merge([image] * 3) for image in written])
    source = open_video(path)
    frames = list(frames_of(source, Selection()))
    for frame, image in zip(frames, written, strict=True):
        assert np.abs(frame.grey.astype(int) - image).max() <= 1
    assert "red, green and blue to Y' (ITU-R BT.601)" in source.notes


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize(("codec", "suffix", "limited"), [("mp4v", "mp4", True), ("MJPG", "avi", False)])
def test_the_range_is_found_in_a_scene_of_middle_grey(
    tmp_path: Path, codec: str, suffix: str, limited: bool, coloured: bool
) -> None:
    image = np.full((96, 96), 128, np.uint8)
    image[:, 24:48], image[:, 72:] = 114, 142
    frames = [cv2.merge([image] * 3) if coloured else image] * 3
    source = open_video(write(tmp_path / f"a.{suffix}", codec, frames))
    assert any("limited range" in note for note in source.notes) == limited
    assert source.warnings == ()
    (first, *_) = frames_of(source, Selection())
    assert float(first.grey[:, 78:90].mean()) - float(first.grey[:, 30:42].mean()) == pytest.approx(28, abs=2)


def test_a_range_that_cannot_be_known_is_assumed_aloud(tmp_path: Path) -> None:
    flat = [np.full((96, 96), 120, np.uint8)] * 3
    source = open_video(write(tmp_path / "a.mp4", "mp4v", flat))
    assert any(
        "too even to tell the range of its Y': limited range (16 to 235) is assumed" in w for w in source.warnings
    )
    assert open_video(write(tmp_path / "a.avi", "MJPG", flat)).warnings == ()


def test_a_coloured_video_is_warned_about(tmp_path: Path) -> None:
    colours = np.zeros((64, 64, 3), np.uint8)
    colours[:, :32] = (40, 40, 220)
    colours[:, 32:] = (40, 200, 40)
    source = open_video(write(tmp_path / "a.avi", "MJPG", [colours] * 2))
    assert any("coloured" in warning for warning in source.warnings)


@pytest.mark.parametrize(("codec", "suffix"), [("MJPG", "avi"), ("MJPG", "mkv")])
def test_a_broken_frame_costs_only_itself(tmp_path: Path, codec: str, suffix: str) -> None:
    path = broken(write(tmp_path / f"a.{suffix}", codec, images()), 5, f"b.{suffix}")
    found = bars(path)
    assert [(number, value) for number, _, value in found if isinstance(value, str)] == [
        (5, "broken: it cannot be decoded")
    ]
    assert [value for _, _, value in found[:5] + found[6:]] == [float(n) for n in range(N) if n != 5]
    assert [time for _, time, _ in found] == pytest.approx([n / 25 for n in range(N)])


def test_frames_that_build_on_a_broken_one_are_not_trusted(tmp_path: Path) -> None:
    still = images(1)[0]
    moving = [np.roll(still, 2 * number, axis=1) for number in range(30)]
    path = broken(write(tmp_path / "a.mp4", "mp4v", moving), 5, "b.mp4")
    faults = {number: value for number, _, value in bars(path) if isinstance(value, str)}
    assert faults[5] == "broken: it cannot be decoded"
    # MPEG-4 by OpenCV has a key frame at the latest after 12 frames.
    assert faults[6] == "builds on a broken frame before it"
    assert 0 not in faults
    assert 29 not in faults


def test_variable_frame_rate_is_timed_by_the_container(tmp_path: Path) -> None:
    times = [0, 40, 80, 200, 210, 260, 300, 500, 540, 580, 620, 660]
    packed = packets(write(tmp_path / "a.avi", "MJPG", images()))
    for suffix in ("mkv", "mp4"):
        found = bars(mux(tmp_path / f"vfr.{suffix}", packed, times))
        assert [time for _, time, _ in found] == pytest.approx([time / 1000 for time in times])
        assert [value for _, _, value in found] == [float(n) for n in range(N)]


def test_frames_of_another_size_are_reported_by_their_numbers(tmp_path: Path) -> None:
    large = packets(write(tmp_path / "a.avi", "MJPG", images(6)))
    small = packets(write(tmp_path / "b.avi", "MJPG", images(2, (96, 64))))
    found = bars(mux(tmp_path / "c.mkv", large[:3] + small + large[3:], list(range(0, 320, 40))))
    assert [value for _, _, value in found] == [
        0.0, 1.0, 2.0,
        "has 96 x 64 pixels, the video has 160 x 120", "has 96 x 64 pixels, the video has 160 x 120",
        3.0, 4.0, 5.0,
    ]  # fmt: skip


@pytest.mark.parametrize("suffix", ["avi", "mkv"])
def test_a_truncated_file_gives_its_whole_frames(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"a.{suffix}", "FFV1", images())
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    found = [value for _, _, value in bars(path) if not isinstance(value, str)]
    assert 5 <= len(found) < N
    assert found[:5] == [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("name", "data", "text"),
    [
        ("empty.mp4", b"", r"empty\.mp4 is empty"),
        ("text.mp4", b"this is no video\n" * 50, r"text\.mp4 is no video that OpenCV opens"),
        (None, None, r"none\.mp4 is no file"),
    ],
)
def test_what_is_no_video_is_refused_in_one_line(tmp_path: Path, name: str | None, data: bytes, text: str) -> None:
    path = tmp_path / (name or "none.mp4")
    if name is not None:
        path.write_bytes(data)
    with pytest.raises(InputError, match=text) as error:
        open_video(path)
    assert "\n" not in str(error.value)


def test_an_mp4_without_its_index_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", "mp4v", images())
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(InputError, match="or is cut off"):
        open_video(path)


def test_too_large_frames_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    path = write(tmp_path / "a.avi", "MJPG", images(2))
    with pytest.raises(InputError, match=r"frames of 160 x 120 pixels, more than 0\.01 megapixels"):
        open_video(path, PictureOptions(max_pixels=10_000))


def test_a_folder_of_images_is_a_video_in_natural_order(tmp_path: Path) -> None:
    for number, image in enumerate(images()):
        cv2.imwrite(str(tmp_path / f"img{number + 1}.png"), image)
    (tmp_path / "notes.txt").write_text("no image")
    source = open_video(tmp_path)
    assert bars(tmp_path) == [(n + 1, float(n), float(n)) for n in range(N)]
    first = source.sha256
    cv2.imwrite(str(tmp_path / "img3.png"), images()[4])
    assert open_video(tmp_path).sha256 != first


def test_numbers_of_images_are_those_of_the_frames(tmp_path: Path) -> None:
    for number in (1001, 1002, 1005, 1011, 1012):
        cv2.imwrite(str(tmp_path / f"run7_{number}_cam2.png"), np.full((20, 30), number - 1000, np.uint8))
    frames = [(one.number, one.time_s, int(one.grey[0, 0])) for one in frames_of(open_video(tmp_path), Selection())]
    assert frames == [(1001, 0.0, 1), (1002, 1.0, 2), (1005, 4.0, 5), (1011, 10.0, 11), (1012, 11.0, 12)]
    every = Selection(Position(frames=1000), every=Position(frames=2))
    assert [one.number for one in frames_of(open_video(tmp_path), every)] == [1001, 1005, 1011]
    cv2.imwrite(str(tmp_path / "dark.png"), np.zeros((20, 30), np.uint8))
    source = open_video(tmp_path)
    assert [one.number for one in frames_of(source, Selection())] == list(range(6))
    assert any("numbered from 0 in the order of the images" in note for note in source.notes)


def test_a_sequence_keeps_16_bits_and_reports_what_does_not_fit(tmp_path: Path) -> None:
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"f{number}.png"), np.full((20, 30), 1000 * number + 1, np.uint16))
    cv2.imwrite(str(tmp_path / "f4.png"), np.zeros((10, 30), np.uint16))
    (tmp_path / "f5.png").write_bytes((tmp_path / "f3.png").read_bytes()[:60])
    frames = list(frames_of(open_video(tmp_path), Selection()))
    assert [int(frame.frame.dn[0, 0]) for frame in frames[:4] if frame.frame is not None] == [1, 1001, 2001, 3001]
    assert frames[4].fault == "has 30 x 10 pixels, the video has 30 x 20"
    assert frames[5].fault.startswith("broken: ")
    assert "truncated" in frames[5].fault


def test_a_recorded_session_is_a_video() -> None:
    folder = Path(__file__).parents[2] / "labcdp/data/example-session"
    source = open_video(folder)
    frames = list(frames_of(source, Selection()))
    assert len(frames) == source.frame_count
    assert all(frame.frame is not None and frame.frame.shape == source.shape for frame in frames)
    assert frames[0].time_s == 0.0
    assert all(a.time_s <= b.time_s for a, b in pairwise(frames))


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no image"):
        open_video(tmp_path)


@pytest.mark.parametrize(
    ("start", "stop", "every", "numbers"),
    [
        ("0", None, "1", list(range(12))),
        ("3", "7", "1", [3, 4, 5, 6]),
        ("1", None, "4", [1, 5, 9]),
        ("0.1s", "300ms", "1", [3, 4, 5, 6, 7]),
        ("0", None, "100ms", [0, 3, 5, 8, 10]),
        ("0:00.2", None, "0.12s", [5, 8, 11]),
        ("50", None, "1", []),
    ],
)
def test_selections_in_frames_and_seconds(start: str, stop: str | None, every: str, numbers: list[int]) -> None:
    selection = Selection(
        Position.parse(start, "--start"),
        None if stop is None else Position.parse(stop, "--stop"),
        Position.parse(every, "--every"),
    )
    chooser = Chooser(selection)
    times = [(n, 0.04 * n) for n in range(12)]
    found = [n for n, time in times if not selection.ended(n, time) and chooser.takes(n, time)]
    assert found == numbers
    assert selection.expected(12, 25.0) in (len(numbers), len(numbers) + 1)


@pytest.mark.parametrize("text", ["", "-1", "1.5", "3 days", "s", "1:2:3:4", "nan"])
def test_positions_that_cannot_be_read_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="--start is "):
        Position.parse(text, "--start")


def test_positions_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="every is 0"):
        Selection(every=Position(frames=0))
    with pytest.raises(InputError, match="stop 5 is not behind start 5"):
        Selection(Position(frames=5), Position(frames=5))


def test_the_size_in_a_jpeg_header() -> None:
    data = cv2.imencode(".jpg", np.zeros((37, 53), np.uint8))[1].ravel()
    assert jpeg_size(data) == (37, 53)
    assert jpeg_size(data[:20]) is None
    assert jpeg_size(np.zeros(100, np.uint8)) is None


def test_video_files_of_a_folder(tmp_path: Path) -> None:
    for name in ("b.avi", "a.mp4", "readme.txt"):
        (tmp_path / name).write_bytes(b"x")
    images_only = tmp_path / "images"
    images_only.mkdir()
    assert video_paths([tmp_path]) == [tmp_path / "a.mp4", tmp_path / "b.avi"]
    assert video_paths([images_only, tmp_path / "b.avi"]) == [images_only, tmp_path / "b.avi"]
    assert left_out(tmp_path) == []
    cv2.imwrite(str(images_only / "0.png"), np.zeros((4, 4), np.uint8))
    assert left_out(tmp_path) == [images_only]
