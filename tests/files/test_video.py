"""Videos, and images as videos: every pixel, number and time against what was written."""

import io
from contextlib import suppress

import av
import numpy as np
import pytest
import tifffile
from av.stream import Disposition
from PIL import Image

from labcdp.core.errors import InputError
from labcdp.core.result import info
from labcdp.evaluate.picture.converter import make_converter
from labcdp.files import PictureOptions, read_picture
from labcdp.files.stored_image import luminance_dn
from labcdp.files.video.open import open_video
from labcdp.files.video.selection import Position, Selection
from labcdp.files.video.source import VideoFrame, VideoSource, frames_of

from .video_files import SIZE, N, bars, frames, moving, mux_jpegs, remux, write

#: Numbers of ITU-T H.273: transfer, matrix, range of FFmpeg.
BT709, SMPTE170M, LINEAR, SRGB = 1, 6, 8, 13
LIMITED, FULL = 1, 2


def read(path, **options):
    """DN of all frames."""
    return [one.frame.dn for one in frames(path, **options)]


def codes(path):
    return [one.code for one in open_video(path).findings]


def jpeg(image, **how):
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=95, **how)
    return buffer.getvalue()


# Values


@pytest.mark.parametrize(
    ("codec", "suffix", "kind", "bits"),
    [
        ("ffv1", "mkv", "gray", 8), ("rawvideo", "avi", "gray", 8), ("ffv1", "mkv", "gray12le", 12),
        ("png", "mov", "gray16be", 16),
    ],
)  # fmt: skip
def test_lossless_grey_is_read_as_it_was_written_and_as_pictures_of_it_are(tmp_path, codec, suffix, kind, bits):
    written = list(np.random.default_rng(3).integers(0, 2**bits, (N, 48, 64)).astype("u2" if bits > 8 else "u1"))
    path = write(tmp_path / f"a.{suffix}", codec, kind, written)
    source, found = open_video(path), frames(path)
    assert [one.number for one in found] == list(range(N))
    assert [one.time_s for one in found] == pytest.approx([number / 25 for number in range(N)], abs=1e-3)
    np.testing.assert_array_equal([one.frame.dn for one in found], written)
    assert {one.frame.bit_depth for one in found} == {bits}
    assert (source.shape, source.frame_count, source.frame_rate) == ((48, 64), N, 25.0)
    assert source.encoding == "linear"
    Image.fromarray(written[0]).save(tmp_path / "a.png")
    converter = make_converter(None, None, source.encoding)
    picture = converter.luminance(read_picture(tmp_path / "a.png", PictureOptions(bit_depth=bits)))
    np.testing.assert_array_equal(converter.convert(found[0].frame).luminance_cd_m2, picture.luminance_cd_m2)
    np.testing.assert_allclose(picture.luminance_cd_m2, written[0] / 2.0**bits, atol=2.0**-bits)


@pytest.mark.parametrize(("kind", "bits"), [("yuv420p", 8), ("yuv422p10le", 10), ("yuv420p16le", 16)])
@pytest.mark.parametrize("color_range", [LIMITED, FULL])
def test_the_range_is_the_one_that_is_stated(tmp_path, kind, bits, color_range):
    """ITU-R BT.601 and BT.709: 16 to 235, times 2^(bits - 8)."""
    luma = np.linspace(0, 2**bits - 1, 64 * 64).astype(np.uint16).reshape(64, 64)
    (found,) = read(write(tmp_path / "a.mkv", "ffv1", kind, [luma], color_range=color_range))
    expected = luma.astype(float)
    if color_range == LIMITED:
        expected = (expected / 2 ** (bits - 8) - 16) / 219 * (2**bits - 1)
    np.testing.assert_array_equal(found, np.rint(expected.clip(0, 2**bits - 1)))


@pytest.mark.parametrize(
    ("kind", "bits", "colorspace", "color_range"),
    [
        ("yuv444p", 8, BT709, LIMITED), ("yuv444p", 8, SMPTE170M, FULL), ("yuv444p10le", 10, BT709, FULL),
        ("yuv444p16le", 16, SMPTE170M, LIMITED), ("yuv420p", 8, BT709, LIMITED),
    ],
)  # fmt: skip
def test_colours_become_the_luminance_of_their_matrix_and_transfer(tmp_path, kind, bits, colorspace, color_range):
    """ITU-T H.273, 8.3, for the matrix; IEC 61966-2-1 for sRGB; BT.709 for the luminance."""
    k_r, k_b = (0.2126, 0.0722) if colorspace == BT709 else (0.299, 0.114)
    r, g, b = np.random.default_rng(5).uniform(0.05, 0.95, (3, 12, 16)).repeat(2, axis=1).repeat(2, axis=2)
    y = k_r * r + (1 - k_r - k_b) * g + k_b * b
    cb, cr = (b - y) / (2 - 2 * k_b), (r - y) / (2 - 2 * k_r)
    unit, top, half = 2 ** (bits - 8), 2**bits - 1, 2 ** (bits - 1)
    if color_range == LIMITED:
        planes = unit * (16 + 219 * y), unit * (128 + 224 * cb), unit * (128 + 224 * cr)
    else:
        planes = top * y, top * cb + half, top * cr + half
    n = 2 if kind == "yuv420p" else 1
    stored = tuple(np.rint(one[::k, ::k]).astype(np.uint16) for one, k in zip(planes, (1, n, n), strict=True))
    path = write(tmp_path / "a.mkv", "ffv1", kind, [stored], color_range=color_range, colorspace=colorspace)
    linear = [np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for c in (r, g, b)]
    true = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    # Slopes of sRGB are at most 2.3, and rounding of Y', Cb and Cr adds up to some steps in each colour.
    (found,) = frames(path)
    np.testing.assert_allclose(found.frame.dn / 65535, true, atol=2.3 * 2.5 / (219 * unit) + 1e-5)
    np.testing.assert_array_equal(found.pixels.part(np.s_[3:17, 5:22]).dn, found.frame.dn[3:17, 5:22])


@pytest.mark.parametrize("encoding", ["srgb", "linear"])
def test_dark_colours_are_not_rounded_to_8_bits(tmp_path, encoding):
    """Of a limited range, values just above black were off by up to 14 % (17 as 1 of 255, which is 1.16)."""
    luma = np.tile(np.arange(17, 49, dtype=np.uint16), (24, 1))
    chroma = np.full((24, 32), 128, np.uint16)
    chroma[:, -1] = 140  # so that it has colours
    path = write(tmp_path / "a.mkv", "ffv1", "yuv444p", [(luma, chroma, chroma)] * 2, color_range=LIMITED)
    seen = next(iter(frames(path, encoding=encoding))).frame.dn[:, :-1] / 65535
    value = (luma[:, :-1] - 16.0) / 219
    light = value if encoding == "linear" else np.where(
        value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4
    )  # fmt: skip
    # Half a step of the 12 bits of a colour, and of the 16 bits of light.
    half_step = 0.5 / 4095 / value / (1 if encoding == "linear" else 1 / 2.4) + 0.5 / 65535 / light
    np.testing.assert_array_less(np.abs(seen / light - 1), half_step + 1e-6)


@pytest.mark.parametrize("code", [8, 10, 14])
def test_colours_of_another_matrix_are_refused_and_greys_read(tmp_path, code):
    y = np.full((16, 16), 100, np.uint8)
    grey, coloured = (y, y * 0 + 128, y * 0 + 128), (y, y * 0 + 90, y * 0 + 160)
    assert read(write(tmp_path / "a.mkv", "ffv1", "yuv444p", [grey], color_range=FULL, colorspace=code))[0][0, 0] == 100
    with pytest.raises(InputError, match=f"matrix coefficients {code} .*ffmpeg"):
        read(write(tmp_path / "b.mkv", "ffv1", "yuv444p", [coloured], color_range=FULL, colorspace=code))


def test_a_limited_range_of_red_green_and_blue_is_named(tmp_path):
    rgb = np.full((16, 16, 4), 100, np.uint8)
    assert "video-rgb-range" in codes(write(tmp_path / "a.mkv", "ffv1", "bgr0", [rgb], color_range=LIMITED))


@pytest.mark.parametrize(
    ("codec", "suffix", "kind", "bits"),
    [("ffv1", "mkv", "gbrp10le", 10), ("png", "mov", "rgb48be", 16), ("rawvideo", "avi", "bgr24", 8),
     ("ffv1", "mkv", "bgr0", 8)],
)  # fmt: skip
def test_red_green_and_blue_keep_their_bits(tmp_path, codec, suffix, kind, bits):
    rgb = np.random.default_rng(6).integers(0, 2**bits, (24, 32, 3)).astype("u2" if bits > 8 else "u1")
    planes = {
        "gbr": tuple(rgb[..., c] for c in (1, 2, 0)),
        "rgb": rgb,
        "bgr": np.dstack([rgb[..., ::-1], 0 * rgb[..., 0]])[..., : 4 if kind == "bgr0" else 3],
    }
    path = write(tmp_path / f"a.{suffix}", codec, kind, [planes[kind[:3]]])
    np.testing.assert_array_equal(read(path)[0], luminance_dn(rgb, bits, "srgb"))


@pytest.mark.parametrize(
    ("color_trc", "encoding"),
    [
        (LINEAR, "linear"),
        (SRGB, "srgb"),
        (BT709, "bt709"),
        (SMPTE170M, "bt709"),
        (2, "srgb"),
        (4, "gamma 2.2"),
        (16, "pq"),
        (18, "hlg"),
    ],
)
def test_the_transfer_is_the_one_that_is_stated(tmp_path, color_trc, encoding):
    path = write(tmp_path / "a.mp4", "libx264", "yuv420p", moving(3), color_trc=color_trc)
    assert open_video(path).encoding == encoding
    assert "video-transfer-unknown" not in codes(path)
    assert open_video(path, PictureOptions(encoding="linear")).encoding == "linear"


@pytest.mark.parametrize("coloured", [False, True])
def test_jpeg_equals_motion_jpeg(tmp_path, coloured):
    blocks = np.random.default_rng(8).integers(20, 236, (15, 20, 3), dtype=np.uint8)
    image = np.kron(blocks if coloured else blocks[..., :1].repeat(3, 2), np.ones((8, 8, 1), np.uint8))
    data = jpeg(image, subsampling=0 if coloured else 2)
    (tmp_path / "a.jpg").write_bytes(data)
    path = mux_jpegs(tmp_path / "a.mkv", [data] * 2, [0, 40])
    picture = make_converter().luminance(read_picture(tmp_path / "a.jpg")).luminance_cd_m2
    video = make_converter(None, None, open_video(path).encoding).convert(frames(path)[0].frame).luminance_cd_m2
    # Two decoders; the standard allows 1 DN (ITU-T T.83), and of grey the steps of sRGB are at most 2.3 / 255.
    np.testing.assert_allclose(video, picture, atol=2.3 * (2 if coloured else 1) / 255)
    assert abs(float(video.mean() / picture.mean()) - 1) < 1e-3


# Frames


@pytest.mark.parametrize(("turned", "times"), [(90, 1), (180, 2), (270, 3)])
def test_frames_are_turned_upright(tmp_path, turned, times):
    """A display rotation is counter-clockwise, as is numpy's."""
    image = moving(1)[0]
    path = write(tmp_path / "a.mov", "png", "gray", [image] * 2, turned=turned)
    np.testing.assert_array_equal(read(path)[0], np.rot90(image, times))
    assert open_video(path).shape == np.rot90(image, times).shape


@pytest.mark.parametrize(
    ("codec", "suffix", "options"),
    [("mpeg4", "avi", {"bf": "2"}), ("libx264", "mp4", {"bf": "3"}),
     ("libx265", "mkv", {"x265-params": "log-level=none"}), ("libvpx-vp9", "webm", {}),
     ("libvpx", "webm", {"auto-alt-ref": "1"}), ("mpeg2video", "mpg", {"bf": "2"})],
)  # fmt: skip
def test_frames_of_codecs_that_reorder_are_counted_right(tmp_path, codec, suffix, options):
    path = write(tmp_path / f"a.{suffix}", codec, "yuv420p", bars(), options | {"b": "4000000", "g": "6"})
    found = frames(path, encoding="linear")
    assert [(one.number, one.fault) for one in found] == [(number, None) for number in range(N)]
    assert [one.time_s for one in found] == pytest.approx([number / 25 for number in range(N)], abs=2e-3)
    assert [round((float(one.grey[:, 3:10].mean()) * 219 / 255) / 16) for one in found] == list(range(N))


def test_times_are_those_of_the_container_and_frames_of_another_size_are_named(tmp_path):
    times, images = [0, 40, 80, 200, 210, 260], [jpeg(image) for image in [*bars(3), *bars(2, (96, 64)), *bars(1)]]
    for suffix in ("mkv", "mp4"):
        found = frames(mux_jpegs(tmp_path / f"vfr.{suffix}", [images[0]] * 6, times))
        assert [one.time_s for one in found] == pytest.approx([time / 1000 for time in times])
    found = frames(mux_jpegs(tmp_path / "sizes.mkv", images, times))
    assert [one.fault and one.fault.code for one in found] == [None] * 3 + ["frame-size-differs"] * 2 + [None]


KEYS = "keyint=4:min-keyint=4:scenecut=0:open-gop=1"


@pytest.mark.parametrize(
    ("codec", "suffix", "options", "remuxed"),
    [
        # An edit list that starts after five frames; one with a delay; packets of frames that others only refer to.
        ("libx264", "mp4", {"x264-params": KEYS}, {"earlier_by": 5}),
        ("libx264", "mov", {"x264-params": KEYS}, {"earlier_by": -7}),
        ("libvpx-vp9", "webm", {"lag-in-frames": "16", "auto-alt-ref": "1"}, {"bsf": "vp9_superframe_split"}),
        # Cut from a longer video: at a key frame that others before it in time refer past, and between key frames.
        *[(codec, suffix, {f"{codec[3:]}-params": KEYS}, {"first": first})
          for codec, suffix in (("libx264", "ts"), ("libx264", "mkv"), ("libx265", "mkv")) for first in ("key", 2)],
        ("mpeg2video", "ts", {"bf": "2", "g": "6"}, {"first": 4}),
    ],
)  # fmt: skip
def test_frames_that_are_not_shown_are_not_counted(tmp_path, codec, suffix, options, remuxed):
    """As another program counts them: PyAV with its own settings; and the others are sound."""
    # Matroska does not state the order of decoding.
    whole = write(
        tmp_path / f"whole.{suffix.replace('mkv', 'mp4')}", codec, "yuv420p", bars(), options | {"b": "4000000"}
    )
    path = remux(whole, tmp_path / f"a.{suffix}", **remuxed)
    with av.open(str(path)) as container:
        others = [one.to_ndarray(format="gray")[:, 3:10].mean() for one in decoded(container)]
    source, found = open_video(path), frames(path, encoding="linear")
    assert [(one.number, one.fault) for one in found] == [(number, None) for number in range(len(others))]
    assert found[0].time_s == 0
    assert [one.grey[:, 3:10].mean() for one in found] == pytest.approx(others, abs=1.5)
    if suffix in ("mp4", "mov"):
        assert source.frame_count == len(others) == N - max(remuxed["earlier_by"], 0)
    selected = frames(path, Selection(Position(seconds=0.08), Position(frames=4)))
    assert [one.number for one in selected] == [2, 3]


def decoded(container):
    """Frames that PyAV decodes; a packet that cannot be decoded costs no other."""
    for packet in container.demux(container.streams.video[0]):
        with suppress(av.FFmpegError):
            yield from packet.decode()


def test_frames_that_build_on_what_was_cut_off_are_marked(tmp_path):
    """Decoders of MPEG-4 show them, without a mark."""
    whole = write(tmp_path / "whole.mkv", "mpeg4", "yuv420p", moving(12), {"g": "6"})
    found = frames(remux(whole, tmp_path / "a.mkv", first=2))
    assert [one.fault and one.fault.code for one in found] == ["frame-builds-on-broken"] * 4 + [None] * 6


def test_the_picture_of_a_cover_is_no_video(tmp_path):
    path, jpeg_data = tmp_path / "a.m4a", jpeg(bars(1)[0])
    with av.open(str(path), "w", format="mp4") as container:
        sound = container.add_stream("aac", rate=48000)
        cover = container.add_stream("mjpeg", rate=25)
        cover.width, cover.height, cover.pix_fmt, cover.disposition = *SIZE, "yuvj420p", Disposition.attached_pic
        packet = av.Packet(jpeg_data)
        packet.pts = packet.dts = 0
        packet.stream = cover
        container.mux(packet)
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
        silence.sample_rate = 48000
        container.mux([*sound.encode(silence), *sound.encode(None)])
    with pytest.raises(InputError, match=r"a\.m4a holds a cover picture, but no video: give a video"):
        open_video(path)


def test_a_stream_that_contradicts_its_container_is_named(tmp_path):
    colours = np.random.default_rng(3).integers(60, 190, (3, 64, 64), dtype=np.uint8)
    for image in (tuple(colours), colours[0]):
        stated = {"color_range": LIMITED, "color_trc": 1, "color_primaries": 1, "colorspace": BT709}
        path = write(tmp_path / "a.mp4", "libx264", "yuv444p", [image] * 2, {"qp": "1"}, **stated)
        true = frames(path)[0].frame.dn
        told = []
        for change in ({}, {"color_trc": 6}, {"colorspace": SMPTE170M}, {"color_range": FULL}):
            other = remux(path, tmp_path / "b.mp4", **change)
            np.testing.assert_array_equal(frames(other)[0].frame.dn, true)
            named = [one.values["names"] for one in open_video(other).findings if "differ" in one.code]
            told.append(", ".join(named))
        # Codes 1 and 6 are one curve; of greys no matrix counts.
        assert told == ["", "", "matrix 6 and 1" if isinstance(image, tuple) else "", "range 2 and 1"]


def test_further_video_streams_are_named(tmp_path):
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        streams = [container.add_stream("ffv1", rate=25) for _ in range(3)]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 16, 16, "gray"
        for number, stream in enumerate(streams):
            frame = av.VideoFrame.from_ndarray(np.full((16, 16), 50 + number, np.uint8), "gray")
            container.mux([*stream.encode(frame), *stream.encode(None)])
    source = open_video(tmp_path / "a.mkv")
    assert [one.values for one in source.findings if one.code == "video-streams-ignored"] == [{"count": 2}]
    assert [one.frame.dn.max() for one in frames(tmp_path / "a.mkv")] == [50]


# What is refused


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("empty.mp4", b""),
        # Lists name other files.
        ("list.m3u8", b"#EXTM3U\n#EXTINF:1,\n/etc/hostname\n#EXT-X-ENDLIST\n"),
        ("list.txt", b"ffconcat version 1.0\nfile /etc/hostname\n"),
        # Of a photograph, FFmpeg would show the first tile.
        ("a.heic", b"\0\0\0\x18ftypheic\0\0\0\0mif1heic"),
        ("a.mp4", b"\0\0\0\x1cftypmif1\0\0\0\0avifmif1miaf"),
        ("a.webp", b"RIFF\x9a\0\0\0WEBPVP8X\n\0\0\0\x02"),
        ("a.png", b"\x89PNG\r\n\x1a\n"),
        ("a.jpg", jpeg(bars(1)[0])),
    ],
)
def test_what_is_not_a_video_is_refused(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(
        InputError, match=r"is empty|is not a video|which labcdp does not read|, not a video: evaluate it"
    ):
        open_video(tmp_path / name)


@pytest.mark.parametrize(
    "name", ["10:15:00.mp4", "http:a.mp4", "%03d.mp4", "concat:a|b.mp4", "-", "a\nb.mp4", "Pr\udcfcf.mp4"]
)
def test_no_name_is_taken_for_more_than_a_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "a.mp4", "mpeg4", "yuv420p", bars(2)).rename(name)
    assert [one.fault for one in frames(name)] == [None, None]


def test_interlaced_and_too_large_frames_are_refused(tmp_path):
    path = write(tmp_path / "a.mp4", "libx264", "yuv420p", moving(4), {"x264-params": "tff=1"})
    with pytest.raises(InputError, match=r"a\.mp4 is interlaced, each frame holds two moments: deinterlace it"):
        open_video(path)
    with pytest.raises(InputError, match=r"frames of 320 x 240 pixels, more than 0\.01 megapixels"):
        open_video(path, PictureOptions(max_pixels=10_000))


# Which frames and files


@pytest.mark.parametrize(
    ("start", "stop", "every", "numbers"),
    [
        ("3", "7", "1", [3, 4, 5, 6]),
        ("1", None, "4", [1, 5, 9]),
        ("0.1s", "300ms", "1", [3, 4, 5, 6, 7]),
        ("0", None, "100ms", [0, 3, 5, 8, 10]),
        ("0:00.2", None, "0.12s", [5, 8, 11]),
    ],
)
def test_selections_in_frames_and_seconds(start, stop, every, numbers):
    selection = Selection(*(one and Position.parse(one, "--option") for one in (start, stop, every)))
    entries = [VideoFrame(n, 0.04 * n, None, lambda: None) for n in range(12)]
    source = VideoSource("v", (1, 1), 12, 25.0, False, "linear", ())
    assert [one.number for one in frames_of(source, selection, lambda *_: False, entries)] == numbers


def save(path, value, dtype=np.uint8, shape=(20, 30)):
    Image.fromarray(np.full(shape, value, dtype)).save(path)


def test_a_folder_of_images_is_a_video_in_natural_order_with_the_images_numbers(tmp_path):
    for number in (2, 3, 6, 12, 13):
        save(tmp_path / f"run7_{number}_cam2.png", number)
    (tmp_path / "notes.txt").write_text("no image")
    seen = [(one.number, one.time_s, int(one.grey[0, 0])) for one in frames(tmp_path)]
    assert seen == [(2, 0, 2), (3, 1, 3), (6, 4, 6), (12, 10, 12), (13, 11, 13)]
    assert [n.number for n in frames(tmp_path, Selection(Position(frames=1), every=Position(frames=2)))] == [2, 6, 12]
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


@pytest.mark.parametrize("name", ["a.tif", "a.stk"])
def test_pages_of_a_tiff_are_frames(tmp_path, name):
    stack = np.random.default_rng(2).integers(0, 4096, (5, 20, 30), dtype=np.uint16)
    stack[0, 0, 0] = 4095
    tifffile.imwrite(tmp_path / name, stack, photometric="minisblack", compression="zlib")
    found = [one.frame for one in frames(tmp_path / name)]
    np.testing.assert_array_equal([one.dn for one in found], stack)
    assert {one.bit_depth for one in found} == {12}
