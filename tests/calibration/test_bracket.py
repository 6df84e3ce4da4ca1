from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration.bracket import bracket_luminance
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.core.luminance import Invalid
from labcdp.core.vignetting import FlatField

from .conftest import expose, make_frame

SHAPE = (60, 80)
EXPOSURES = (0.0005, 0.002, 0.008, 0.032, 0.128)


@pytest.fixture(scope="module")
def scene():
    """Four decades of luminance, in no order."""
    values = np.geomspace(0.6, 1900, SHAPE[0] * SHAPE[1])
    return np.random.default_rng(5).permutation(values).reshape(SHAPE)


def test_the_bracket_finds_the_scene_within_its_uncertainty(make_calibration, scene):
    rng = np.random.default_rng(6)
    result = bracket_luminance(make_calibration(SHAPE), [expose(scene, t, rng) for t in EXPOSURES])
    seen = result.map
    assert seen.valid.all()
    deviation = (seen.luminance_cd_m2 / scene - 1) / seen.random_rel
    n = deviation.size
    # Standard deviation of a mean, and of a standard deviation, of n normal numbers.
    assert abs(deviation.mean()) < 4 / np.sqrt(n)
    assert deviation.std() == pytest.approx(1, abs=4 / np.sqrt(2 * n) + 0.02)  # rounding is not normal
    assert result.inconsistent_share == 0


def test_dark_signal_nonuniformity_is_no_movement(make_calibration, scene):
    """Three times the read noise, in DN the same at all exposures."""
    rng = np.random.default_rng(9)
    pattern = rng.normal(0, 4.5, SHAPE)
    calibration = make_calibration(SHAPE)
    dark = replace(calibration.dark, exposures_s=(0.0005, 0.128), patterns_dn=(4.5, 4.5))
    taken = [expose(scene, t, rng, pattern_dn=pattern, frame_id=i) for i, t in enumerate(2 * EXPOSURES)]
    assert bracket_luminance(replace(calibration, dark=dark), taken).inconsistent_share == 0
    assert bracket_luminance(calibration, taken).inconsistent_share > 0


def test_movement_and_saturation_at_every_exposure_are_flagged(make_calibration, scene):
    rng, scene = np.random.default_rng(8), scene.copy()
    scene[-1, -1] = 1e5
    frames = [expose(scene, t, rng) for t in EXPOSURES]
    moved = scene.copy()
    moved[:12] = 30.0
    frames[2] = expose(moved, EXPOSURES[2], rng)
    result = bracket_luminance(make_calibration(SHAPE), frames)
    flagged = np.not_equal(result.map.invalid & Invalid.INCONSISTENT, 0)
    different = np.abs(np.log(scene[:12] / 30)) > 0.7
    # Where the third exposure is saturated by the scene it never was compared.
    compared = scene[:12] < 300
    assert flagged[:12][different & compared].mean() > 0.95
    assert not flagged[12:].any()
    assert (result.map.invalid[-1, -1] & Invalid.SATURATED, result.n_used[-1, -1]) == (Invalid.SATURATED, 0)


def test_noise_of_the_flat_field_does_not_average_down(make_calibration):
    frame = make_frame(np.full(SHAPE, 3000.0), 0.02)
    calibration = make_calibration(shape=SHAPE, vignetting=FlatField(np.ones(SHAPE), 0.01, 0.0, 4))
    many, alone = bracket_luminance(calibration, [frame] * 16).map, calibration.to_luminance(frame)
    assert many.random_rel**2 - 0.01**2 == pytest.approx((alone.random_rel**2 - 0.01**2) / 16, rel=1e-3)
    assert many.fixed_rel == alone.fixed_rel == pytest.approx(0.01)


def test_noise_of_the_dark_library_does_not_average_down(make_calibration):
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
