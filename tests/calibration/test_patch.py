from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import contrast_u, fit, patch_luminance
from labcdp.core.errors import CalibrationError

from .conftest import EXPOSURES_S, bench, codes


def seen(camera, luminance, rng=None):
    return [camera.observe("wall", luminance, t, rng) for t in EXPOSURES_S]


def test_the_dark_error_moves_fit_and_patch_together(camera, setup):
    """The signed pattern is what a fit with other dark frames and then the same patch give."""
    observations, darks, readings = bench(camera, luminances=np.geomspace(0.5, 20, 6), exposures_s=(0.01, 0.06))
    right = fit(observations, darks, readings, setup)
    before = patch_luminance(right, [camera.observe("wall", 2.0, 0.01, None)])
    patterns = [e for e in right.fit_errors if e.source == "dark and temperature"]
    stated = [e.relative for e in before.common if e.source == "dark and temperature"]
    for pattern, relative in zip(patterns, stated, strict=True):
        moved = [
            replace(d, mean_dn=d.mean_dn + np.dot(pattern.dark, right.dark.sensitivities(d.exposure_s))) for d in darks
        ]
        wrong = fit(observations, moved, readings, setup)
        after = patch_luminance(wrong, [camera.observe("wall", 2.0, 0.01, None)])
        assert after.luminance_cd_m2 / before.luminance_cd_m2 - 1 == pytest.approx(relative, rel=0.02)


def test_the_flicker_of_the_same_frames_counts_once_however_often_they_show_a_patch(calibrated, camera):
    flickering = replace(calibrated, noise=replace(calibrated.noise, flicker_rel=0.01))
    patch = patch_luminance(flickering, [camera.observe("wall", 20.0, 0.008, None)] * 3)
    (flicker,) = [e.relative for e in patch.common if e.source.startswith("lamp flicker")]
    assert flicker == pytest.approx(0.01 / np.sqrt(4), rel=1e-9)  # of 4 frames


def test_the_scale_cancels_in_a_contrast_and_the_dark_signal_does_not(calibrated, camera):
    calibrated = calibrated.at_their_temperature()
    bright = patch_luminance(calibrated, seen(camera, 200.0))
    dark = patch_luminance(calibrated, seen(camera, 0.5))
    of_dark = [[e.relative for e in patch.common if e.source == "dark and temperature"] for patch in (bright, dark)]
    left = np.sum(np.square(np.subtract(*of_dark)))
    a, b = ({e.source: e.relative for e in one.common if e.source.startswith("exposure")} for one in (bright, dark))
    left += sum((a.get(k, 0) - b.get(k, 0)) ** 2 for k in a | b)
    expected = 400 * np.sqrt(bright.random_rel**2 + dark.random_rel**2 + left)
    assert contrast_u(bright, dark) == pytest.approx(expected, rel=1e-6)
    assert contrast_u(bright, dark) < 400 * 0.02 / np.sqrt(3)


def test_saturated_exposures_are_left_out_and_luminances_outside_the_range_named(calibrated, camera):
    calibrated = calibrated.at_their_temperature()
    patch = patch_luminance(calibrated, seen(camera, 300.0))
    assert (patch.luminance_cd_m2, patch.exposures_s) == (pytest.approx(300.0), (0.001, 0.008))
    assert codes(patch) == {"exposure-saturated"}
    for luminance in (0.3, 2500.0):
        assert "luminance-outside-range" in codes(patch_luminance(calibrated, seen(camera, luminance)))
    with pytest.raises(CalibrationError, match=r"no exposure gives .* \(patch 'wall': saturated at 1 ms"):
        patch_luminance(calibrated, seen(camera, 9000.0))


@pytest.mark.parametrize(
    ("exposures_s", "bend", "warned"), [((0.008,), 1.0, True), (EXPOSURES_S, 1.0, False), (EXPOSURES_S, 1.03, True)]
)
def test_a_signal_above_the_calibrated_ones_is_confirmed_by_lower_ones(calibrated, camera, exposures_s, bend, warned):
    seen = [camera.observe("wall", 390.0, t, None) for t in exposures_s]
    bent = [replace(o, mean_dn=o.mean_dn * (bend if o.exposure_s == 0.008 else 1.0)) for o in seen]
    assert ("signal-outside-range" in codes(patch_luminance(calibrated, bent))) == warned
