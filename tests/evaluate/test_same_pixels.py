"""The same pixels have the same numbers and uncertainties as a picture, as a video and in a session."""

from __future__ import annotations

from math import hypot, sqrt
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import gaussian_filter

import labcdp
from labcdp.calibration import save
from labcdp.core.roi import Roi
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.files.read import read_picture
from labcdp.metrics.pair import PairResult, evaluate_pair
from labcdp.session import Session

EXAMPLE = Path(labcdp.__file__).parent / "data" / "example-session"
BRIGHT, DARK = Roi.rectangle("bright", 20, 20, 24, 30), Roi.rectangle("dark", 60, 20, 24, 30)
CONTRASTS = (0.5, 1.0, 1.5, 3.0)


def scene(smoothing_px: float, noise_dn: float) -> np.ndarray:
    noise = gaussian_filter(np.random.default_rng(3).normal(size=(80, 120)), smoothing_px)
    mean = np.full((80, 120), 60.2)
    mean[:, :50] = 149.7
    return np.clip(np.rint(mean + noise_dn * noise / noise.std()), 0, 255).astype(np.uint8)


def picture_of(path: Path, rois: tuple[Roi, Roi], calibration: Path | None, encoding: Any) -> PairResult:
    conversion = picture_conversion(calibration, None, encoding)
    light = conversion.luminance(read_picture(path, conversion.options))
    return evaluate_pair(light, *rois, CONTRASTS)


def video_of(path: Path, rois: tuple[Roi, Roi], **settings: Any) -> xr.Dataset:
    return evaluate_video(path, VideoSettings(CONTRASTS, rois, "fixed", **settings)).isel(frame=0)


def assert_same(video: xr.Dataset, picture: PairResult) -> None:
    expected: dict[str, Any] = {
        "cdp": [one.result.cdp for one in picture.results],
        "cdp_standard_uncertainty": [one.standard_uncertainty for one in picture.results],
        "cdp_low": [one.confidence_interval[0] for one in picture.results],
        "cdp_high": [one.confidence_interval[1] for one in picture.results],
        "below": [one.result.below for one in picture.results],
        "above": [one.result.above for one in picture.results],
        "measured_contrast": picture.contrast.value,
        "measured_contrast_standard_uncertainty": picture.contrast.standard_error,
        "csnr": picture.csnr.value,
        "csnr_standard_uncertainty": picture.csnr.standard_error,
        "mean": [picture.a.mean, picture.b.mean],
        "mean_standard_uncertainty": [picture.a.standard_uncertainty, picture.b.standard_uncertainty],
        "snr": [picture.a.snr.value, picture.b.snr.value],
        "snr_standard_uncertainty": [picture.a.snr.standard_error, picture.b.snr.standard_error],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(video[name], values, rtol=1e-6, err_msg=name)


@pytest.mark.parametrize("encoding", [None, "srgb"])
@pytest.mark.parametrize(("smoothing_px", "noise_dn"), [(0, 12), (1.2, 12), (0, 0.2), (0, 0)])
def test_a_picture_is_a_video_of_one_frame(tmp_path: Path, smoothing_px: float, noise_dn: float, encoding: Any) -> None:
    """Of independent noise, of correlated noise, and where the noise does not dither the rounding."""
    cv2.imwrite(str(tmp_path / "0.png"), scene(smoothing_px, noise_dn if noise_dn else 1e-9))
    picture = picture_of(tmp_path / "0.png", (BRIGHT, DARK), None, encoding)
    assert (max(one.result.correlation_inflation for one in picture.results) > 2) == (smoothing_px > 0)
    assert_same(video_of(tmp_path, (BRIGHT, DARK), encoding=encoding), picture)
    in_python = labcdp.read_image(tmp_path / "0.png", encoding=encoding).regions([BRIGHT, DARK]).cdp(CONTRASTS)
    by_hand = labcdp.open_video(tmp_path, encoding=encoding).track([BRIGHT, DARK], "fixed").cdp(CONTRASTS)
    rows = [(one.result.cdp, one.standard_uncertainty, *one.confidence_interval) for one in picture.results]
    for name, values in zip(("cdp", "u_cdp", "cdp_low", "cdp_high"), np.transpose(rows), strict=True):
        np.testing.assert_allclose(in_python[name].squeeze(), values, rtol=1e-9, err_msg=name)
        np.testing.assert_allclose(by_hand[name].squeeze(), values, rtol=1e-6, err_msg=name)
    if encoding is None and noise_dn == 12 and smoothing_px == 0:
        # Arrays have no places, so correlation is seen in pictures only.
        arrays = labcdp.cdp(*(roi.select(scene(0, 12)) for roi in (BRIGHT, DARK)), CONTRASTS)
        np.testing.assert_allclose(np.transpose(rows), [arrays.cdp, arrays.u, *arrays.interval], rtol=1e-9)


def test_a_session_a_picture_and_a_video_with_one_calibration_agree(tmp_path: Path) -> None:
    with Session.open(EXAMPLE) as session:
        observed = observe_session(session)
        calibration = calibrate_session(observed)
        evaluation = evaluate_session(session, observed, calibration)
        files = {record.number: EXAMPLE / record.file.name for record in session.frames()}
    save(calibration, tmp_path / "calibration.json")
    regions = {row.region.name: row.region for row in evaluation.patches}
    for row in evaluation.contrasts:
        rois = regions[row.bright], regions[row.dark]
        conversion = picture_conversion(tmp_path / "calibration.json", None, None)
        light = conversion.luminance(read_picture(files[row.frame_number], conversion.options))
        (asked,) = evaluate_pair(light, *rois, (row.cdp.contrast,), row.cdp.epsilon).results
        assert asked.result.cdp == row.cdp.cdp
        assert asked.standard_uncertainty == pytest.approx(row.calibrated_cdp.standard_uncertainty, rel=1e-6)
        assert asked.confidence_interval == pytest.approx(row.cdp.confidence_interval, rel=1e-6)
        picture = picture_of(files[row.frame_number], rois, tmp_path / "calibration.json", None)
        folder = tmp_path / f"{row.bright}-{row.dark}"
        folder.mkdir()
        (folder / "frame.tif").hardlink_to(files[row.frame_number])
        assert_same(video_of(folder, rois, calibration=tmp_path / "calibration.json"), picture)


def test_versions_of_more_bits_differ_by_their_quantisation(tmp_path: Path) -> None:
    """Noise of 6 DN of 8 bits dithers the rounding, which adds 1/12 DN² to the variance, and nothing to the mean."""
    noise = np.random.default_rng(4).normal(size=(80, 120))
    light = np.where(np.arange(120) < 50, 150.2, 60.7) + 6 * noise
    pairs = {}
    for bits in (8, 12, 16):
        pixels = np.rint(light * 2 ** (bits - 8)).astype(np.uint8 if bits == 8 else np.uint16)
        np.save(path := tmp_path / f"{bits}.npy", pixels)
        pairs[bits] = picture_of(path, (BRIGHT, DARK), None, "linear")
    finest = pairs.pop(16)
    for bits, pair in pairs.items():
        step = 2.0 ** (8 - bits)
        # A rounded mean scatters by sqrt(1/12 / n) of a step; a CDP is that of values shifted by up to half a step.
        scatter = step * sqrt(1 / 12 / 720) * hypot(1, 150.2 / 60.7) / 60.7
        assert pair.contrast.value == pytest.approx(finest.contrast.value, abs=4 * scatter)
        assert pair.a.snr.value == pytest.approx(finest.a.snr.value, rel=0.02 * step + 1e-4)
        for one, fine in zip(pair.results, finest.results, strict=True):
            assert one.result.cdp == pytest.approx(fine.result.cdp, abs=0.05 * step)
            assert one.standard_uncertainty == pytest.approx(fine.standard_uncertainty, rel=0.1 * step, abs=1e-4)
