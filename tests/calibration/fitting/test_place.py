"""Errors that go with the place of a patch: the flat field's own, and a vignetting that is not taken off."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import contrast_u, fit, patch_luminance
from labcdp.calibration.frames.nonuniformity import smooth_patterns
from labcdp.core.vignetting import Cos4Vignetting, RadialVignetting

from ..conftest import EXPOSURES_S, make_reading

SHAPE = (48, 64)
PLACES = [(4, 4), (60, 4), (4, 24), (60, 24), (4, 44), (60, 44)]


def seen_at(camera, name, luminance, place, light, vignetting):
    """Observations of a patch at a place where the camera gets the part `light` of the light."""
    return [
        replace(camera.observe(name, luminance * light, t, None), centre_px=place, vignetting=vignetting)
        for t in EXPOSURES_S
    ]


def test_smooth_patterns_have_mean_0_and_rms_1_over_the_image():
    patterns = smooth_patterns(SHAPE, [(x + 0.5, y + 0.5) for y in range(SHAPE[0]) for x in range(SHAPE[1])])
    # Sums over pixels for integrals: right to one over the square of their number along a side.
    assert patterns.mean(axis=0) == pytest.approx(0, abs=2e-3)
    assert patterns.T @ patterns / len(patterns) == pytest.approx(np.eye(3), abs=3e-3)


@pytest.mark.parametrize(
    "vignetting",
    [Cos4Vignetting(1.0, 1e-6, None, 0.01), RadialVignetting(-0.2, 0, 0, None, ((1e-4, 0, 0), (0, 0, 0), (0, 0, 0)))],
)
def test_an_error_of_the_vignetting_moves_fit_and_patches_together(camera, setup, vignetting):
    """It is what a fit in the wrong light and then the same patches give, and cancels between near ones."""
    places = {"edge": (4, 4), "near": (5, 4), "middle": (32, 24)}

    def light(place):
        return 1 + vignetting.common_errors_at(SHAPE, place)[0]

    def seen(calibration, of_light):
        return {
            name: patch_luminance(calibration, seen_at(camera, "new", 300.0, place, of_light(place), vignetting))
            for name, place in places.items()
        }

    def fitted(of_light):
        lit = {f"P{k}": (one, place) for k, (one, place) in enumerate(zip((5.0, 300.0) * 3, PLACES, strict=True))}
        seen = [seen_at(camera, name, one, place, of_light(place), vignetting) for name, (one, place) in lit.items()]
        readings = {name: [make_reading(one)] for name, (one, _) in lit.items()}
        return fit([o for group in seen for o in group], [camera.dark(t, None) for t in EXPOSURES_S], readings, setup)

    calibrations = [fitted(of_light) for of_light in (lambda _: 1.0, light)]
    right, wrong = map(seen, calibrations, (lambda _: 1.0, light))
    # Of a normal error of width 1, the patches take off all but the square of the width that they leave.
    left = (
        calibrations[0].vignetting.corner_rel / vignetting.corner_rel if isinstance(vignetting, Cos4Vignetting) else 1
    )
    stated = [[e for e in right[name].common if e.source in ("vignetting", "flat field")] for name in places]
    moved = {name: wrong[name].luminance_cd_m2 / right[name].luminance_cd_m2 - 1 for name in places}
    assert [-left * float(error.relative) for (error,) in stated] == pytest.approx(list(moved.values()), abs=2e-4)
    assert 1 >= left > 0.3
    assert abs(moved["middle"]) > 1e-3
    near, far = (contrast_u(right["edge"], right[other]) for other in ("near", "middle"))
    assert near < 0.1 * far


@pytest.mark.parametrize("n", [6, pytest.param(16, marks=pytest.mark.long)])
def test_intervals_hold_for_lenses_that_differ_from_cos4_as_assumed(camera, setup, n):
    """Share of intervals that hold at the middle and at a corner, within 3 sigma; and U is not that of the lenses."""
    inside, half_widths = [], []
    prior = Cos4Vignetting(1.0, 1e-6, None, 0.05)
    places = [(x, y) for x in (8, 24, 40, 56) for y in (6, 18, 30, 42)]
    for seed in range(n):
        rng = np.random.default_rng(seed)
        lens = replace(prior, log_corner=0.05 * rng.normal())

        def seen(name, luminance, place, lens=lens, rng=rng):
            light = luminance * lens.more_than(prior, SHAPE, place)
            observed = (camera.observe(name, light, t, rng) for t in EXPOSURES_S)
            return [replace(one, centre_px=place, vignetting=prior) for one in observed]

        lights = rng.permutation(np.geomspace(1, 500, 16))
        lit = {f"P{k}": one for k, one in enumerate(zip(lights, places, strict=True))}
        readings = {name: [make_reading(float(one * (1 + 0.002 * rng.normal())))] for name, (one, _) in lit.items()}
        observations = [o for name, (one, place) in lit.items() for o in seen(name, one, place)]
        calibration = fit(observations, [camera.dark(t, rng) for t in EXPOSURES_S], readings, setup)
        for place in ((32, 24), (2, 2)):
            one = patch_luminance(calibration, seen("new", 300.0, place))
            # The readings here are without a scale error.
            u = np.hypot(one.random_rel, one.fit_rel)
            inside.append(abs(one.luminance_cd_m2 / 300 - 1) <= 1.96 * u)
            half_widths.append(1.96 * u)
    assert np.mean(inside) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / n)
    assert np.max(half_widths) < 0.02
