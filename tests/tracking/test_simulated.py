"""The simulated videos tell the truth about where the target is."""

import numpy as np
import pytest

from .simulated import Cover, Moment, SimulatedVideo, pose

PATCH = ((-12.0, -10.0, 24.0, 20.0, 0.9),)


def centroid_of_the_patch(grey, expected):
    """Centre of what is brighter than the panel around it; pixel middles are at +0.5."""
    y, x = np.mgrid[: grey.shape[0], : grey.shape[1]] + 0.5
    near = (abs(x - expected[0]) < 22) & (abs(y - expected[1]) < 20)
    bright = np.clip(grey.astype(float) - 170, 0, None) * near
    return (x * bright).sum() / bright.sum(), (y * bright).sum() / bright.sum()


def still(moment, n_frames=1, **options):
    options = {"size": (160, 120), "patches": PATCH, "target_size": (70.0, 60.0), "full_scale_e": 1e7} | options
    return list(SimulatedVideo(lambda _: moment, n_frames=n_frames, read_noise_e=0, **options).frames())


@pytest.mark.parametrize("place", [(80.0, 60.0), (80.37, 59.81), (61.125, 70.5)])
def test_the_target_is_drawn_where_the_truth_says(place):
    # Samples are a quarter of a pixel apart, so an edge is placed within an eighth, and its two ends err alike at most.
    frame = still(Moment(pose(*place)))[0]

    assert frame.rois[0].centre == pytest.approx(place)
    assert centroid_of_the_patch(frame.grey, place) == pytest.approx(place, abs=0.13)


def test_noise_is_that_of_photons_and_of_reading():
    moment = Moment(pose(80, 60))
    video = SimulatedVideo(
        lambda _: moment, n_frames=1, size=(160, 120), patches=PATCH, target_size=(70.0, 60.0), inset=2.0,
        full_scale_e=1000.0, read_noise_e=20.0,
    )  # fmt: skip
    frame = next(iter(video.frames()))
    pixels = frame.rois[0].select(frame.grey).astype(float)

    expected = (255 / 1000) ** 2 * (0.9 * 1000 + 20**2) + 1 / 12
    # Relative standard deviation of a variance: sqrt(2 / n).
    assert pixels.var() == pytest.approx(expected, rel=4 * (2 / pixels.size) ** 0.5)


def test_what_covers_a_region_or_is_outside_is_not_seen():
    covered = still(Moment(pose(80, 60), covers=(Cover(0, 0, 80, 120),)))[0]
    leaving = still(Moment(pose(0, 60)))
    elsewhere = still(Moment(pose(80, 60), scene=1))[0]

    assert covered.seen == (0.5,)
    assert leaving[0].seen == (0.5,)
    assert elsewhere.seen == (0.0,)


def test_the_same_seed_gives_the_same_video_and_another_one_another():
    moment = Moment(pose(80, 60))
    first, again, other = (still(moment, full_scale_e=500.0, seed=seed)[0].grey for seed in (3, 3, 4))

    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_an_open_shutter_blurs_along_the_motion_around_the_true_place():
    path = lambda t: Moment(pose(80 + 8 * t, 60))  # noqa: E731
    options = {"size": (160, 120), "patches": PATCH, "target_size": (70.0, 60.0), "full_scale_e": 1e7}
    sharp, blurred = (
        list(SimulatedVideo(path, n_frames=2, read_noise_e=0, exposure=share, **options).frames())[1]
        for share in (0.0, 0.5)
    )

    assert blurred.rois == sharp.rois
    row_sharp, row_blurred = sharp.grey[60].astype(int), blurred.grey[60].astype(int)
    assert np.abs(np.diff(row_blurred)).max() < np.abs(np.diff(row_sharp)).max()
    assert centroid_of_the_patch(blurred.grey, (88, 60)) == pytest.approx((88, 60), abs=0.3)
