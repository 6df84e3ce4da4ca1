from math import inf, sqrt

import numpy as np
import pytest
from scipy.stats import norm

from labcdp.chain import chain_from_toml
from labcdp.contrast import cdp, cdp_neighbours
from labcdp.errors import InputError
from labcdp.evaluate import evaluate_run, evaluate_stage
from labcdp.evaluate.simulation import evaluate_pair, shown_distribution

CHAIN = """
name = "test"
spectrum = "monochromatic 555 nm"
[scene]
type = "{scene}"
width = 64
height = 48
{more}
[windscreen]
transmittance = 0.9
glare_fraction = {glare}
[optics]
f_number = 2.0
transmittance = 0.9
[exposure]
exposure_s = 0.01
temperature_c = 25.0
[sensor]
pixel_pitch_m = 4e-6
quantum_efficiency = 0.6
full_well_e = 20000
k_dn_per_e = 0.2
read_noise_e = 5.0
dark_current_e_s = 10.0
bits = 12
black_level_dn = 32.0
"""
BOARD = "luminance_cd_m2 = 100.0\ncontrast = 0.3\nsquare_px = {}"
SQUARES = BOARD.format(8)


def run(scene="checkerboard", more=SQUARES, glare=0.0, seed=0):
    return chain_from_toml(CHAIN.format(scene=scene, more=more, glare=glare), "test").run(seed)


def test_stages_stand_in_order_with_their_units():
    result = evaluate_run(run())
    stages = [(stage.name, stage.quantity, stage.unit) for stage in result.stages]
    assert stages == [
        ("scene", "luminance", "cd/m^2"),
        ("windscreen", "luminance", "cd/m^2"),
        ("optics", "illuminance", "lx"),
        ("sensor", "digital number", "DN"),
    ]


def test_scene_keeps_every_contrast():
    pair = evaluate_run(run()).stages[0].pairs[0]
    assert pair.true_contrast == 0.3
    assert pair.cdp.cdp == 1.0
    assert pair.cdp.contrast == 0.3
    assert pair.csnr.value == pair.d_prime.value == inf


def test_cdp_of_a_stage_is_that_of_its_regions():
    done = run()
    pair = evaluate_stage(done, "sensor").pairs[0]
    luminance, masks = done["sensor"].luminance_cd_m2, done.chain.scene.regions()
    assert pair.cdp == cdp(luminance[masks["bright"]], luminance[masks["dark"]], 0.3)


def test_mean_contrast_is_that_of_all_pairs():
    done = run()
    luminance, masks = done["sensor"].luminance_cd_m2.astype(float), done.chain.scene.regions()
    pairs = luminance[masks["bright"]][:, None] / luminance[masks["dark"]] - 1
    pair = evaluate_stage(done, "sensor").pairs[0]
    assert pair.mean_contrast == pytest.approx(pairs.mean(), rel=1e-9)
    # It is above the contrast of the means, as 1 / x bends upwards.
    assert pair.mean_contrast > pair.measured_contrast


def test_cdp_behind_the_sensor_is_that_of_normal_noise():
    pair, dark, bright = evaluate_pair(run(more=SQUARES.replace("100.0", "20.0")), "sensor")
    s_d, s_b = dark.luminance_standard_deviation_cd_m2, bright.luminance_standard_deviation_cd_m2
    closed = [norm.cdf((r * 20 - 26) / sqrt((r * s_d) ** 2 + s_b**2)) for r in (1 + 0.3 * 1.5, 1 + 0.3 * 0.5)]
    assert pair.cdp.cdp == pytest.approx(closed[0] - closed[1], abs=3 * pair.cdp.standard_error)


def test_glare_is_taken_off_again():
    veiled = evaluate_run(run(glare=1.0))
    for stage in veiled.stages[:3]:
        assert stage.pairs[0].measured_contrast == pytest.approx(0.3, rel=1e-5)
    # It leaves its noise: the same luminances with more photons are less sure.
    clear = evaluate_run(run())
    assert veiled.stages[3].pairs[0].cdp.cdp < clear.stages[3].pairs[0].cdp.cdp


def test_snr_of_the_values_gains_from_glare_and_that_of_luminance_does_not():
    clear, veiled = (evaluate_stage(run(glare=glare), "sensor").regions[0] for glare in (0.0, 1.0))
    assert veiled.snr.value > clear.snr.value
    assert veiled.luminance_snr.value < clear.luminance_snr.value


def test_decibels_are_ten_and_twenty_times_the_logarithm():
    row = evaluate_stage(run(), "sensor").regions[0]
    assert row.snr_10log10_db.value == pytest.approx(10 * np.log10(row.snr.value))
    assert row.snr_20log10_db.value == pytest.approx(20 * np.log10(row.snr.value))


def test_pixel_to_pixel_only_for_squares_of_one_pixel():
    done = run(more=BOARD.format(1))
    pair = evaluate_stage(done, "sensor").pairs[0]
    assert pair.neighbours == cdp_neighbours(done["sensor"].luminance_cd_m2, 0.3)
    assert evaluate_stage(run(), "sensor").pairs[0].neighbours is None


def test_contrast_asked_for_replaces_that_of_the_scene():
    result = evaluate_run(run(), contrast=0.5, epsilon=0.1)
    assert [stage.pairs[0].cdp.contrast for stage in result.stages] == [0.5] * 4
    assert result.stages[0].pairs[0].cdp.cdp == 0.0


def test_contrasts_are_kept_for_the_last_stage_only():
    kept = [stage.pairs[0].contrasts is not None for stage in evaluate_run(run()).stages]
    assert kept == [False, False, False, True]


def test_saturation_is_told():
    result = evaluate_run(run(more=SQUARES.replace("100.0", "1e6")))
    assert result.stages[-1].regions[1].saturated_share == 1.0
    assert "sensor: 100 % of bright is saturated, its luminance is a lower limit" in result.warnings


def test_field_without_contrast_is_told():
    result = evaluate_run(run("flat", "luminance_cd_m2 = 100.0"))
    assert result.warnings == (
        "the scene has no two regions of different luminance, so there is no contrast to detect",
    )
    with pytest.raises(InputError, match=r"no two regions of different luminance: give a checkerboard or a step chart"):
        evaluate_pair(run("flat", "luminance_cd_m2 = 100.0"), "sensor")


def test_darkness_has_no_contrast():
    chart = "luminances_cd_m2 = [0.0, 10.0]"
    pair = evaluate_run(run("step-chart", chart)).stages[0].pairs[0]
    assert pair.true_contrast == inf
    assert pair.cdp is None
    # Unless one is asked for: every bright pixel then has an unbounded contrast to a dark one.
    assert evaluate_run(run("step-chart", chart), contrast=1.0).stages[0].pairs[0].cdp.above == 1.0


def test_step_chart_has_a_pair_for_each_step():
    result = evaluate_run(run("step-chart", "luminances_cd_m2 = [10.0, 40.0, 20.0]"))
    pairs = [(pair.dark, pair.bright, pair.true_contrast) for pair in result.stages[0].pairs]
    assert pairs == [("step 1", "step 2", 3.0), ("step 3", "step 2", 1.0)]


@pytest.mark.parametrize(("contrast", "epsilon"), [(0.0, 0.5), (-1.0, 0.5), (0.3, 0.0), (0.3, 1.5)])
def test_contrast_and_tolerance_are_checked(contrast, epsilon):
    with pytest.raises(InputError, match=r"give a fraction above 0"):
        evaluate_run(run(), contrast, epsilon)


def test_shown_distribution_keeps_mean_and_extent():
    values = np.random.default_rng(1).normal(5.0, 1.0, (200, 300)).astype(np.float32)
    shown = shown_distribution(values)
    assert shown.size == values.size
    assert shown.values.size <= 4096
    assert shown.mean == pytest.approx(values.mean(dtype=np.float64), rel=1e-9)
    assert shown.values[0] == pytest.approx(values.min(), abs=0.01)
    assert shown.values[-1] == pytest.approx(values.max(), abs=0.01)


def test_shown_distribution_of_two_levels_is_exact():
    shown = shown_distribution(np.array([[1.0, 3.0], [3.0, 3.0]], np.float32))
    assert shown.values.tolist() == [1.0, 3.0]
    assert shown.weights.tolist() == [1, 3]
