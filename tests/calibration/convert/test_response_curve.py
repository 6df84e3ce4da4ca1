"""The response by a bracket against simulated cameras, and against OpenCV's."""

import cv2
import numpy as np
import pytest

from labcdp.calibration.sensor.response import _debevec, response_from_bracket
from labcdp.core.errors import CalibrationError

from ..conftest import make_frame

SHAPE = (150, 200)
DARK, FULL = 12.0, 255.0
POWERS_OF_TWO = tuple(0.0001 * 2.0**k for k in range(10))
UNEVEN = tuple(0.0001 * np.cumprod([1, 1.5, 2.3, 1.7, 2.6, 1.4, 2.1, 1.9, 2.8, 1.6]))
#: Exposure, 0 to 1, over DN, 0 to 1, of three cameras.
INVERSES = {"linear": lambda n: n, "gamma 2.2": lambda n: n**2.2, "cubic": lambda n: 0.6 * n + 0.1 * n**2 + 0.3 * n**3}


SCENE = np.random.default_rng(1).permutation(np.geomspace(0.5, 2000, SHAPE[0] * SHAPE[1])).reshape(SHAPE)


def bracket(camera="gamma 2.2", exposures=POWERS_OF_TWO, bits=8, moved=False):
    rng, at, scale, frames = np.random.default_rng(2), np.linspace(0, 1, 100_001), 2 ** (bits - 8), []
    for i, t in enumerate(exposures):
        exposure = np.clip((SCENE[::-1] if moved and i % 2 else SCENE) * t / 0.5, 0, 1)
        signal = np.interp(exposure, INVERSES[camera](at), at)
        dn = (DARK + (FULL - DARK) * signal + rng.normal(0, 0.7, SHAPE)) * scale
        frames.append(make_frame(dn, t, i, bit_depth=bits))
    return frames


@pytest.mark.parametrize("camera", INVERSES)
@pytest.mark.parametrize(("exposures", "bits"), [(POWERS_OF_TWO, 12), (UNEVEN, 8)])
def test_the_response_is_that_of_the_simulated_camera(camera, exposures, bits):
    curve = response_from_bracket(bracket(camera, exposures, bits), DARK * 2 ** (bits - 8))
    low, high = np.array(curve.range_net_dn) / 2 ** (bits - 8)
    assert low < 20 < 230 < high
    # Deviation of ln h from the truth over the covered range, with the best common factor.
    n = np.linspace(*curve.range_net_dn, 200)
    error = np.log(curve.response.linearise(n) / INVERSES[camera](n / 2 ** (bits - 8) / (FULL - DARK)))
    error -= error.mean()
    assert np.sqrt(np.mean(error**2)) < 0.003
    assert np.abs(error).max() < 0.015
    # The stated errors hold it: the ramps add up along the curve.
    assert curve.response.inverse(curve.response.linearise(n)) == pytest.approx(n, rel=1e-9)
    stated = curve.errors(n) - curve.errors(n).mean(axis=1, keepdims=True)
    assert (np.abs(error) < 3 * np.sqrt((stated**2).sum(axis=0)) + 0.005).all()


def test_opencv_finds_the_same_response():
    """OpenCV's curve scatters by the noise of its pixels; smoothed over 15 levels it agrees within 2 %."""
    frames = bracket("gamma 2.2", POWERS_OF_TWO[3:9])
    images = [frame.dn.astype(np.uint8) for frame in frames]
    process = cv2.createCalibrateDebevec(samples=900, lambda_=30, random=False)
    times = np.array([frame.exposure_s for frame in frames], dtype=np.float32)
    theirs = np.log(process.process(images, times=times)[:, 0])
    curve = response_from_bracket(frames, DARK)
    dn = np.arange(60, 220)
    difference = np.log(curve.response.linearise(dn - DARK)) - theirs[dn]
    smooth = np.convolve(difference - difference.mean(), np.ones(15) / 15, "valid")
    assert np.abs(smooth).max() < 0.02


def test_without_noise_a_power_law_is_exact():
    """Its second differences are 0, so smoothing does not bend it."""
    exposures, light = np.array([1.0, 2.0, 5.0, 9.0]), np.geomspace(0.01, 1, 100)
    net_dn = 200 * np.outer(exposures / 9, light) ** (1 / 2.2)
    knots, linear = _debevec(net_dn, exposures, (10.0, 200.0))
    assert linear == pytest.approx(knots[0] * (knots / knots[0]) ** 2.2, rel=1e-4)


@pytest.mark.parametrize(
    "change",
    [
        {"exposures": (0.001, 0.001, 0.002)},
        {"exposures": (1e-6, 0.01, 100.0)},
        {"exposures": (1e-5, 1.1e-5, 1.2e-5)},
        {"moved": True},
    ],
)
def test_brackets_that_are_ambiguous_are_refused(change):
    with pytest.raises(CalibrationError, match="exposures"):
        response_from_bracket(bracket(**change), DARK)
