"""CDP of videos, against brute force on the frames that were written; several pairs in one pass."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from math import isnan, nan
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import labcdp
from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.converter import make_converter
from labcdp.evaluate.picture.neighbours import evaluate_neighbours
from labcdp.evaluate.video.evaluate import evaluate_parts, evaluate_video
from labcdp.evaluate.video.run import region_pixels
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.files import PictureOptions, frame_of_pixels, read_picture
from labcdp.files.video.selection import Position, Selection
from labcdp.files.video.source import VideoFrame, stored_pixels
from labcdp.metrics import DetectionInterval, cdp_neighbours
from labcdp.metrics.neighbours.tables import NeighbourTables
from labcdp.metrics.pair import evaluate_pair, evaluate_regions

from .videos import BRIGHT, CONTRASTS, MOVING, STILL, brute_force, driving, fixed, scenes, write


def found(result: xr.Dataset, code: str, subject: str = "") -> dict[str, Any]:
    """Return the values of the finding about a video that has a code."""
    (values,) = [
        one["values"]
        for one in json.loads(result.attrs["findings"])
        if (one["code"], one["subject"]) == (code, subject)
    ]
    return dict(values)


def test_each_frame_is_that_of_brute_force_and_shown_to_an_observer(tmp_path: Path) -> None:
    frames, seen = scenes(), []
    result = evaluate_video(
        write(tmp_path / "a.mkv", frames), fixed(), observer=lambda number, grey, *_: seen.append((number, grey.copy()))
    )
    for number, image in enumerate(frames):
        row = result.isel(frame=number)
        a, b = image[20:40, 20:44], image[20:40, 60:84]
        expected = np.array([brute_force(a, b, contrast) for contrast in CONTRASTS])
        found = np.transpose([row[name].values for name in ("below", "cdp", "above")])
        np.testing.assert_allclose(found, expected, atol=1e-12)
        assert row["measured_contrast"] == pytest.approx(a.mean() / b.mean() - 1)
        assert row["mean"].values * 256 == pytest.approx([a.mean(), b.mean()], rel=1e-6)
        assert row["snr"].values == pytest.approx([x.mean() / x.std(ddof=1) for x in (a, b)])
        np.testing.assert_array_equal(row["centre_x"], [32, 72])
        assert seen[number][0] == row["frame"]
        np.testing.assert_array_equal(seen[number][1], image)
    np.testing.assert_allclose(result["time_s"], np.arange(8) / 25)
    assert (result["note"] == "").all()
    assert not result["lost"].any()


def resumed_after(n_frames: int, path: Path, settings: VideoSettings, folder: Path) -> xr.Dataset:
    """Evaluate in a folder, then resume from its journal cut after some frames; both give the same."""
    result = evaluate_video(path, settings, folder)
    journal = folder / "video.jsonl"
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[: 1 + n_frames]))
    xr.testing.assert_identical(evaluate_video(path, settings, folder), result)
    return result


def test_without_a_contrast_that_of_the_first_measured_frame_is_to_be_detected(tmp_path: Path) -> None:
    frames = scenes(4)
    frames[0][:] = 0
    path = write(tmp_path / "a.mkv", frames)
    result = resumed_after(2, path, fixed(contrasts=None), tmp_path / "out")
    measured = result["measured_contrast"].values[1]
    assert result["contrast"].values.tolist() == [measured]
    assert np.isnan(result["cdp"].values[0]).all()
    xr.testing.assert_identical(result["cdp"], evaluate_video(path, fixed(contrasts=(measured,)))["cdp"])
    assert found(result, "contrast-measured") == {"frame": 1, "contrast": measured}
    near = resumed_after(2, write(tmp_path / "b.mkv", frames[1:]), VideoSettings(None), tmp_path / "near")
    converter = make_converter()
    cv2.imwrite(str(tmp_path / "0.png"), frames[1])
    picture = evaluate_neighbours(converter.luminance(read_picture(tmp_path / "0.png", converter.options)))
    assert near["contrast"].values == pytest.approx([picture.contrast.value])
    assert near["cdp"].values[0] == pytest.approx(picture.cdp.cdp)
    assert found(near, "neighbour-contrast-measured")["frame"] == 0


_EPSILONS = st.one_of(
    st.floats(0.05, 1.0), st.sampled_from([DetectionInterval.at_least(0.3), DetectionInterval(0.1, 0.9)])
)


@settings(max_examples=20)
@given(
    st.integers(1, 20), st.integers(1, 20), st.integers(0, 2**32 - 1), st.integers(0, 250), st.integers(1, 255),
    st.lists(st.floats(0.01, 20), min_size=1, max_size=4, unique=True), _EPSILONS, st.integers(0, 60),
)  # fmt: skip
def test_tables_give_what_the_metric_gives(
    height: int, width: int, seed: int, least: int, spread: int, contrasts: list[float], epsilon: Any, black: int
) -> None:
    rng = np.random.default_rng(seed)
    dn = rng.integers(least, min(least + spread, 255) + 1, (height, width)).astype(np.uint8)
    light = ((np.arange(256) - black) / 256).astype(np.float32)
    if dn.size < 2 or light[dn].max() <= 0:
        return
    found = NeighbourTables(light, contrasts, epsilon).evaluate(dn)
    for one, other in zip(found, cdp_neighbours(light[dn].astype(float), contrasts, epsilon), strict=True):
        names = ("cdp", "below", "above", "undefined", "pairs", "detected_range")
        assert [getattr(one, name) for name in names] == [getattr(other, name) for name in names]
        assert [one.u, *one.interval] == pytest.approx([other.u, *other.interval], rel=1e-7, abs=1e-7, nan_ok=True)


def test_neighbours_take_any_number_of_contrasts(tmp_path: Path) -> None:
    path, contrasts = write(tmp_path / "a.mkv", scenes()[:1]), tuple(np.linspace(0.01, 2, 130).tolist())
    many = evaluate_video(path, VideoSettings(contrasts))
    few = evaluate_video(path, VideoSettings(contrasts[::10]))
    np.testing.assert_allclose(many["cdp"].values[:, ::10], few["cdp"].values, rtol=1e-12)


def test_broken_frames_are_nan_and_cost_only_themselves(tmp_path: Path) -> None:
    frames = scenes()
    for number, image in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    whole = evaluate_video(tmp_path, fixed())
    data = (tmp_path / "3.png").read_bytes()
    (tmp_path / "3.png").write_bytes(data[:500])
    cv2.imwrite(str(tmp_path / "5.png"), frames[5][:, :100])
    result = evaluate_video(tmp_path, fixed())
    assert all(result["note"].values[[3, 5]])
    assert np.isnan(result["cdp"].values[[3, 5]]).all()
    kept = [0, 1, 2, 4, 6, 7]
    xr.testing.assert_identical(
        result[["cdp", "mean"]].isel(frame=kept).drop_attrs(), whole[["cdp", "mean"]].isel(frame=kept).drop_attrs()
    )
    assert found(result, "frames-broken") == {"count": 2, "n_frames": 8, "first": 3}


def test_a_region_that_leaves_the_image_is_lost_and_not_measured(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", driving(24, 8))
    result = evaluate_video(path, VideoSettings((1.0,), (MOVING, STILL)))
    assert not result["lost"].values[:10].any()
    assert result["centre_x"].sel(region="moving").values[10] == pytest.approx(35 + 80, abs=2)
    gone = result["lost"].sel(region="moving").values
    assert gone[-3:].all()
    np.testing.assert_array_equal(np.isnan(result["cdp"].values[:, 0]), gone)
    assert found(result, "frames-lost")["count"] == gone.sum()
    # Frames that are not chosen are followed all the same.
    few = evaluate_video(path, VideoSettings((1.0,), (MOVING, STILL), selection=Selection(every=Position(frames=10))))
    np.testing.assert_array_equal(few["frame"], [0, 10, 20])
    for name in ("centre_x", "cdp"):
        np.testing.assert_array_equal(few[name], result[name].values[::10])


def test_the_reference_is_the_first_measured_frame_or_another_video(tmp_path: Path) -> None:
    frames = scenes(6)
    frames[0][:] = 0
    result = evaluate_video(write(tmp_path / "a.mkv", frames), fixed(reference="first"))
    contrast = result["measured_contrast"].values[1]
    assert isnan(result["reference_contrast"].values[0])
    assert (result["reference_contrast"].values[1:] == contrast).all()
    for number in range(1, 6):
        a, b = frames[number][20:40, 20:44], frames[number][20:40, 60:84]
        assert result["reference_cdp"].values[number] == pytest.approx(brute_force(a, b, contrast)[1], abs=1e-9)
    result["measured_contrast"].values[4] = nan
    result.isel(frame=slice(1, 5)).to_netcdf(tmp_path / "reference.nc")
    other = write(tmp_path / "b.mkv", [image // 2 for image in scenes(6)])
    for by in ("number", "time"):
        asked = evaluate_video(other, fixed(reference=tmp_path / "reference.nc", reference_by=by))
        np.testing.assert_array_equal(asked["reference_contrast"][1:4], result["measured_contrast"][1:4])
        assert np.isfinite(asked["reference_cdp"].values[1:4]).all()
        assert np.isfinite(asked["cdp"].values).all()
        assert list(asked["note"].values != "") == [True, False, False, False, True, True]


def test_the_contrast_of_a_saturated_region_is_not_to_be_trusted(tmp_path: Path) -> None:
    frames = scenes(9)
    for number in (1, 2, 3, 6):
        frames[number][20:40, 20:44] = 255
    # Five of 480 pixels are just above 1 %, four are below.
    frames[7][20, 20:25] = 255
    frames[8][20, 20:24] = 255
    result = evaluate_video(write(tmp_path / "a.mkv", frames), fixed())
    share = [0, 1, 1, 1, 0, 0, 1, 5 / 480, 4 / 480]
    np.testing.assert_allclose(result["saturated"].sel(region="bright"), share)
    assert (result["saturated"].sel(region="dark") == 0).all()
    assert [note != "" for note in result["note"].values] == [one > 0.01 for one in share]
    values = found(result, "frames-region-saturated", "bright")
    assert values == {"limit": 0.01, "count": 5, "n_frames": 9, "frames": ["1 to 3", "6 to 7"]}


def test_a_frame_of_a_colour_filter_is_evaluated_by_its_green_pixels() -> None:
    dn = np.random.default_rng(0).integers(50, 200, (40, 60)).astype(np.uint8)
    dn[::2, ::2], dn[1::2, 1::2] = 250, 3
    frame = frame_of_pixels(dn, PictureOptions(pixel_format="BayerRG8"), datetime(2026, 1, 1, tzinfo=UTC))
    converter = make_converter()
    rois = Roi.rectangle("a", 4, 4, 20, 20), Roi.rectangle("b", 30, 8, 20, 20)
    shown = VideoFrame(0, 0.0, None, lambda: stored_pixels(frame), pixels=stored_pixels(frame))
    found = evaluate_regions(*(region_pixels(shown, converter, roi) for roi in rois), (0.5,))
    assert repr(found) == repr(evaluate_pair(converter.convert(frame), *rois, (0.5,)))
    assert found.a.mean == pytest.approx((dn[4:24:2, 5:24:2].mean() + dn[5:24:2, 4:24:2].mean()) / 2 / 256)


def test_a_video_without_any_result_is_refused_and_leaves_its_folder_free(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", [np.zeros((80, 120), np.uint8)] * 3)
    with pytest.raises(InputError, match="no frame could be evaluated; frame 0: neither region holds a value above 0"):
        evaluate_video(path, fixed(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_repeated_pictures_are_noted_and_kept(tmp_path: Path) -> None:
    frames = scenes(6)
    frames[2], frames[3] = frames[1], frames[1]
    path = write(tmp_path / "a.mkv", frames)
    for asked in (fixed(), VideoSettings(CONTRASTS)):
        result = resumed_after(2, path, asked, tmp_path / asked.mode)
        assert list(result["note"].values != "") == [False, False, True, True, False, False]
        assert np.isfinite(result["cdp"].values).all()
        assert found(result, "frames-repeated") == {"count": 2, "n_frames": 6, "first": 2}


def test_a_file_that_announces_more_frames_than_it_has(tmp_path: Path) -> None:
    path = write(tmp_path / "a.avi", scenes(12))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    result = evaluate_video(str(path), fixed())
    assert found(result, "video-cut-off") == {"announced": 12, "found": result.sizes["frame"]}


def test_a_file_that_ends_before_its_stated_length(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", scenes(100))
    whole = evaluate_video(str(path), fixed())
    assert "video-ends-early" not in whole.attrs["findings"]
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    result = evaluate_video(str(path), fixed())
    last_s = (result.sizes["frame"] - 1) / 25
    assert found(result, "video-ends-early") == {"length_s": 4.0, "found_s": pytest.approx(last_s)}


@pytest.mark.parametrize("suffix", ["mkv", "ts"])
def test_frames_that_follow_each_other_irregularly_and_sound_that_goes_on_are_no_early_end(
    tmp_path: Path, suffix: str
) -> None:
    with av.open(str(path := tmp_path / f"a.{suffix}"), "w") as container:
        stream, sound = container.add_stream("mpeg2video", rate=25), container.add_stream("mp2", rate=48000)
        stream.height, stream.width, stream.pix_fmt = *scenes(1)[0].shape, "yuv420p"
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 48000 * 6), np.int16), "s16", "mono")
        silence.sample_rate = 48000
        container.mux(sound.encode(silence))
        for number, image in enumerate(scenes(12)):
            frame = av.VideoFrame.from_ndarray(image, "gray").reformat(format="yuv420p")
            frame.pts = number if number < 6 else 3 * number
            container.mux(stream.encode(frame))
        container.mux([*stream.encode(None), *sound.encode(None)])
    findings = evaluate_video(str(path), fixed()).attrs["findings"]
    assert "video-ends-early" not in findings
    assert "video-cut-off" not in findings


def test_pairs_and_neighbours_in_one_pass_are_as_each_alone_also_when_resumed(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", scenes())
    ground = Roi.rectangle("ground", 90, 50, 20, 20)
    asked = [fixed(), fixed(rois=(ground, BRIGHT), contrasts=None), VideoSettings((0.5, 1.0))]
    alone = [evaluate_video(path, one) for one in asked]
    folders = [tmp_path / str(number) for number in range(len(asked))]
    for told_in_all in (8, 0):
        told: list[int] = []
        together = evaluate_parts(path, asked, folders, progress=lambda done, _total, told=told: told.append(done))
        for one, result in zip(together, alone, strict=True):
            xr.testing.assert_identical(one, result)
        # The video is gone through once, and what is known is not done again.
        assert len(told) == told_in_all


def test_a_region_that_cannot_be_followed_costs_only_its_own_pairs(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    frames = []
    for number in range(4):
        image = np.full((240, 640), 60.0)
        image[20:60, 20 + number : 60 + number] = rng.normal(150, 4, (40, 40))
        image[30:50, 70 + number : 90 + number] = rng.normal(90, 4, (20, 20))
        frames.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    bright, middle = Roi.rectangle("bright", 30, 30, 20, 20), Roi.rectangle("middle", 73, 33, 14, 14)
    plain, across = Roi.rectangle("plain", 500, 100, 20, 20), Roi.rectangle("across", 45, 30, 20, 20)
    path = write(tmp_path / "a.mkv", frames)
    pairs = [(bright, plain), (bright, middle), (across, bright)]
    folders = [tmp_path / str(n) for n in range(len(pairs))]
    for _ in range(2):
        none, good, apart = evaluate_parts(path, [VideoSettings((1.0,), pair) for pair in pairs], folders)
        assert np.isfinite(good["cdp"]).all()
        for error, message in (
            (none, "region 'plain' cannot be followed"),
            (apart, "'across' and 'bright' have 100 pixels in common"),
        ):
            assert isinstance(error, InputError)
            assert message in str(error)
    regions = labcdp.open_video(path).track([bright, middle, plain], pairs=[("bright", "plain"), ("bright", "middle")])
    result = regions.cdp([1.0])
    assert result["pair"].values.tolist() == ["bright / middle"]
    assert "no result of bright / plain: region 'plain' cannot be followed" in result.attrs["warnings"]


def of_two_patches(folder, levels, codec="FFV1"):
    """A video of noise around 40 DN with a bright and a dark patch, of these levels in each frame."""
    rng, frames = np.random.default_rng(8), []
    for bright, dark in levels:
        image = rng.normal(40, 12, (80, 120))
        image[20:40, 20:44] = rng.normal(bright, 1, (20, 24))
        image[20:40, 60:84] = rng.normal(dark, 1, (20, 24))
        frames.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return write(folder / "patches.avi", frames, codec)


def linear_of_srgb(dn):
    """IEC 61966-2-1."""
    return ((dn / 255 + 0.055) / 1.055) ** 2.4


@pytest.mark.parametrize("encoding", [None, "linear"])
def test_another_encoding_is_weighed_for_the_regions_in_all_frames(tmp_path, encoding):
    """In the first frames the regions are alike, and so by any encoding; in the last ones they are not."""
    video = of_two_patches(tmp_path, [(100, 100)] * 3 + [(200, 100), (220, 100)])
    dataset = evaluate_video(video, fixed(encoding=encoding))
    found = [one for one in json.loads(dataset.attrs["findings"]) if one["code"].startswith("encoding-assumed")]
    assert len(found) == (encoding is None)
    for one in found:
        assert (one["code"], one["subject"]) == ("encoding-assumed-frames", "bright / dark")
        values = one["values"]
        assert (values["count"], values["n_frames"], values["frame"]) == (2, 5, 4)
        srgb = linear_of_srgb(220) / linear_of_srgb(100) - 1
        both = sorted([values["taken"], values["otherwise"]])
        assert both == pytest.approx([1.2, srgb], rel=0.02)


def test_an_encoding_that_matters_in_no_frame_is_not_doubted(tmp_path):
    dataset = evaluate_video(of_two_patches(tmp_path, [(100, 100)] * 3), fixed())
    assert not [one for one in json.loads(dataset.attrs["findings"]) if one["code"].startswith("encoding-assumed")]
