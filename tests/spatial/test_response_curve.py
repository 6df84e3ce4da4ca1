import numpy as np
import pytest

from labcdp.calibration.response_curve import response_from_bracket
from labcdp.errors import CalibrationError
from labcdp.response import Response

SHAPE = (150, 200)
DARK, FULL = 12.0, 255.0
POWERS_OF_TWO = tuple(0.0001 * 2.0**k for k in range(10))
UNEVEN = tuple(0.0001 * np.cumprod([1, 1.5, 2.3, 1.7, 2.6, 1.4, 2.1, 1.9, 2.8, 1.6]))


@pytest.fixture(scope="module")
def scene():
    values = np.geomspace(0.5, 2000, SHAPE[0] * SHAPE[1])
    return np.random.default_rng(1).permutation(values).reshape(SHAPE)


@pytest.fixture(scope="module")
def bracket(scene, make_frame):
    """Frames of a camera whose DN go with the exposure to the power of 1 / gamma."""

    def take(gamma=2.2, exposures=POWERS_OF_TWO, bits=8, noise=0.7, moved=False):
        rng = np.random.default_rng(2)
        scale, frames = 2 ** (bits - 8), []
        for i, t in enumerate(exposures):
            exposure = np.clip((scene[::-1] if moved and i % 2 else scene) * t / 0.5, 0, 1)
            dn = (DARK + (FULL - DARK) * exposure ** (1 / gamma) + rng.normal(0, noise, SHAPE)) * scale
            frames.append(make_frame(dn, t, i, bit_depth=bits))
        return frames

    return take


def relative_error(curve, gamma, full, dark):
    """Deviation from the true response over the covered range, with the best common factor."""
    low, high = curve.range_net_dn
    n = np.linspace(low, high, 200)
    ratio = curve.response.linearise(n) / (n / (full - dark)) ** gamma
    return ratio / np.exp(np.mean(np.log(ratio))) - 1


@pytest.mark.parametrize(
    ("method", "exposures"), [("debevec", POWERS_OF_TWO), ("debevec", UNEVEN), ("robertson", UNEVEN)]
)
def test_the_response_is_found(bracket, method, exposures):
    curve = response_from_bracket(bracket(exposures=exposures), DARK, method)
    low, high = curve.range_net_dn
    assert low < 20
    assert high > 230
    error = relative_error(curve, 2.2, FULL, DARK)
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert np.abs(error).max() < 0.03  # at the lower end, where noise is a fifth of a pixel's exposure
    assert curve.residual_rel < 0.02
    assert curve.method == method


def test_a_linear_camera_has_a_linear_response(bracket):
    curve = response_from_bracket(bracket(gamma=1.0), DARK)
    n = np.linspace(20, 220, 50)
    ratio = curve.response.linearise(n) / n
    assert np.std(ratio) / np.mean(ratio) < 0.02
    assert curve.response.linearise(curve.range_net_dn[0]) == pytest.approx(curve.range_net_dn[0])


def test_deeper_frames_are_reduced(bracket):
    curve = response_from_bracket(bracket(bits=12), DARK * 16)
    error = relative_error(curve, 2.2, FULL * 16, DARK * 16)
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert curve.range_net_dn[1] > 230 * 16


def test_the_response_linearises_frames_of_other_scenes(bracket, scene):
    """What a calibration does with it: h(DN - d) over the exposure is the scene, up to one factor."""
    curve = response_from_bracket(bracket(), DARK)
    (frame,) = bracket(exposures=(0.0007,))
    net = frame.dn - DARK
    low, high = curve.range_net_dn
    inside = (net > low) & (net < high)
    ratio = curve.response.linearise(net[inside]) / (scene[inside] * 0.0007)
    by_brightness = [part.mean() for part in np.array_split(ratio[np.argsort(scene[inside])], 10)]
    assert np.std(by_brightness) / np.mean(by_brightness) < 0.02


def test_the_curve_is_the_same_each_time(bracket):
    frames = bracket()
    assert response_from_bracket(frames, DARK) == response_from_bracket(list(reversed(frames)), DARK)


def test_a_table_rises(bracket):
    curve = response_from_bracket(bracket(noise=1.5), DARK)
    assert isinstance(curve.response, Response)
    assert (np.diff(curve.response.linear_dn) > 0).all()


def test_robertson_needs_uneven_exposures(bracket):
    with pytest.raises(CalibrationError, match=r"powers of a factor of 2, from which Robertson's method cannot tell"):
        response_from_bracket(bracket(), DARK, "robertson")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exposures": (0.001, 0.002)}, "there are 2 frames at 2 exposures: give frames at 3 or more exposures"),
        ({"exposures": (0.001, 0.001, 0.002)}, "there are 3 frames at 2 exposures"),
        ({"exposures": (1e-6, 0.01, 100.0)}, "neighbouring exposures share no pixel"),
        ({"exposures": (1e-5, 1.1e-5, 1.2e-5)}, "of the DN between dark and saturation at two exposures"),
        ({"moved": True}, "the exposures differ from any one response"),
    ],
)
def test_brackets_that_cannot_tell_are_refused(bracket, change, message):
    with pytest.raises(CalibrationError, match=message):
        response_from_bracket(bracket(**change), DARK)
