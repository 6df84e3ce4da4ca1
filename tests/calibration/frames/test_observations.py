from math import exp, pi
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

from labcdp.calibration import observe_dark, observe_patches
from labcdp.calibration.frames.rounding import quantisation_variance_dn2
from labcdp.core.errors import LabcdpError
from labcdp.core.roi import Roi
from labcdp.core.vignetting import Cos4Vignetting

from ..conftest import make_frame

PATCH = Roi.rectangle("grey", 8, 4, 16, 16)
SHAPE = (24, 32)


def test_vignetting_is_removed_from_the_light_and_not_from_the_dark():
    vignetting = Cos4Vignetting(focal_length_m=0.006, pixel_pitch_m=1e-4)
    v = vignetting.relative_illuminance(SHAPE)
    image = np.rint(64 + 3000 * v)
    (seen,) = observe_patches([make_frame(image), make_frame(image)], [PATCH], vignetting)
    cut = v[4:20, 8:24]
    assert seen.mean_inverse_v == pytest.approx(np.mean(1 / cut))
    assert seen.net_dn(64.0) == pytest.approx(3000, abs=0.5)
    assert seen.net_dn_at_pixel(64.0) == pytest.approx(3000 * cut.mean(), rel=0.01)


def test_a_gradient_is_found_and_kept_apart_from_the_pixels():
    rng = np.random.default_rng(4)
    pattern = rng.normal(0, 5, SHAPE)
    image = 1000 + 10 * np.arange(SHAPE[1])[None, :] + pattern
    frames = (make_frame(image + rng.normal(0, 2, SHAPE)) for _ in range(50))
    (seen,) = observe_patches(frames, [PATCH])
    # Four columns of cells, 4 pixels apart: means at -60, -20, 20, 60 DN, each in 4 of 16 cells.
    expected = 4 * np.sum(np.square([-60, -20, 20, 60])) / 15
    # Within a cell: the pattern, and a gradient of 10 DN a pixel over 4 pixels, (30^2 ... sampled) 125 DN^2 * 16 / 15.
    within = 25 + 125 * 16 / 15
    assert seen.nonuniformity.slow_variance_dn2(0.0) == pytest.approx(expected, rel=0.05)
    assert seen.fixed_pattern_variance_dn2(0.0) == pytest.approx(within, rel=0.15)


@pytest.mark.parametrize("std_dn", [0.1, 0.2, 0.3, 0.5, 1.0])
def test_rounding_of_a_mean(std_dn):
    offsets = np.linspace(-0.5, 0.5, 400, endpoint=False)
    # Expectation of the rounded value: sum over the steps of the probability to be above each.
    means = ndtr((offsets[:, None] - np.arange(-9, 10) - 0.5) / std_dn).sum(axis=1)
    truth = np.mean((means - means.mean() - offsets + offsets.mean()) ** 2)
    bound = exp(-4 * pi**2 * std_dn**2) / 12
    assert truth <= bound * 1.001 + 1e-9
    assert quantisation_variance_dn2(std_dn**2 + 1 / 12) == pytest.approx(bound)


def test_the_dark_pattern_is_taken_off():
    pattern = np.rint(np.random.default_rng(8).normal(0, 20, SHAPE)) + 10 * np.arange(SHAPE[1])
    pattern -= pattern.mean()
    image = np.rint(500 + pattern)
    library = SimpleNamespace(correction_dn=lambda *exposed: pattern, noise_dn=lambda *exposed: 0.7)
    plain = observe_dark([make_frame(image)] * 2)
    even = observe_dark([make_frame(image)] * 2, dark_library=library)
    assert plain.nonuniformity_dn > 50
    assert even.nonuniformity_dn < 0.5
    assert even.pattern_dn == 0.7  # not what is left of a library in the frames it was made of
    assert even.mean_dn == pytest.approx(plain.mean_dn)
    (seen,) = observe_patches([make_frame(image)] * 2, [PATCH], dark_library=library)
    assert seen.mean_dn == pytest.approx(500, abs=0.5)
    assert seen.nonuniformity.pixel_variance_dn2(0.0) < 1


@pytest.mark.parametrize(
    ("n_frames", "regions", "message"),
    [
        (0, [PATCH], "there is no frame: give at least 2 frames"),
        (1, [PATCH], r"was given 1 frame at"),
        (2, [Roi.rectangle("dot", 0, 0, 3, 5)], "holds 15 pixels: make it at least 16"),
        (2, [PATCH, PATCH], "several regions are called 'grey'"),
    ],
)
def test_too_few_frames_and_regions_that_cannot_be_used_are_refused(n_frames, regions, message):
    with pytest.raises(LabcdpError, match=message):
        observe_patches([make_frame(np.full(SHAPE, 9.0))] * n_frames, regions)
