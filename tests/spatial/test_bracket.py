from itertools import pairwise

import numpy as np
import pytest

from labcdp.calibration.bracket import bracket_luminance
from labcdp.calibration.dark_library import DarkLibrary
from labcdp.calibration.defects import Defect, DefectMap
from labcdp.errors import CalibrationError, InputError
from labcdp.luminance import Invalid, LuminanceMap, chosen
from labcdp.vignetting import FlatField, middle_of

SHAPE = (120, 160)
EXPOSURES = (0.0005, 0.002, 0.008, 0.032, 0.128)


@pytest.fixture(scope="module")
def scene():
    """Four decades of luminance, in no order."""
    values = np.geomspace(0.6, 1900, SHAPE[0] * SHAPE[1])
    return np.random.default_rng(5).permutation(values).reshape(SHAPE)


@pytest.fixture(scope="module")
def calibration(make_calibration):
    return make_calibration(shape=SHAPE, exposures_s=(0.0005, 0.128))


@pytest.fixture(scope="module")
def frames(scene, expose):
    rng = np.random.default_rng(6)
    return [expose(scene, t, rng, frame_id=i) for i, t in enumerate(EXPOSURES)]


def test_the_bracket_finds_the_scene_within_its_uncertainty(calibration, frames, scene):
    result = bracket_luminance(calibration, frames)
    seen = result.map
    assert seen.valid.all()
    deviation = (seen.luminance_cd_m2 / scene - 1) / seen.random_rel
    n = deviation.size
    # Standard deviation of a mean, and of a standard deviation, of n normal numbers.
    assert abs(deviation.mean()) < 4 / np.sqrt(n)
    assert deviation.std() == pytest.approx(1, abs=4 / np.sqrt(2 * n) + 0.02)  # rounding is not normal
    assert result.inconsistent_share == 0
    assert result.warnings == ()


def test_no_part_of_the_range_is_shifted(calibration, frames, scene):
    """Noisy weights would pull dark pixels down; so would frames that are just not saturated."""
    seen = bracket_luminance(calibration, frames).map
    deviation = (seen.luminance_cd_m2 / scene - 1) / seen.random_rel
    edges = np.geomspace(0.6, 1900, 41)
    for low, high in pairwise(edges):
        part = deviation[(scene >= low) & (scene < high)]
        assert abs(part.mean()) < 4.5 / np.sqrt(part.size)


def test_the_bracket_is_nearer_to_the_scene_than_each_exposure(calibration, frames, scene):
    result = bracket_luminance(calibration, frames)
    for frame in frames:
        alone = calibration.to_luminance(frame)
        usable = (frame.dn < 3900) & (scene > 1)
        errors = [np.sqrt(np.mean((m.luminance_cd_m2[usable] / scene[usable] - 1) ** 2)) for m in (result.map, alone)]
        assert errors[0] < errors[1]
    assert result.n_used.max() == len(EXPOSURES)


def test_weights_are_optimal_for_shot_noise(calibration, make_frame):
    """Without read noise the best estimate is all electrons over all time."""
    frames = [make_frame(np.full(SHAPE, 64 + 40 * t + 1200 * 20 * t), t) for t in (0.02, 0.04)]
    seen = bracket_luminance(calibration, frames).map
    net = np.array([1200 * 20 * t for t in (0.02, 0.04)])
    variances = (0.25 * net + 1.5**2) / (1200 * np.array([0.02, 0.04])) ** 2
    assert seen.random_rel == pytest.approx(np.sqrt(1 / np.sum(1 / variances)) / 20, rel=0.01)


def test_common_errors_are_weighted_as_the_exposures(calibration, frames, scene):
    seen = bracket_luminance(calibration, frames).map
    by_source = {error.source: error for error in seen.common}
    assert by_source["meter scale"].relative == pytest.approx(0.02 / np.sqrt(3))
    assert by_source["meter scale"].rectangular
    # An error of the dark offset of 0.2 DN is one of 0.2 / (R t) cd/m^2 at each exposure: brute force.
    maps = [calibration.to_luminance(f) for f in frames]
    shifted = np.stack([m.luminance_cd_m2 - 0.2 / (1200 * f.exposure_s) for m, f in zip(maps, frames, strict=True)])
    dark = scene < 10
    relative = np.asarray(by_source["dark and temperature"].relative)[dark]
    longest = 0.2 / (1200 * EXPOSURES[-1]) / scene[dark]
    shortest = 0.2 / (1200 * EXPOSURES[0]) / scene[dark]
    assert shifted.shape[0] == len(frames)
    assert (relative < -longest * 0.9).all()
    assert (relative > -shortest).all()


def test_saturation_at_every_exposure_is_told(calibration, expose, scene):
    bright = scene.copy()
    bright[0, 0] = 1e5
    rng = np.random.default_rng(7)
    result = bracket_luminance(calibration, [expose(bright, t, rng) for t in EXPOSURES])
    assert result.map.invalid[0, 0] & Invalid.SATURATED
    assert result.n_used[0, 0] == 0
    assert result.warnings[-1].endswith("of the pixels are saturated even at 0.0005 s: add a shorter exposure")


def test_movement_is_flagged(calibration, expose, scene):
    rng = np.random.default_rng(8)
    frames = [expose(scene, t, rng) for t in EXPOSURES]
    moved = scene.copy()
    moved[:12] = 30.0
    frames[2] = expose(moved, EXPOSURES[2], rng)
    result = bracket_luminance(calibration, frames)
    flagged = np.not_equal(result.map.invalid & Invalid.INCONSISTENT, 0)
    different = np.abs(np.log(scene[:12] / 30)) > 0.7
    # Where the third exposure is saturated by the scene it never was compared.
    compared = scene[:12] < 300
    assert flagged[:12][different & compared].mean() > 0.95
    assert not flagged[12:].any()
    assert "differ between the exposures by more than noise" in result.warnings[0]


def test_defect_pixels_do_not_count(make_calibration, frames):
    reasons = np.zeros(SHAPE, np.uint8)
    reasons[3, 4] = Defect.HOT
    result = bracket_luminance(make_calibration(shape=SHAPE, defects=DefectMap.of(reasons)), frames)
    assert result.map.invalid[3, 4] == Invalid.DEFECT
    assert result.n_used[3, 4] == 0


def test_noise_of_the_flat_field_does_not_average_down(make_calibration, make_frame):
    flat = FlatField(np.ones(SHAPE), 0.01, 0.0, 4)
    assert flat.relative[middle_of(SHAPE)].mean() == 1
    frame = make_frame(np.full(SHAPE, 3000.0), 0.02)
    calibration = make_calibration(shape=SHAPE, vignetting=flat)
    many = bracket_luminance(calibration, [frame] * 16).map.random_rel
    alone = calibration.to_luminance(frame).random_rel
    assert many**2 - 0.01**2 == pytest.approx((alone**2 - 0.01**2) / 16, rel=1e-3)


def test_noise_of_the_dark_library_does_not_average_down(make_calibration, expose):
    """Many frames of dim light: what is left is the error of the library, which is the same in all of them."""
    rng = np.random.default_rng(11)
    pattern, error = rng.normal(0, 6, SHAPE), rng.normal(0, 2, SHAPE)
    pattern -= pattern.mean()
    library = DarkLibrary(
        pattern + error, np.zeros(SHAPE), ((4.0, 0.0), (0.0, 0.0)), ((36.0, 0.0), (0.0, 0.0)), None, None, 4
    )
    calibration = make_calibration(shape=SHAPE, dark_library=library)
    frames = [expose(np.full(SHAPE, 5.0), 0.032, rng, pattern_dn=pattern, frame_id=i) for i in range(16)]
    seen = bracket_luminance(calibration, frames).map
    n = seen.luminance_cd_m2.size
    deviation = (seen.luminance_cd_m2 / 5.0 - 1) / seen.random_rel
    assert deviation.std() == pytest.approx(1, abs=4 / np.sqrt(2 * n) + 0.01)
    assert seen.fixed_cd_m2 == pytest.approx(2 / (1200 * 0.032), rel=1e-3)
    # Joined again, nothing more is gained.
    assert calibration.to_luminance(frames[0]).fixed_cd_m2 == pytest.approx(seen.fixed_cd_m2, rel=1e-5)


def test_one_frame_is_itself(calibration, frames):
    result, alone = bracket_luminance(calibration, frames[:1]), calibration.to_luminance(frames[0])
    np.testing.assert_allclose(result.map.luminance_cd_m2, alone.luminance_cd_m2, rtol=1e-6)
    assert (result.map.invalid == alone.invalid).all()


def test_no_frame(calibration):
    with pytest.raises(CalibrationError, match="there is no frame: give the frames of a bracket"):
        bracket_luminance(calibration, [])


def test_maps_are_chosen_with_all_they_hold(calibration, frames):
    a, b = (calibration.to_luminance(frame) for frame in frames[:2])
    where = np.random.default_rng(1).random(SHAPE) < 0.5
    both = chosen(where, a, b)
    for values, x, y in (
        (both.luminance_cd_m2, a.luminance_cd_m2, b.luminance_cd_m2),
        (both.random_rel, a.random_rel, b.random_rel),
        (both.common[3].relative, a.common[3].relative, b.common[3].relative),
        (both.invalid, a.invalid, b.invalid),
    ):
        assert (values[where] == x[where]).all()
        assert (values[~where] == y[~where]).all()


def test_maps_of_different_calibrations_are_not_joined(calibration, frames):
    a = calibration.to_luminance(frames[0])
    b = LuminanceMap(a.luminance_cd_m2, a.random_rel, 0.01, a.invalid)
    with pytest.raises(InputError, match="maps of different calibrations cannot be joined"):
        chosen(np.ones(SHAPE, bool), a, b)
