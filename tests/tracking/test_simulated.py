"""The simulated videos tell the truth about where the target is."""

import numpy as np
import pytest

from .simulated import Cover, Moment, SimulatedVideo, pose

TARGET = {"size": (160, 120), "patches": ((-12.0, -10.0, 24.0, 20.0, 0.9),), "target_size": (70.0, 60.0)}


def frames(path, n_frames=1, **options):
    options = TARGET | {"full_scale_e": 1e7, "read_noise_e": 0} | options
    return list(SimulatedVideo(path, n_frames=n_frames, **options).frames())


@pytest.mark.parametrize("place", [(80.0, 60.0), (80.37, 59.81), (61.125, 70.5)])
@pytest.mark.parametrize("speed", [0, 8])
def test_the_target_is_drawn_where_the_truth_says_and_blurred_along_its_motion(place, speed):
    """Samples are a quarter of a pixel apart: an edge is within an eighth, and its two ends err alike at most."""
    path = lambda t: Moment(pose(place[0] + speed * (t - 1), place[1]))  # noqa: E731
    sharp, blurred = (frames(path, 2, exposure=share)[1] for share in (0.0, 0.5))
    assert sharp.rois[0].centre == blurred.rois[0].centre == pytest.approx(place)
    for frame in (sharp, blurred):
        y, x = np.mgrid[:120, :160] + 0.5
        near = (abs(x - place[0]) < 22) & (abs(y - place[1]) < 20)
        bright = np.clip(frame.grey.astype(float) - 170, 0, None) * near
        found = (x * bright).sum() / bright.sum(), (y * bright).sum() / bright.sum()
        assert found == pytest.approx(place, abs=0.3 if speed and frame is blurred else 0.13)
    steepest = [np.abs(np.diff(frame.grey[60].astype(int))).max() for frame in (sharp, blurred)]
    assert (steepest[1] < steepest[0]) == (speed > 0)


def test_what_covers_a_region_or_is_outside_is_not_seen():
    covered, leaving = Moment(pose(80, 60), covers=(Cover(0, 0, 80, 120),)), Moment(pose(0, 60))
    shares = [frames(lambda _, m=m: m)[0].seen for m in (covered, leaving, Moment(pose(80, 60), scene=1))]
    assert shares == [(0.5,), (0.5,), (0.0,)]
