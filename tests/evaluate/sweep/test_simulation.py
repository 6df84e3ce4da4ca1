from dataclasses import replace
from math import inf, sqrt

import pytest
from scipy.stats import norm

from labcdp.chain import StepChart
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_pair, evaluate_run, evaluate_stage

from .chains import small


@pytest.mark.parametrize(("glare", "subtracted"), [(0.0, False), (0.1, True)])
def test_vignetting_is_no_noise_and_no_contrast_of_saturated_pixels(glare, subtracted):
    open_lens = small(windscreen__glare_fraction=glare, windscreen__glare_subtracted=subtracted)
    # At the corner of 64 x 48 pixels of 4 um, 0.2 mm behind the lens, 38 % of the light is left.
    chain = open_lens.with_(optics__focal_length_m=2e-4)
    dark, bright = evaluate_stage(chain.run(), "optics").regions
    assert dark.snr.value == bright.snr.value == inf
    # Shot noise falls with the root of the light, and the mean with the light.
    plain, fallen = (evaluate_stage(one.run(), "sensor").regions[0].snr for one in (open_lens, chain))
    assert 0.6 * plain.value < fallen.value < plain.value
    full = chain.with_(exposure__exposure_s=0.1)
    (pair,), *regions = evaluate_pair(full.run(), "sensor")
    assert [one.saturated_share for one in regions] == [1.0, 1.0]
    assert (pair.cdp.cdp, pair.cdp.below) == (0.0, 1.0)
    assert pair.measured_contrast == pytest.approx(0.0, abs=2e-5)


def test_mean_contrast_is_that_of_all_pairs():
    done = small().run()
    luminance, masks = done["sensor"].luminance_cd_m2.astype(float), done.chain.scene.regions()
    pairs = luminance[masks["bright"]][:, None] / luminance[masks["dark"]] - 1
    pair = evaluate_stage(done, "sensor").pairs[0]
    assert pair.mean_contrast == pytest.approx(pairs.mean(), rel=1e-9)
    # It is above the contrast of the means, as 1 / x bends upwards.
    assert pair.mean_contrast > pair.measured_contrast


def test_cdp_behind_the_sensor_is_that_of_normal_noise():
    (pair,), dark, bright = evaluate_pair(small(scene__luminance_cd_m2=20.0).run(), "sensor")
    s_d, s_b = dark.luminance_standard_deviation_cd_m2, bright.luminance_standard_deviation_cd_m2
    closed = [norm.cdf((r * 20 - 26) / sqrt((r * s_d) ** 2 + s_b**2)) for r in (1 + 0.3 * 1.5, 1 + 0.3 * 0.5)]
    assert pair.cdp.cdp == pytest.approx(closed[0] - closed[1], abs=3 * pair.cdp.standard_error)


def test_no_light_has_no_contrast():
    run = replace(small(), scene=StepChart(64, 48, (0.0, 10.0))).run()
    pair = evaluate_run(run).stages[0].pairs[0]
    assert pair.true_contrast == inf
    assert pair.cdp is None
    # Unless one is asked for: every bright pixel then has an unbounded contrast to a dark one.
    assert [pair.cdp.above for pair in evaluate_run(run, (0.5, 1.0)).stages[0].pairs] == [1.0, 1.0]
