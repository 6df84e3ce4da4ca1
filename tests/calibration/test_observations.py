import gc
import weakref
from dataclasses import replace
from math import erf, exp, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration import observe_dark, observe_patches
from labcdp.calibration.defects import Defect, DefectMap
from labcdp.calibration.region_statistics import quantisation_variance_dn2
from labcdp.errors import CalibrationError, InputError
from labcdp.roi import Roi
from labcdp.vignetting import Cos4Vignetting

PATCH = Roi.rectangle("grey", 8, 4, 16, 16)
SHAPE = (24, 32)


def test_means_and_noise_of_known_frames(new_frame):
    rng = np.random.default_rng(1)
    images = [rng.integers(100, 200, SHAPE).astype(float) for _ in range(3)]
    (seen,) = observe_patches((new_frame(i, frame_id=n) for n, i in enumerate(images)), [PATCH])
    cut = np.array([image[4:20, 8:24] for image in images])
    assert seen.patch == "grey"
    assert (seen.n_pixels, seen.n_frames, seen.exposure_s) == (256, 3, 0.01)
    assert seen.signal_dn == pytest.approx(cut.mean())
    expected = np.mean([np.var(cut[1] - cut[0], ddof=1), np.var(cut[2] - cut[1], ddof=1)]) / 2
    assert seen.temporal_variance_dn2 == pytest.approx(expected)


def test_flicker_of_the_lamp_is_no_noise(new_frame):
    image = np.random.default_rng(1).integers(100, 200, SHAPE).astype(float)
    (seen,) = observe_patches([new_frame(image), new_frame(image + 20)], [PATCH])
    assert seen.temporal_variance_dn2 == 0.0


def test_clipped_shares(new_frame):
    dark_corner, image = np.full(SHAPE, 500.0), np.full(SHAPE, 500.0)
    dark_corner[4, 8:12] = 0
    image[5, 8:24] = 4095
    (seen,) = observe_patches([new_frame(dark_corner), new_frame(image)], [PATCH])
    assert (seen.black_share, seen.saturated_share) == (4 / 512, 16 / 512)


def test_vignetting_is_removed_from_the_light_and_not_from_the_dark(new_frame):
    vignetting = Cos4Vignetting(focal_length_m=0.006, pixel_pitch_m=1e-4)
    v = vignetting.relative_illuminance(SHAPE)
    image = np.rint(64 + 3000 * v)
    (seen,) = observe_patches([new_frame(image), new_frame(image)], [PATCH], vignetting)
    cut = v[4:20, 8:24]
    assert seen.mean_inverse_v == pytest.approx(np.mean(1 / cut))
    assert seen.net_dn(64.0) == pytest.approx(3000, abs=0.5)
    assert seen.net_dn_at_pixel(64.0) == pytest.approx(3000 * cut.mean(), rel=0.01)


def test_an_even_patch_is_even_only_with_the_right_dark(new_frame):
    vignetting = Cos4Vignetting(focal_length_m=0.006, pixel_pitch_m=1e-4)
    image = 64 + 300 * vignetting.relative_illuminance(SHAPE)
    noise = np.random.default_rng(2)
    frames = [new_frame(image + noise.normal(0, 0.5, SHAPE)) for _ in range(16)]
    (seen,) = observe_patches(frames, [PATCH], vignetting)
    assert seen.nonuniformity_variance_dn2(64.0) == 0.0
    cells = (64 / vignetting.relative_illuminance(SHAPE))[4:20, 8:24].reshape(4, 4, 4, 4)
    between, within = np.var(cells.mean(axis=(1, 3)), ddof=1), np.mean(cells.var(axis=(1, 3))) * 16 / 15
    assert seen.nonuniformity_variance_dn2(0.0) == pytest.approx(between - within / 16, rel=0.1)


def test_noise_alone_is_no_unevenness(camera):
    rng = np.random.default_rng(3)
    uneven = 0
    for _ in range(200):
        (seen,) = observe_patches(camera.frames(np.full(SHAPE, 30.0), 0.01, 2, rng), [PATCH])
        uneven += seen.nonuniformity_variance_dn2(64.4) > 0
    # Three standard deviations of a mean square with 15 degrees of freedom: 1.0 % (F distribution).
    assert uneven <= 200 * 0.01 + 4 * sqrt(200 * 0.01)


def test_a_gradient_is_found_and_kept_apart_from_the_pixels(new_frame):
    rng = np.random.default_rng(4)
    pattern = rng.normal(0, 5, SHAPE)
    image = 1000 + 10 * np.arange(SHAPE[1])[None, :] + pattern
    frames = (new_frame(image + rng.normal(0, 2, SHAPE)) for _ in range(50))
    (seen,) = observe_patches(frames, [PATCH])
    # Four columns of cells, 4 pixels apart: means at -60, -20, 20, 60 DN, each in 4 of 16 cells.
    expected = 4 * np.sum(np.square([-60, -20, 20, 60])) / 15
    # Within a cell: the pattern, and a gradient of 10 DN a pixel over 4 pixels, (30^2 ... sampled) 125 DN^2 * 16 / 15.
    within = 25 + 125 * 16 / 15
    assert seen.nonuniformity_variance_dn2(0.0) == pytest.approx(expected, rel=0.05)
    assert seen.fixed_pattern_variance_dn2(0.0) == pytest.approx(within, rel=0.15)


def test_statistics_meet_the_truth(camera):
    rng = np.random.default_rng(5)
    n_frames, n_pixels = 20, 24 * 32
    whole = Roi.rectangle("whole", 0, 0, 32, 24)
    (seen,) = observe_patches(camera.frames(np.full(SHAPE, 100.0), 0.01, n_frames, rng), [whole])
    variance = camera.pixel_variance_dn2(100.0, 0.01)
    assert seen.signal_dn == pytest.approx(camera.mean_dn(100.0, 0.01), abs=4 * sqrt(variance / (n_frames * n_pixels)))
    assert seen.temporal_variance_dn2 == pytest.approx(variance, rel=4 * sqrt(3 / (n_pixels * (n_frames - 1))))


def test_dark_frames(camera):
    n_frames = 8
    dark = observe_dark(camera.frames(np.zeros(SHAPE), 0.05, n_frames, np.random.default_rng(6)))
    assert (dark.exposure_s, dark.n_pixels, dark.n_frames, dark.black_share) == (0.05, 768, n_frames, 0.0)
    assert dark.mean_dn == pytest.approx(camera.mean_dn(0.0, 0.05), abs=4 * sqrt(dark.mean_variance_dn2))
    assert dark.temporal_variance_dn2 == pytest.approx(1.5**2, rel=4 * sqrt(3 / (768 * 7)))
    assert dark.nonuniformity_dn == 0.0


def test_a_wandering_black_level_widens_the_dark(new_frame):
    rng = np.random.default_rng(7)
    levels = [60.0, 62.0, 64.0, 66.0]
    dark = observe_dark(new_frame(level + rng.normal(0, 1, SHAPE)) for level in levels)
    assert dark.mean_variance_dn2 == pytest.approx(np.var(levels, ddof=1) / 4, rel=0.05)


def test_dark_without_noise_is_known_to_a_fraction_of_a_dn_only(new_frame):
    dark = observe_dark([new_frame(np.full(SHAPE, 64.0))] * 2)
    assert dark.mean_variance_dn2 == pytest.approx(1 / 12)


def test_frames_are_not_kept(new_frame):
    alive = []

    def frames():
        for n in range(12):
            frame = new_frame(np.full(SHAPE, 100.0 + n), frame_id=n)
            alive.append(weakref.ref(frame))
            yield frame
            del frame
            gc.collect()
            assert sum(ref() is not None for ref in alive) <= 2

    observe_dark(frames())
    observe_patches(frames(), [PATCH])


@pytest.mark.parametrize("std_dn", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_rounding_of_a_mean(std_dn):
    offsets = np.linspace(-0.5, 0.5, 400, endpoint=False)
    if std_dn == 0:
        means = np.rint(offsets)
    else:  # expectation of the rounded value: sum over the steps of the probability to be above each
        steps = np.arange(-9, 10) + 0.5
        above = np.array([[0.5 * (1 + erf((o - s) / (std_dn * sqrt(2)))) for s in steps] for o in offsets])
        means = above.sum(axis=1) - 9.5 + 0.0
    truth = np.mean((means - means.mean() - offsets + offsets.mean()) ** 2)
    bound = exp(-4 * pi**2 * std_dn**2) / 12
    assert truth <= bound * 1.001 + 1e-9
    assert quantisation_variance_dn2(std_dn**2 + 1 / 12) == pytest.approx(bound)


def test_temperature_and_place_are_kept(new_frame):
    frames = [replace(new_frame(np.full(SHAPE, 9.0)), temperature_c=t) for t in (30.0, 30.5)]
    (seen,) = observe_patches(frames, [PATCH])
    assert (seen.temperature_c, seen.centre_px) == (30.25, (16.0, 12.0))
    assert observe_dark(frames).temperature_c == 30.25


def test_a_drifting_temperature_is_logged(new_frame, caplog):
    observe_dark([replace(new_frame(np.full(SHAPE, 9.0)), temperature_c=t) for t in (30.0, 33.0)])
    assert caplog.messages == [
        "the camera's temperature went from 30.0 to 33.0 degC over the frames at 0.01 s: let it warm up first"
    ]


def test_an_unknown_temperature_stays_unknown(new_frame, caplog):
    frames = [replace(new_frame(np.full(SHAPE, 9.0)), temperature_c=t) for t in (30.0, None)]
    assert observe_dark(frames).temperature_c is None
    assert caplog.messages == ["some frames at 0.01 s have no temperature: it is taken as unknown"]


class _Defects:
    def mask(self, shape):
        mask = np.zeros(shape, dtype=bool)
        mask[6, 10] = True
        return mask


class _Pattern:
    def __init__(self, pattern_dn):
        self.values = pattern_dn

    def correction_dn(self, shape, exposure_s, temperature_c=None):
        assert (shape, exposure_s, temperature_c) == (SHAPE, 0.01, 30.0)
        return self.values

    def noise_dn(self, exposure_s, temperature_c=None):
        return 0.7


def test_defect_pixels_are_left_out(new_frame):
    image = np.full(SHAPE, 100.0)
    image[6, 10] = 4095
    (seen,) = observe_patches([new_frame(image)] * 2, [PATCH], defects=_Defects())
    assert (seen.signal_dn, seen.n_pixels, seen.saturated_share) == (100.0, 255, 0.0)


def test_the_dark_pattern_is_taken_off(new_frame):
    pattern = np.rint(np.random.default_rng(8).normal(0, 20, SHAPE)) + 10 * np.arange(SHAPE[1])
    pattern -= pattern.mean()
    image = np.rint(500 + pattern)
    plain = observe_dark([new_frame(image)] * 2)
    even = observe_dark([new_frame(image)] * 2, dark_library=_Pattern(pattern))
    assert plain.nonuniformity_dn > 50
    assert even.nonuniformity_dn < 0.5
    assert even.pattern_dn == 0.7  # not what is left of a library in the frames it was made of
    assert even.mean_dn == pytest.approx(plain.mean_dn)
    (seen,) = observe_patches([new_frame(image)] * 2, [PATCH], dark_library=_Pattern(pattern))
    assert seen.signal_dn == pytest.approx(500, abs=0.5)
    assert seen.unevenness.pixel_variance_dn2(0.0) < 1


@given(mean=st.integers(10, 4000), n=st.integers(2, 5))
def test_equal_frames_have_no_noise(new_frame, mean, n):
    (seen,) = observe_patches([new_frame(np.full(SHAPE, float(mean)))] * n, [PATCH])
    assert (seen.signal_dn, seen.temporal_variance_dn2, seen.n_frames) == (mean, 0.0, n)


def test_no_frame():
    with pytest.raises(CalibrationError, match="there is no frame: give at least 2 frames of one exposure"):
        observe_patches([], [PATCH])


def test_a_single_frame(new_frame):
    with pytest.raises(
        CalibrationError, match=r"region 'grey' was given 1 frame at .* s: take at least 2 of each exposure"
    ):
        observe_patches([new_frame(np.full(SHAPE, 9.0))], [PATCH])


def test_two_exposures(new_frame):
    image = np.full(SHAPE, 9.0)
    with pytest.raises(CalibrationError, match=r"frame 7 has an exposure of 0\.02 s, the first frame 0\.01 s"):
        observe_dark([new_frame(image), new_frame(image, 0.02, 7)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gain_db": 6.0}, "gain of the first frame is 0 dB, but frame 0 has 6 dB"),
        ({"pixel_format": "Mono8"}, "pixel format of the first frame is Mono12, but frame 0 has Mono8"),
        ({"saturation_dn": 4000.0}, "saturation of the first frame is 4095 DN, but frame 0 has 4000 DN"),
    ],
)
def test_two_settings(new_frame, change, message):
    frame = new_frame(np.full(SHAPE, 9.0))
    with pytest.raises(CalibrationError, match=message):
        observe_dark([frame, replace(frame, **change)])


def test_two_image_sizes(new_frame):
    with pytest.raises(
        CalibrationError, match="image size of the first frame is 32 x 24 pixels, but frame 0 has 32 x 12"
    ):
        observe_dark([new_frame(np.full(SHAPE, 9.0)), new_frame(np.full((12, 32), 9.0))])


def test_colour_filter(new_frame):
    frame = replace(new_frame(np.full(SHAPE, 9.0)), colour_filter="RG")
    with pytest.raises(CalibrationError, match=r"the frame has a colour filter \(RG\)"):
        observe_dark([frame, frame])


def test_small_region(new_frame):
    small = Roi.rectangle("dot", 0, 0, 3, 5)
    with pytest.raises(CalibrationError, match="region 'dot' holds 15 pixels: make it at least 16"):
        observe_patches([new_frame(np.full(SHAPE, 9.0))] * 2, [small])


def test_region_outside(new_frame):
    with pytest.raises(InputError, match="region 'far' spans x 30 to 40"):
        observe_patches([new_frame(np.full(SHAPE, 9.0))] * 2, [Roi.rectangle("far", 30, 0, 10, 10)])


def test_two_regions_of_one_name(new_frame):
    with pytest.raises(CalibrationError, match="several regions are called 'grey': give each patch its own name"):
        observe_patches([new_frame(np.full(SHAPE, 9.0))] * 2, [PATCH, PATCH])


def test_hot_pixels_are_no_part_of_the_darkness(new_frame):
    rng = np.random.default_rng(8)
    hot = rng.random(SHAPE) < 0.02
    level = np.where(hot, 3000.0, 64 + rng.normal(0, 3, SHAPE))
    reasons = np.where(hot, Defect.HOT.value, 0).astype(np.uint8)
    dark = observe_dark([new_frame(level + rng.normal(0, 2, SHAPE)) for _ in range(8)], defects=DefectMap.of(reasons))
    n = np.count_nonzero(~hot)
    assert dark.n_pixels == n
    assert dark.mean_dn == pytest.approx(level[~hot].mean(), abs=4 * 2 / np.sqrt(8 * n))
    assert dark.pattern_dn == pytest.approx(3.0, rel=4 / np.sqrt(2 * n))
