"""Stated 95 % intervals in worlds that differ from the fitted model; `benchmarks/worlds` runs all of them at length."""

from math import sqrt

import numpy as np
import pytest
from scipy.stats import norm
from worlds.bench import FRAMES, QUANTITIES, calibrate_once
from worlds.camera import (
    curved,
    expected_dn,
    expected_noise_dn,
    expose,
    make_device,
    straightened,
)
from worlds.meter import read_patches, scale_errors
from worlds.recorder import LIGHT_S, READ_S, Recorder
from worlds.table import LOWEST, NAMED, binomial_error, summarise
from worlds.target import Target, calibration_target
from worlds.truth import PIXELS, cdp, true_pixels
from worlds.world import HEIGHT, WIDTH, WORLDS, World

from labcdp.calibration.convert.bracket import bracket_luminance

#: Worlds in which labcdp's intervals hold, or a finding names the effect, with the number of calibrations;
#: `benchmarks/worlds` has 400.
FEW = ("ideal", "gamma 2.2", "one wrong reading of one, 20 %")
MORE = ("patch scatter 1 %", "lamp flicker 1 %", "patch scatter 0.3 %", "lamp drift 1 %", "refocusing 0.5 %")
HOLDING = (
    *((name, 5) for name in FEW),
    *(pytest.param(name, 40, marks=pytest.mark.long) for name in (*FEW, *MORE, "glare 0.5 %", "meter scale 2 %")),
)


@pytest.fixture
def rng():
    return np.random.default_rng(20261122)


def test_mean_and_variance_of_frames_follow_photon_transfer(rng):
    """Mean and temporal variance at the middle of the image, against the closed forms of EMVA 1288."""
    device = make_device(World(row_dn=0.5), rng)
    frames = np.array([expose(device, 40.0, 0.01, rng) for _ in range(200)])[:, 46:50, 62:66].astype(float)
    noise_dn = expected_noise_dn(device, 40.0, 0.01)
    # Rows have a common part: take it as fully common, 4 rows a frame.
    assert frames.mean() == pytest.approx(expected_dn(device, 40.0, 0.01), abs=4 * noise_dn / sqrt(200 * 4), rel=0)
    assert frames.var(axis=0, ddof=1).mean() == pytest.approx(noise_dn**2, rel=4 * sqrt(2 / (200 * 4)))


@pytest.mark.parametrize("world", [World(cubic=0.01), World(gamma=2.2)], ids=["cubic", "gamma"])
def test_the_response_is_inverted_exactly(world, rng):
    linear_dn = rng.uniform(world.black_dn, 4000, 1000)
    np.testing.assert_allclose(straightened(curved(linear_dn, world), world), linear_dn, rtol=1e-12)


def test_true_cdp_equals_all_pairs_and_the_closed_form(rng):
    bright, dark = rng.normal(1.3, 0.2, 300), rng.normal(0.5, 0.3, 400)
    pairs = bright[:, None] / dark[None, :] - 1
    counted = np.mean((dark > 0) & (bright[:, None] > 0) & (pairs >= 0.5) & (pairs <= 1.5))
    assert cdp(bright, dark, 1.0, 0.5) == counted
    # Normal noise: b - (1 + K) d is normal too.
    bright, dark = rng.normal(1.3, 0.05, PIXELS), rng.normal(1.0, 0.04, PIXELS)
    low, high = (norm.cdf((1.3 - q) / np.hypot(0.05, 0.04 * q)) for q in (1.15, 1.45))
    assert cdp(bright, dark, 0.3, 0.5) == pytest.approx(low - high, abs=4 * 0.5 * sqrt(2 / PIXELS))


def test_true_pixels_have_the_true_mean_and_the_noise_of_photon_transfer(rng):
    world = World(prnu_rel=0.01, dsnu_e=2.0, column_dn=0.3, row_dn=0.4)
    device = make_device(world, rng)
    target = Target({"P": (60, 44, 8, 8)}, {"P": 50.0}, {"P": {}}, np.zeros((HEIGHT, WIDTH)))
    pixels = true_pixels(device, target, "P", 0.01, rng, weights={"": 1.0})
    per_cd_m2 = 0.4 * device.responsivity_e_s_cd_m2 * 0.01
    variance = expected_noise_dn(device, 50.0, 0.01) ** 2 + 0.8**2 + 0.3**2 + (0.01 * 50 * per_cd_m2) ** 2
    assert pixels.mean() == pytest.approx(50.0, abs=4 * sqrt(variance / PIXELS) / per_cd_m2, rel=0)
    assert pixels.var() == pytest.approx(variance / per_cd_m2**2, rel=4 * sqrt(2 / PIXELS))


@pytest.mark.parametrize(("name", "n"), HOLDING)
def test_stated_intervals_hold_or_a_finding_names_the_effect(name, n):
    """At least 93 %, within 3 sigma / sqrt(N) of a share; else 90 % of the failures are named."""
    world = next(world for world in WORLDS if world.name == name)
    summary = summarise(world, [calibrate_once(world, number) for number in range(n)])
    assert summary.reasons == {}
    holds = {q: summary.coverage[q] >= LOWEST - 3 * binomial_error(LOWEST, n) for q in QUANTITIES}
    assert all(holds.values()) or summary.named_where_wrong >= NAMED, summary
    if "wrong reading" in name:
        assert summary.named == 1


def test_a_calibration_is_the_same_for_the_same_number():
    assert calibrate_once(WORLDS[0], 5) == calibrate_once(WORLDS[0], 5) != calibrate_once(WORLDS[0], 6)


def test_nothing_moves_in_a_still_scene_of_a_camera_with_a_tone_curve(rng, tmp_path):
    """Its noise is that before the curve, though the response is fitted to the patches without a bracket."""
    world = World(gamma=2.2)
    device = make_device(world, rng)
    recorder, target = Recorder(device, rng, tmp_path), calibration_target(world, rng)
    shown = read_patches(world, target.luminance_cd_m2, scale_errors(world, rng), rng, LIGHT_S, READ_S)
    with recorder.record("calibration", target, shown, frames=FRAMES) as session:
        calibration = session.calibrate().calibration
    assert calibration.response.kind == "gamma"
    for _ in range(3):
        scene = rng.permutation(np.geomspace(0.5, 480, HEIGHT * WIDTH)).reshape(HEIGHT, WIDTH)
        frames = [recorder.frame(expose(device, scene, t, rng), t, 0) for t in world.exposures_s for _ in range(3)]
        assert bracket_luminance(calibration, frames).inconsistent_share == 0
