from math import inf, sqrt

import numpy as np
import pytest
from scipy.stats import norm

from labcdp.chain import Chain
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_pair, evaluate_run, evaluate_stage, shown_distribution
from labcdp.metrics import cdp_range

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
glare_subtracted = {subtracted}
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


def run(scene="checkerboard", more=SQUARES, glare=0.0, subtracted="false", seed=0):
    return Chain.from_toml(CHAIN.format(scene=scene, more=more, glare=glare, subtracted=subtracted), "test").run(seed)


def test_scene_keeps_every_contrast():
    pair = evaluate_run(run()).stages[0].pairs[0]
    assert pair.true_contrast == 0.3
    assert pair.cdp.cdp == 1.0
    assert pair.cdp.contrast == 0.3
    assert pair.csnr.value == pair.d_prime.value == inf


@pytest.mark.parametrize(("glare", "subtracted"), [(0.0, "false"), (0.1, "true")])
def test_vignetting_is_no_noise_and_no_contrast_of_saturated_pixels(glare, subtracted):
    open_lens = run(glare=glare, subtracted=subtracted).chain
    # At the corner of 64 x 48 pixels of 4 um, 0.2 mm behind the lens, 38 % of the light is left.
    chain = open_lens.with_(optics__focal_length_m=2e-4)
    dark, bright = evaluate_stage(chain.run(), "optics").regions
    assert dark.snr.value == bright.snr.value == inf
    # Shot noise falls with the root of the light, and the mean with the light.
    plain, fallen = (evaluate_stage(one.run(), "sensor").regions[0].snr for one in (open_lens, chain))
    assert 0.6 * plain.value < fallen.value < plain.value
    full = chain.with_(exposure__exposure_s=0.1)
    pair, *regions = evaluate_pair(full.run(), "sensor")
    assert [one.saturated_share for one in regions] == [1.0, 1.0]
    assert (pair.cdp.cdp, pair.cdp.below) == (0.0, 1.0)
    assert pair.measured_contrast == pytest.approx(0.0, abs=2e-5)


def test_cdp_of_a_stage_is_that_of_its_regions():
    done = run()
    pair = evaluate_stage(done, "sensor").pairs[0]
    luminance, masks = done["sensor"].luminance_cd_m2, done.chain.scene.regions()
    assert (pair.cdp,) == cdp_range(luminance[masks["bright"]], luminance[masks["dark"]], [0.3])


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


def test_glare_costs_contrast_or_where_it_is_subtracted_noise():
    subtracted, veiled, clear = (
        evaluate_run(run(**one)) for one in ({"glare": 1.0, "subtracted": "true"}, {"glare": 1.0}, {})
    )
    # Squares of 100 and 130 cd/m^2 under a veil of their mean.
    for result, contrast in ((subtracted, 0.3), (veiled, 30 / 215), (clear, 0.3)):
        for stage in result.stages[1:3]:
            assert stage.pairs[0].measured_contrast == pytest.approx(contrast, rel=1e-5)
    cdps = [result.stages[3].pairs[0].cdp.cdp for result in (veiled, subtracted, clear)]
    assert cdps == sorted(set(cdps))


def test_contrast_asked_for_replaces_that_of_the_scene():
    result = evaluate_run(run(), contrast=0.5, epsilon=0.1)
    assert [stage.pairs[0].cdp.contrast for stage in result.stages] == [0.5] * 4
    assert result.stages[0].pairs[0].cdp.cdp == 0.0


def test_no_light_has_no_contrast():
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


def test_shown_distribution_keeps_mean_and_extent():
    values = np.random.default_rng(1).normal(5.0, 1.0, (200, 300)).astype(np.float32)
    shown = shown_distribution(values)
    assert shown.size == values.size
    assert shown.values.size <= 4096
    assert shown.mean == pytest.approx(values.mean(dtype=np.float64), rel=1e-9)
    assert shown.values[0] == pytest.approx(values.min(), abs=0.01)
    assert shown.values[-1] == pytest.approx(values.max(), abs=0.01)
