"""The same pixels have the same numbers and uncertainties as a picture, as a video and in a session."""

import shutil
from itertools import product

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import labcdp
from labcdp.calibration import save
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.converter import make_converter
from labcdp.evaluate.picture.neighbours import evaluate_neighbours
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.files.read import read_picture
from labcdp.metrics.pair import evaluate_pair

BRIGHT, DARK = Roi.rectangle("bright", 20, 20, 24, 30), Roi.rectangle("dark", 60, 20, 24, 30)
CONTRASTS = (0.5, 1.0, 1.5, 3.0)


def scene(smoothing_px, noise_dn):
    noise = gaussian_filter(np.random.default_rng(3).normal(size=(80, 120)), smoothing_px)
    mean = np.where(np.arange(120) < 50, 149.7, 60.2)
    return np.clip(np.rint(mean + noise_dn * noise / noise.std()), 0, 255).astype(np.uint8)


def picture_of(path, rois, contrasts=CONTRASTS, calibration=None, encoding=None, **epsilon):
    converter = make_converter(calibration, None, encoding)
    return evaluate_pair(converter.luminance(read_picture(path, converter.options)), *rois, contrasts, **epsilon)


def assert_same_as_video(picture, path, rois, **settings):
    video = evaluate_video(path, VideoSettings(CONTRASTS, rois, "fixed", **settings)).isel(frame=0)
    both = (picture.a, picture.b)
    expected = {
        "cdp": picture.cdp.cdp,
        "u_cdp": picture.cdp.u,
        "cdp_low": picture.cdp.interval.low,
        "cdp_high": picture.cdp.interval.high,
        "below": picture.cdp.below,
        "above": picture.cdp.above,
        "measured_contrast": picture.contrast.value,
        "u_measured_contrast": picture.contrast.u,
        "csnr": picture.csnr.value,
        "u_csnr": picture.csnr.u,
        "mean": [one.mean for one in both],
        "u_mean": [one.u for one in both],
        "snr": [one.snr.value for one in both],
        "u_snr": [one.snr.u for one in both],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(video[name], values, rtol=1e-6, err_msg=name)


@pytest.mark.parametrize("encoding", [None, "srgb"])
@pytest.mark.parametrize(("smoothing_px", "noise_dn"), [(0, 12), (1.2, 12), (0, 0.2), (0, 0)])
def test_a_picture_is_a_video_of_one_frame(tmp_path, smoothing_px, noise_dn, encoding):
    """Of independent noise, of correlated noise, and where the noise does not dither the rounding."""
    cv2.imwrite(str(tmp_path / "0.png"), scene(smoothing_px, noise_dn if noise_dn else 1e-9))
    picture = picture_of(tmp_path / "0.png", (BRIGHT, DARK), encoding=encoding)
    assert (picture.cdp.correlation_inflation.max() > 2) == (smoothing_px > 0)
    assert_same_as_video(picture, tmp_path, (BRIGHT, DARK), encoding=encoding)
    rows = [(one.cdp, one.u, *one.interval) for one in picture.cdp]
    in_python = labcdp.read_image(tmp_path / "0.png", encoding=encoding).regions([BRIGHT, DARK]).cdp(CONTRASTS)
    by_hand = labcdp.open_video(tmp_path, encoding=encoding).track([BRIGHT, DARK], "fixed").cdp(CONTRASTS)
    for name, values in zip(("cdp", "u_cdp", "cdp_low", "cdp_high"), np.transpose(rows), strict=True):
        np.testing.assert_allclose(in_python[name].squeeze(), values, rtol=1e-9, err_msg=name)
        np.testing.assert_allclose(by_hand[name].squeeze(), values, rtol=1e-6, err_msg=name)
    if encoding is None and noise_dn == 12 and smoothing_px == 0:
        # Arrays have no places, so correlation and vignetting are seen in pictures only.
        plain = labcdp.read_image(tmp_path / "0.png", no_vignetting=True).regions([BRIGHT, DARK]).cdp(CONTRASTS)
        rows = [plain[name].squeeze() for name in ("cdp", "u_cdp", "cdp_low", "cdp_high")]
        arrays = labcdp.cdp(*(roi.select(scene(0, 12)) for roi in (BRIGHT, DARK)), CONTRASTS)
        np.testing.assert_allclose(rows, [arrays.cdp, arrays.u, *arrays.interval], rtol=1e-9)


@pytest.mark.parametrize("noise", [0.02, 0.15])
def test_8_12_and_16_bits_of_one_scene_agree_within_quantisation(tmp_path, noise):
    mean = np.where(np.arange(120) < 50, 0.6, 0.25)[None, :]
    light = np.clip(mean * (1 + noise * np.random.default_rng(5).normal(size=(80, 120))), 0, 1)
    bright, dark = (roi.select(light) for roi in (BRIGHT, DARK))
    low, high = (np.outer(1 + np.array(CONTRASTS) * (1 + sign * 0.5), dark)[:, :, None] for sign in (-1, 1))
    for bits, encoding in product((8, 12, 16), ("linear", "srgb")):
        stored, half = light if encoding == "linear" else 1.055 * light ** (1 / 2.4) - 0.055, 0.5 / (2**bits - 1)
        dn = np.rint(stored * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
        cv2.imwrite(str(tmp_path / "a.png"), dn)
        converter = make_converter(encoding=encoding).given(bit_depth=None if bits == 8 else bits)
        picture = read_picture(tmp_path / "a.png", converter.options)
        seen = evaluate_pair(converter.luminance(picture), BRIGHT, DARK, CONTRASTS)
        # Linear DN end a step below 1; sRGB is steepest there, with 2.4 / 1.055.
        end, half = (1 - 2.0**-bits, half) if encoding == "linear" else (1.0, 2.3 * half)
        assert (seen.a.mean, seen.b.mean) == pytest.approx((end * bright.mean(), end * dark.mean()), abs=half)
        contrast = bright.mean() / dark.mean() - 1
        assert seen.contrast.value == pytest.approx(contrast, abs=half * (2 + contrast) / (dark.mean() - half))
        # No pixel is off by more than half a step, nor a limit by more than that of the dark one.
        moved = half * (1 + low / dark[:, None]), half * (1 + high / dark[:, None])
        least, most = (
            ((bright >= low - sign * moved[0]) & (bright <= high + sign * moved[1])).mean(axis=(1, 2))
            for sign in (-1, 1)
        )
        cdps = seen.cdp.cdp
        assert ((least - 1e-12 <= cdps) & (cdps <= most + 1e-12)).all()


def test_a_session_a_picture_and_a_video_with_one_calibration_agree(recorded, evaluation, tmp_path):
    save(evaluation.calibration, calibration := tmp_path / "calibration.json")
    files = {record.number: recorded.path / record.file.name for record in recorded.frames()}
    for row in evaluation.contrasts:
        rois, file = (row.bright.region, row.dark.region), files[row.frame_number]
        (asked,) = picture_of(file, rois, (row.target.contrast,), calibration, epsilon=row.target.epsilon).cdp
        assert asked.cdp == row.cdp.cdp
        assert asked.u == pytest.approx(row.cdp.u, rel=1e-6)
        assert asked.interval == pytest.approx(row.cdp.interval, rel=1e-6)
        folder = tmp_path / f"{row.target.bright}-{row.target.dark}"
        folder.mkdir()
        shutil.copy(file, folder / "frame.tif")
        assert_same_as_video(picture_of(file, rois, calibration=calibration), folder, rois, calibration=calibration)
    converter = make_converter(calibration)
    near = evaluate_neighbours(converter.luminance(read_picture(file, converter.options)), CONTRASTS).cdp
    video = evaluate_video(folder, VideoSettings(CONTRASTS, calibration=calibration)).isel(frame=0)
    assert near.u_calibration.max() > 0
    np.testing.assert_allclose(video["cdp"], near.cdp, rtol=1e-9)
    np.testing.assert_allclose(video["u_cdp"], near.u, rtol=1e-6)
