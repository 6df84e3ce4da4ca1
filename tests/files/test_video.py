"""Videos as frames: every pixel, number and time against what was written."""

from __future__ import annotations

import io
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from labcdp.core.errors import InputError
from labcdp.evaluate.picture.light.picture import picture_conversion
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.files import PictureOptions, read_picture
from labcdp.files.video.open import frames_of, left_out, open_video, video_paths
from labcdp.files.video.selection import Chooser, Position, Selection
from labcdp.report.findings import finding_text
from tests.files.video_files import N, Pixels, bars, moving, mux_jpegs, write

#: Numbers of ITU-T H.273: transfer, matrix, range of FFmpeg.
BT709, SMPTE170M, LINEAR, SRGB = 1, 6, 8, 13
LIMITED, FULL = 1, 2


def read(path: Path, options: PictureOptions | None = None) -> list[Pixels]:
    """DN of all frames."""
    found = [one.frame for one in frames_of(open_video(path, options), Selection())]
    assert all(one is not None for one in found)
    return [one.dn for one in found if one is not None]


def codes(path: Path) -> list[str]:
    return [one.code for one in open_video(path).findings]


def light(path: Path) -> Pixels:
    """Relative luminance of the first frame of a video, or of a picture."""
    if path.suffix in (".jpg", ".png", ".tif"):
        return picture_conversion(None, None, None).luminance(read_picture(path)).luminance_cd_m2
    source = open_video(path)
    conversion = picture_conversion(None, None, source.encoding)
    (first, *_) = frames_of(source, Selection())
    assert first.frame is not None
    return conversion.convert(first.frame).luminance_cd_m2


@pytest.mark.parametrize(
    ("codec", "suffix", "kind", "bits"),
    [
        ("ffv1", "mkv", "gray", 8), ("ffv1", "avi", "gray", 8), ("rawvideo", "avi", "gray", 8),
        ("ffv1", "mkv", "gray10le", 10), ("ffv1", "mkv", "gray12le", 12), ("ffv1", "mkv", "gray16le", 16),
        ("png", "mov", "gray16be", 16),
    ],
)  # fmt: skip
def test_lossless_grey_is_read_as_it_was_written(tmp_path: Path, codec: str, suffix: str, kind: str, bits: int) -> None:
    rng = np.random.default_rng(3)
    written = [rng.integers(0, 2**bits, (48, 64)).astype(np.uint16) for _ in range(N)]
    source = open_video(write(tmp_path / f"a.{suffix}", codec, kind, written))
    frames = list(frames_of(source, Selection()))
    assert [frame.number for frame in frames] == list(range(N))
    assert [frame.time_s for frame in frames] == pytest.approx([number / 25 for number in range(N)], abs=1e-3)
    for frame, image in zip(frames, written, strict=True):
        assert frame.frame is not None
        np.testing.assert_array_equal(frame.frame.dn, image)
        assert frame.frame.bit_depth == bits
    assert (source.shape, source.frame_count, source.frame_rate) == ((48, 64), N, 25.0)
    assert (source.encoding, [one.code for one in source.findings]) == ("linear", ["video-encoding"])


@pytest.mark.parametrize(
    ("kind", "bits"), [("yuv420p", 8), ("yuv422p10le", 10), ("yuv444p12le", 12), ("yuv420p16le", 16)]
)
@pytest.mark.parametrize("color_range", [LIMITED, FULL])
def test_the_range_is_the_one_that_is_stated(tmp_path: Path, kind: str, bits: int, color_range: int) -> None:
    """ITU-R BT.601 and BT.709: 16 to 235, times 2^(bits - 8)."""
    luma = np.linspace(0, 2**bits - 1, 64 * 64).astype(np.uint16).reshape(64, 64)
    (found,) = read(write(tmp_path / "a.mkv", "ffv1", kind, [luma], color_range=color_range))
    expected = luma.astype(float)
    if color_range == LIMITED:
        expected = (expected / 2 ** (bits - 8) - 16) / 219 * (2**bits - 1)
    np.testing.assert_array_equal(found, np.rint(expected.clip(0, 2**bits - 1)))


@pytest.mark.parametrize(("kind", "bits"), [("yuv444p", 8), ("yuv444p10le", 10), ("yuv444p16le", 16)])
@pytest.mark.parametrize("colorspace", [BT709, SMPTE170M])
@pytest.mark.parametrize("color_range", [LIMITED, FULL])
def test_colours_become_the_luminance_of_their_matrix_and_transfer(
    tmp_path: Path, kind: str, bits: int, colorspace: int, color_range: int
) -> None:
    """ITU-T H.273, 8.3, for the matrix; IEC 61966-2-1 for sRGB; BT.709 for the luminance."""
    k_r, k_b = (0.2126, 0.0722) if colorspace == BT709 else (0.299, 0.114)
    rng = np.random.default_rng(5)
    r, g, b = rng.uniform(0.05, 0.95, (3, 24, 32))
    y = k_r * r + (1 - k_r - k_b) * g + k_b * b
    cb, cr = (b - y) / (2 - 2 * k_b), (r - y) / (2 - 2 * k_r)
    unit = 2 ** (bits - 8)
    if color_range == LIMITED:
        planes = [unit * (16 + 219 * y), unit * (128 + 224 * cb), unit * (128 + 224 * cr)]
    else:
        planes = [(2**bits - 1) * y, (2**bits - 1) * cb + 2 ** (bits - 1), (2**bits - 1) * cr + 2 ** (bits - 1)]
    stored = [np.rint(one).astype(np.uint16) for one in planes]
    path = write(tmp_path / "a.mkv", "ffv1", kind, [stored], color_range=color_range, colorspace=colorspace)
    linear = [np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for c in (r, g, b)]
    true = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    # Slopes of sRGB are at most 2.3, and rounding of Y', Cb and Cr adds up to some steps in each colour.
    np.testing.assert_allclose(read(path)[0] / 65535, true, atol=2.3 * 2.5 / (219 * unit) + 1e-5)


@pytest.mark.parametrize(
    ("codec", "suffix", "kind", "bits"),
    [("ffv1", "mkv", "gbrp16le", 16), ("ffv1", "mkv", "gbrp10le", 10), ("png", "mov", "rgb48be", 16),
     ("png", "mov", "rgb24", 8), ("rawvideo", "avi", "bgr24", 8), ("ffv1", "mkv", "bgr0", 8)],
)  # fmt: skip
def test_red_green_and_blue_keep_their_bits(tmp_path: Path, codec: str, suffix: str, kind: str, bits: int) -> None:
    rgb = np.random.default_rng(6).integers(0, 2**bits, (24, 32, 3)).astype(np.uint16)
    g, b, r = (rgb[..., c] for c in (1, 2, 0))
    packed = {"rgb": rgb, "bgr": rgb[..., ::-1], "bgr0": np.dstack([rgb[..., ::-1], 0 * r])}
    planes = [g, b, r] if kind.startswith("gbrp") else [packed["bgr0" if kind == "bgr0" else kind[:3]]]
    path = write_packed(tmp_path / f"a.{suffix}", codec, kind, planes)
    from labcdp.files.formats.colour import luminance_dn

    expected = luminance_dn(rgb if bits > 8 else rgb.astype(np.uint8), bits, "srgb")
    np.testing.assert_array_equal(read(path)[0], expected)


def write_packed(path: Path, codec: str, kind: str, planes: list[Pixels]) -> Path:
    """One frame; colours that lie in one plane are given as (height, width, colours)."""
    import av

    height, width = planes[0].shape[:2]
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.height, stream.width, stream.pix_fmt = height, width, kind
        frame = av.VideoFrame(width, height, kind)
        dtype = "u1" if frame.format.components[0].bits == 8 else ">u2" if frame.format.is_big_endian else "<u2"
        for plane, values in zip(frame.planes, planes, strict=True):
            rows = np.zeros((plane.buffer_size // plane.line_size, plane.line_size), np.uint8)
            data = np.ascontiguousarray(values.reshape(height, -1).astype(dtype)).view(np.uint8)
            rows[:height, : data.shape[1]] = data
            plane.update(rows.tobytes())
        frame.pts = 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(
    ("color_trc", "encoding"), [(LINEAR, "linear"), (SRGB, "srgb"), (BT709, "bt709"), (SMPTE170M, "bt709"), (2, "srgb")]
)
def test_the_transfer_is_the_one_that_is_stated(tmp_path: Path, color_trc: int, encoding: str) -> None:
    path = write(tmp_path / "a.mp4", "libx264", "yuv420p", moving(3), color_trc=color_trc)
    assert open_video(path).encoding == encoding
    assert open_video(path, PictureOptions(encoding="linear")).encoding == "linear"


def test_a_transfer_that_is_not_read_is_named(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", "libx264", "yuv420p", moving(3), color_trc=16)
    assert "video-transfer-unknown" in codes(path)


@pytest.mark.parametrize("coloured", [False, True])
def test_jpeg_equals_motion_jpeg(tmp_path: Path, coloured: bool) -> None:
    rng = np.random.default_rng(8)
    blocks = rng.integers(20, 236, (15, 20, 3), dtype=np.uint8)
    image = np.kron(blocks if coloured else blocks[..., :1].repeat(3, 2), np.ones((8, 8, 1), np.uint8))
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=95, subsampling=0 if coloured else 2)
    (tmp_path / "a.jpg").write_bytes(buffer.getvalue())
    path = mux_jpegs(tmp_path / "a.mkv", [buffer.getvalue()] * 2, [0, 40])
    picture, video = light(tmp_path / "a.jpg"), light(path)
    # Two decoders; the standard allows 1 DN (ITU-T T.83), and of grey the steps of sRGB are at most 2.3 / 255.
    np.testing.assert_allclose(video, picture, atol=2.3 * (2 if coloured else 1) / 255)
    assert abs(float(video.mean() / picture.mean()) - 1) < 1e-3


def test_a_picture_equals_a_video_of_one_frame_at_any_depth(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    scene = rng.uniform(0.05, 0.9, (40, 60))
    for bits, kind in ((8, "gray"), (12, "gray12le"), (16, "gray16le")):
        dn = np.floor(scene * 2**bits).astype(np.uint8 if bits == 8 else np.uint16)
        (tmp_path / str(bits)).mkdir()
        Image.fromarray(dn).save(tmp_path / str(bits) / "a.png")
        write(tmp_path / f"{bits}.mkv", "ffv1", kind, [dn])
        options = PictureOptions(bit_depth=bits)
        source = open_video(tmp_path / f"{bits}.mkv", options)
        conversion = picture_conversion(None, None, source.encoding)
        (video,) = [
            conversion.convert(one.frame).luminance_cd_m2 for one in frames_of(source, Selection()) if one.frame
        ]
        picture = conversion.luminance(read_picture(tmp_path / str(bits) / "a.png", options)).luminance_cd_m2
        (folder,) = read(tmp_path / str(bits), options)
        np.testing.assert_array_equal(video, picture)
        np.testing.assert_array_equal(folder, dn)
        np.testing.assert_allclose(video, scene, atol=2.0**-bits)


@pytest.mark.parametrize(("turned", "times"), [(90, 1), (180, 2), (270, 3)])
def test_frames_are_turned_upright(tmp_path: Path, turned: int, times: int) -> None:
    """A display rotation is counter-clockwise, as is numpy's."""
    image = moving(1)[0]
    path = write(tmp_path / "a.mov", "png", "gray", [image] * 2, turned=turned)
    np.testing.assert_array_equal(read(path)[0], np.rot90(image, times))
    assert "turned" in codes(path)
    assert open_video(path).shape == np.rot90(image, times).shape


@pytest.mark.parametrize(
    ("codec", "suffix", "options"),
    [("mpeg4", "avi", {"bf": "2"}), ("mpeg4", "mp4", {"bf": "2"}), ("libx264", "mp4", {"bf": "3"}),
     ("libx265", "mkv", {"x265-params": "log-level=none"}), ("libvpx-vp9", "webm", {}),
     ("libvpx", "webm", {"auto-alt-ref": "1"}), ("mpeg2video", "mpg", {"bf": "2"})],
)  # fmt: skip
def test_frames_of_codecs_that_reorder_are_counted_right(
    tmp_path: Path, codec: str, suffix: str, options: dict[str, str]
) -> None:
    images = bars()
    path = write(tmp_path / f"a.{suffix}", codec, "yuv420p", images, options | {"b": "4000000", "g": "6"})
    frames = list(frames_of(open_video(path, PictureOptions(encoding="linear")), Selection()))
    assert [(one.number, one.fault) for one in frames] == [(number, None) for number in range(N)]
    assert [one.time_s for one in frames] == pytest.approx([number / 25 for number in range(N)], abs=2e-3)
    bar = [round((float(one.grey[:, 3:10].mean()) * 219 / 255) / 16) for one in frames]
    assert bar == list(range(N))


def test_variable_frame_rate_is_timed_by_the_container(tmp_path: Path) -> None:
    times = [0, 40, 80, 200, 210, 260]
    images = [jpeg(image) for image in bars(6)]
    for suffix in ("mkv", "mp4"):
        frames = list(frames_of(open_video(mux_jpegs(tmp_path / f"vfr.{suffix}", images, times)), Selection()))
        assert [one.time_s for one in frames] == pytest.approx([time / 1000 for time in times])


def jpeg(image: Pixels) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=95)
    return buffer.getvalue()


def test_frames_of_another_size_are_reported_by_their_numbers(tmp_path: Path) -> None:
    images = [jpeg(image) for image in [*bars(3), *bars(2, (96, 64)), *bars(3)]]
    frames = list(frames_of(open_video(mux_jpegs(tmp_path / "c.mkv", images, list(range(0, 320, 40)))), Selection()))
    faults = {one.number: finding_text(one.fault) for one in frames if one.fault}
    assert faults == dict.fromkeys((3, 4), "has 96 x 64 pixels, the video has 160 x 120")


def test_interlaced_video_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", "libx264", "yuv420p", moving(4), {"x264-params": "tff=1"})
    with pytest.raises(InputError, match=r"a\.mp4 is interlaced, each frame holds two moments: deinterlace it"):
        open_video(path)


@pytest.mark.parametrize(
    ("name", "data", "text"),
    [
        ("empty.mp4", b"", r"empty\.mp4 is empty"),
        ("text.mp4", b"this is no video\n" * 50, r"text\.mp4 is no video that FFmpeg reads"),
        ("list.m3u8", b"#EXTM3U\n#EXTINF:1,\n/etc/hostname\n#EXT-X-ENDLIST\n", r"list\.m3u8 is no video"),
        ("list.txt", b"ffconcat version 1.0\nfile /etc/hostname\n", r"list\.txt is no video"),
        (None, None, r"none\.mp4 cannot be read \(No such file or directory\)"),
    ],
)
def test_what_is_not_a_video_is_refused_in_one_line(tmp_path: Path, name: str | None, data: bytes, text: str) -> None:
    path = tmp_path / (name or "none.mp4")
    if name is not None:
        path.write_bytes(data)
    with pytest.raises(InputError, match=text) as error:
        open_video(path)
    assert "\n" not in str(error.value)


def test_too_large_frames_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", "ffv1", "gray", bars(2))
    with pytest.raises(InputError, match=r"frames of 160 x 120 pixels, more than 0\.01 megapixels"):
        open_video(path, PictureOptions(max_pixels=10_000))


def test_a_video_leaves_other_libraries_as_they_are(tmp_path: Path) -> None:
    from av import logging as av_logging

    before = cv2.utils.logging.getLogLevel(), dict(os.environ), av_logging.get_level()
    read(write(tmp_path / "a.mkv", "ffv1", "gray", bars(2)))
    assert (cv2.utils.logging.getLogLevel(), dict(os.environ), av_logging.get_level()) == before


def test_the_output_states_how_values_were_taken(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", "libx264", "yuv420p", moving(3))
    notes = str(evaluate_video(path, VideoSettings((1.0,))).attrs["findings"])
    assert all(code in notes for code in ("video-encoding", "video-limited-range", "srgb-assumed"))


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


def test_positions_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="every is 0"):
        Selection(every=Position(frames=0))
    with pytest.raises(InputError, match="stop 5 is not behind start 5"):
        Selection(Position(frames=5), Position(frames=5))


def test_video_files_of_a_folder(tmp_path: Path) -> None:
    for name in ("b.avi", "a.mp4", "readme.txt"):
        (tmp_path / name).write_bytes(b"x")
    images_only = tmp_path / "images"
    images_only.mkdir()
    assert video_paths([tmp_path]) == [tmp_path / "a.mp4", tmp_path / "b.avi"]
    assert video_paths([images_only, tmp_path / "b.avi"]) == [images_only, tmp_path / "b.avi"]
    assert left_out(tmp_path) == []
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(images_only / "0.png")
    assert left_out(tmp_path) == [images_only]
