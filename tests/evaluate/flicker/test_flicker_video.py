"""Flicker of regions of videos that plain NumPy renders from pulsed lamps: the frames, the indices, and their files."""

import json

import cv2
import numpy as np
import openpyxl
import pytest
import xarray as xr

import labcdp
from labcdp.chain import PulsedLamp
from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.evaluate.flicker.page import evaluate_flicker, write_flicker
from labcdp.evaluate.flicker.settings import FlickerSettings
from labcdp.evaluate.video.evaluate import JOURNAL, evaluate_video
from labcdp.evaluate.video.findings import varying_light_findings
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.files.video.selection import Position, Selection

SHAPE, RATE_HZ, EXPOSURE_S, ROW_TIME_S, WHITE = (48, 96), 25.0, 2e-3, 20e-6, 200.0
LAMP = Roi.rectangle("lamp", 10, 10, 24, 24)
STEADY = Roi.rectangle("steady", 60, 10, 24, 24)
#: A pulsed lamp, of which a rolling shutter sees each row later.
FREQUENCY_HZ, DUTY, OFF = 217.3, 0.3, 0.1


def seen(begins_s):
    """Mean light of an exposure, by samples of the pulses in time."""
    times = begins_s[..., None] + (np.arange(400) + 0.5) / 400 * EXPOSURE_S
    return OFF + (1 - OFF) * ((times * FREQUENCY_HZ + 0.37) % 1 < DUTY).mean(axis=-1)


def rendered(n, n_off=0, seed=1, white=WHITE, noise_dn=1.0):
    """Frames of a pulsed lamp and a steady one, in DN that are proportional to light."""
    rng, frames = np.random.default_rng(seed), []
    for number in range(n):
        rows = number / RATE_HZ + np.arange(SHAPE[0]) * ROW_TIME_S
        light = np.full(SHAPE, 0.15)
        light[10:34, 10:34] = OFF if number < n_off else seen(rows)[10:34, None]
        light[10:34, 60:84] = 0.5
        dn = white * light + rng.normal(0, noise_dn, SHAPE)
        frames.append(np.clip(np.rint(dn), 0, 255).astype(np.uint8))
    return frames


def write(path, frames):
    codec, flags = cv2.VideoWriter.fourcc(*"FFV1"), [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, codec, RATE_HZ, SHAPE[::-1], flags)
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


def settings(*rois, **more):
    return FlickerSettings(rois=rois or (LAMP, STEADY), method="fixed", encoding="linear", **more)


@pytest.fixture(scope="module")
def frames():
    return rendered(330, n_off=30)


@pytest.fixture(scope="module")
def video(frames, tmp_path_factory):
    return write(tmp_path_factory.mktemp("flicker") / "lamps.avi", frames)


@pytest.fixture(scope="module")
def evaluated(video):
    return evaluate_flicker(video, settings(off_frames=(0, 30)))


def test_indices_are_those_of_the_frames(frames, evaluated):
    dataset, (lamp, steady) = evaluated
    means = np.array([frame[10:34, 10:34].mean() for frame in frames]) / 256
    assert dataset["mean"].sel(region="lamp").values == pytest.approx(means, rel=1e-9)
    x, off = means[30:], means[:30].mean()
    assert lamp.flicker.fmi.value == pytest.approx((x.max() - x.min()) / (x.max() + x.min()))
    assert lamp.flicker.mmp.value == np.mean(np.abs(x - x.mean()) < 0.1 * x.mean())
    assert lamp.flicker.fdi.value == np.mean(x > 1.1 * off)
    assert lamp.off.value == pytest.approx(off)
    assert lamp.flicker.n_evaluated == 300
    assert (steady.flicker.mmp.value, steady.flicker.flickers) == (1, False)
    for name in ("fmi", "fdi", "mmp"):
        index = getattr(lamp.flicker, name)
        assert float(dataset[name].sel(region="lamp")) == index.value
        assert float(dataset[f"{name}_low"].sel(region="lamp")) == index.interval.low


def test_intervals_hold_what_the_closed_form_says(evaluated):
    _, (lamp, _) = evaluated
    # Noise of 1 DN and rounding, of the mean of 24 x 24 pixels.
    noise_rel = np.hypot(1, 1 / np.sqrt(12)) / 24 / WHITE / PulsedLamp(FREQUENCY_HZ, DUTY, OFF).mean_level
    truth = PulsedLamp(FREQUENCY_HZ, DUTY, OFF).flicker(
        EXPOSURE_S, n_rows=24, row_time_s=ROW_TIME_S, noise_rel=noise_rel
    )
    for name in ("fmi", "fdi", "mmp"):
        low, high = getattr(lamp.flicker, name).interval
        # Samples of the pulses are off by 1 in 400.
        assert low - 0.003 < getattr(truth, name) < high + 0.003, name
        assert high - low < 0.06
    assert not lamp.flicker.few_phases
    assert lamp.flicker.beat_hz == pytest.approx(abs(FREQUENCY_HZ - 9 * RATE_HZ), abs=2e-3)


def test_files_hold_the_same_numbers(evaluated, tmp_path):
    dataset, regions = evaluated
    result = write_flicker(dataset, regions, tmp_path / "out")
    (row, _) = result.table("flicker").rows()
    values = json.loads((tmp_path / "out" / "results.json").read_text())
    assert values["tables"]["flicker"]["rows"][0]["fmi"] == row["fmi"] == regions[0].flicker.fmi.value
    stored = xr.load_dataset(tmp_path / "out" / "results.nc")
    assert float(stored["mmp"][0]) == row["mmp"]
    assert stored["mean"].dims == ("frame", "region")
    sheets = openpyxl.load_workbook(tmp_path / "out" / "results.xlsx", read_only=True)
    assert {"flicker", "Frames"} <= set(sheets.sheetnames)
    assert sheets["Frames"].max_row >= 331
    page = (tmp_path / "out" / "report.html").read_text()
    assert "No compliance with IEEE 2020 is claimed" in page
    assert {path.name for path in (tmp_path / "out" / "figures").iterdir()} == {"over-time.png", "over-phase.png"}


def test_frames_that_are_saturated_or_black_are_left_out_and_counted(tmp_path):
    frames = rendered(60, white=400.0, noise_dn=0.0)
    frames[5] = np.zeros_like(frames[5])
    dataset, (lamp, steady) = evaluate_flicker(write(tmp_path / "a.avi", frames), settings())
    assert steady.n_black == lamp.n_black == 1
    full = [(frame[10:34, 10:34] == 255).mean() > 0.01 for frame in frames]
    assert lamp.n_saturated == sum(full) > 0
    assert lamp.flicker.n_evaluated == 59 - sum(full)
    assert np.isnan(dataset["mean"].sel(region="lamp").values[[5, int(np.argmax(full))]]).all()
    codes = {finding["code"] for finding in json.loads(dataset.attrs["findings"])}
    assert {"flicker-saturated", "flicker-black", "flicker-without-off"} <= codes


def test_a_locked_lamp_is_named(tmp_path):
    # 25 frames a second see one phase of a lamp of 225 Hz.
    frames = [rendered(1, seed=number)[0] for number in range(60)]
    path = write(tmp_path / "locked.avi", frames)
    dataset, (lamp,) = evaluate_flicker(path, settings(LAMP))
    codes = {finding["code"] for finding in json.loads(dataset.attrs["findings"])}
    assert "flicker-none" in codes
    dataset, (lamp,) = evaluate_flicker(path, settings(LAMP, frequency_hz=225.0))
    codes = {finding["code"] for finding in json.loads(dataset.attrs["findings"])}
    assert "flicker-locked" in codes
    assert lamp.flicker.fmi.interval.high == 1


def test_a_dark_room_leaves_out_the_fdi_alone(tmp_path):
    frames = rendered(60, n_off=10, noise_dn=0.0)
    for frame in frames[:10]:
        frame[10:34, 10:34] = 0
    dataset, (lamp, steady) = evaluate_flicker(write(tmp_path / "a.avi", frames), settings(off_frames=(0, 10)))
    means = np.array([frame[10:34, 10:34].mean() for frame in frames[10:]])
    expected = (means.max() - means.min()) / (means.max() + means.min())
    assert lamp.off is None
    assert np.isnan(lamp.flicker.fdi.value)
    assert lamp.flicker.fmi.value == pytest.approx(expected)
    assert steady.off is not None
    codes = {finding["code"] for finding in json.loads(dataset.attrs["findings"])}
    assert "flicker-without-off" in codes


def test_the_frequency_of_a_lamp_needs_times(tmp_path):
    for number, frame in enumerate(rendered(5)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), frame)
    with pytest.raises(InputError, match="the images state no times, which the frequency of the lamp needs"):
        evaluate_flicker(tmp_path, settings(LAMP, frequency_hz=90.0))


def test_images_have_the_times_of_a_stated_frame_rate(frames, evaluated, video, tmp_path):
    for number, frame in enumerate(frames[30:]):
        cv2.imwrite(str(tmp_path / f"{number:03}.png"), frame)
    dataset, (lamp,) = evaluate_flicker(tmp_path, settings(LAMP, frame_rate_hz=RATE_HZ, frequency_hz=FREQUENCY_HZ))
    assert dataset["time_s"].values == pytest.approx(np.arange(300) / RATE_HZ)
    assert lamp.flicker.beat_hz == pytest.approx(evaluated[1][0].flicker.beat_hz, rel=1e-3)
    assert "image-sequence-rate" in dataset.attrs["findings"]
    assert labcdp.open_video(tmp_path, frame_rate_hz=50).frame_rate == 50
    with pytest.raises(InputError, match=r"lamps.avi states the times of its frames: leave the frame rate out"):
        evaluate_flicker(video, settings(LAMP, frame_rate_hz=RATE_HZ))
    with pytest.raises(InputError, match="the frame rate is 0 Hz: give a number above 0"):
        labcdp.open_video(tmp_path, frame_rate_hz=0)


def test_regions_are_tracked(tmp_path):
    rng = np.random.default_rng(2)
    ground = cv2.GaussianBlur(rng.normal(90, 60, (120, 200)), (0, 0), 2)
    frames, lit = [], 90 + 60 * (np.arange(80) * 0.377 % 1 < 0.5)
    for number in range(80):
        image, left = ground.copy(), 20 + number
        image[40:80, left : left + 40] = 60
        image[50:70, left + 10 : left + 30] = lit[number]
        frames.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    path = tmp_path / "moving.avi"
    flags = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), RATE_HZ, (200, 120), flags)
    for frame in frames:
        writer.write(frame)
    writer.release()
    rois = (Roi.rectangle("lamp", 32, 52, 16, 16),)
    _, (lamp,) = evaluate_flicker(path, FlickerSettings(rois=rois, encoding="linear"))
    assert lamp.n_lost < 8
    assert lamp.flicker.fmi.value == pytest.approx(60 / 240, abs=0.02)


def test_an_interrupted_evaluation_resumes(video, tmp_path):
    def until_the_twentieth(done, total):
        if done == 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate_flicker(video, settings(), tmp_path / "out", progress=until_the_twentieth)
    assert len((tmp_path / "out" / JOURNAL).read_text().splitlines()) > 19
    resumed, _ = evaluate_flicker(video, settings(), tmp_path / "out")
    whole, _ = evaluate_flicker(video, settings())
    xr.testing.assert_identical(resumed, whole)


def test_python_gives_the_same(video, evaluated):
    dataset = labcdp.open_video(video, encoding="linear").flicker([LAMP, STEADY], "fixed", off_frames=(0, 30))
    assert float(dataset["fmi"][0]) == evaluated[1][0].flicker.fmi.value
    assert dataset["fmi"].attrs["units"] == "1"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"off_frames": (400, 500)}, r"off_frames is 400:500, but the frames are 0 to 329: give some of them"),
        ({"off_frames": (5, 5)}, "off_frames is 5:5: give the first frame and the one after the last"),
        ({"tolerance": 0.0}, "tolerance is 0.0: give a number above 0"),
        ({"frequency_hz": True}, "frequency_hz is True: give a number above 0"),
    ],
)
def test_what_cannot_be_used_is_refused(video, more, message):
    with pytest.raises(InputError, match=message):
        evaluate_flicker(video, settings(**more))
    with pytest.raises(InputError, match="no regions"):
        FlickerSettings()


@pytest.mark.parametrize("off_frames", [(330, 340), (0, 330), (300, 340)])
def test_frames_with_the_lamp_off_that_are_none_are_refused_before_the_first_frame(video, off_frames):
    seen = []
    where = Selection(stop=Position(300)) if off_frames[0] == 300 else Selection()
    chosen = settings(LAMP, off_frames=off_frames, selection=where)
    with pytest.raises(InputError, match="give some of them"):
        evaluate_flicker(video, chosen, progress=lambda *done: seen.append(done))
    assert not seen


@pytest.mark.parametrize("start", [Position(100), Position(seconds=4.0)])
@pytest.mark.parametrize("off_frames", [(0, 25), (10, 30)])
def test_frames_with_the_lamp_off_may_be_before_the_first_evaluated_one(frames, video, off_frames, start):
    dataset, (lamp, _) = evaluate_flicker(video, settings(off_frames=off_frames, selection=Selection(start)))
    means = np.array([frame[10:34, 10:34].mean() for frame in frames]) / 256
    x, off = means[100:], means[slice(*off_frames)].mean()
    assert dataset["frame"].values.tolist() == [*range(*off_frames), *range(100, 330)]
    assert lamp.off.value == pytest.approx(off)
    assert lamp.flicker.fdi.value == pytest.approx((x > 1.1 * off).mean())
    assert lamp.flicker.mmp.value == pytest.approx((abs(x - x.mean()) < 0.1 * x.mean()).mean())


def test_a_pulsed_lamp_that_disturbs_a_cdp_is_named(video, tmp_path):
    pair = VideoSettings((1.0,), (LAMP, STEADY), "fixed", encoding="linear")
    findings = json.loads(evaluate_video(video, pair).attrs["findings"])
    (pulsed,) = (finding for finding in findings if finding["code"] == "region-light-pulsed")
    assert pulsed["subject"] == "lamp"
    beat_hz = abs(FREQUENCY_HZ - 9 * RATE_HZ)
    assert pulsed["values"]["beat_hz"] == pytest.approx(beat_hz, abs=0.05)
    assert pulsed["values"]["period_frames"] == pytest.approx(RATE_HZ / beat_hz, rel=0.01)
    # The light of a scene that changes slowly, and noise, are none.
    ramp = [np.clip(frame * (0.6 + 0.01 * number), 0, 255).astype(np.uint8) for number, frame in
            enumerate([rendered(1, seed=seed)[0] for seed in range(40)])]  # fmt: skip
    findings = json.loads(evaluate_video(write(tmp_path / "ramp.avi", ramp), pair).attrs["findings"])
    assert not [finding for finding in findings if finding["code"].startswith("region-light")]


def test_a_video_whose_light_varies_without_a_period_says_so(tmp_path):
    rng = np.random.default_rng(5)
    frames = [
        np.clip(image * (1 + 0.1 * rng.standard_normal()), 0, 255).astype(np.uint8)
        for image in (rendered(1, seed=seed)[0] for seed in range(40))
    ]
    # Without calibration the vignetting is not known, which is no noise from frame to frame.
    pair = VideoSettings((1.0,), (LAMP, STEADY), "fixed", encoding="linear")
    findings = json.loads(evaluate_video(write(tmp_path / "random.avi", frames), pair).attrs["findings"])
    varies = [finding for finding in findings if finding["code"] == "region-light-varies"]
    assert [finding["subject"] for finding in varies] == ["lamp", "steady"]
    for finding in varies:
        assert finding["values"]["variation_rel"] == pytest.approx(0.1, rel=4 * 1.42 / 40**0.5)


def light_findings(means, *, noise_rel=0.001, every=1):
    """Findings about the light of a region that has these means, with noise of them."""
    means = np.asarray(means)
    noisy = means * (1 + noise_rel * np.random.default_rng(4).standard_normal(means.size))
    frames = every * np.arange(means.size)
    snr = np.full((means.size, 1), 1 / (noise_rel * 20))
    return varying_light_findings({"frame": frames, "mean": noisy[:, None], "snr": snr}, {"lamp": 400}, every / 25)


@pytest.mark.parametrize("variation_rel", [0.02, 0.2])
@pytest.mark.parametrize("n_frames", [60, 2000])
def test_light_that_varies_without_a_period_is_named_with_its_size(variation_rel, n_frames):
    means = 50 * (1 + variation_rel * np.random.default_rng(3).standard_normal(n_frames))
    (finding,) = light_findings(means)
    assert (finding.code, finding.severity, finding.subject) == ("region-light-varies", "warning", "lamp")
    # A median of n absolute second differences, of which neighbours are correlated, scatters by 1.42 / sqrt(n).
    assert finding.values["variation_rel"] == pytest.approx(variation_rel, rel=4 * 1.42 / n_frames**0.5)
    assert finding.values["noise_rel"] == pytest.approx(0.001, rel=0.05)


@pytest.mark.parametrize("every", [1, 3])
def test_light_that_repeats_is_named_with_its_period(every):
    frames = every * np.arange(100)
    (finding,) = light_findings(50 * (1 + 0.1 * np.sin(2 * np.pi * frames / (7.3 * every))), every=every)
    assert finding.code == "region-light-pulsed"
    assert finding.values["period_frames"] == pytest.approx(7.3 * every, rel=0.01)
    assert finding.values["beat_hz"] == pytest.approx(25 / (7.3 * every), rel=0.01)


@pytest.mark.parametrize(
    ("means", "noise_rel"),
    [
        (np.full(200, 50.0), 0.02),  # noise alone
        (np.linspace(20, 80, 200), 0.001),  # the scene becomes brighter
        (np.where(np.arange(200) % 80 < 40, 20.0, 50.0), 0.001),  # a few jumps
        (50 * (1 + 0.003 * np.random.default_rng(3).standard_normal(200)), 0.001),  # too little to matter
        (np.zeros(200), 0.001),
    ],
)
def test_noise_and_changes_of_the_scene_are_no_varying_light(means, noise_rel):
    assert light_findings(means, noise_rel=noise_rel) == []
