"""A simulated image: numbers in closed form, and the same ones in its files; findings; pages."""

from dataclasses import replace
from math import inf

import pytest

from labcdp.chain import Flat, StepChart
from labcdp.core.table import Column, Table
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_pair, evaluate_run, evaluate_stage
from labcdp.evaluate.sweep.simulation.page import simulation_files
from labcdp.evaluate.sweep.simulation.result import answer, predicted_result, result

from ...conftest import valid
from ...output.test_results_folder import write
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


def test_saturated_regions_have_bounds():
    run = small(exposure__exposure_s=0.1, scene__luminance_cd_m2=10.0, scene__contrast=5.0).run()
    shares = {one.region: one.saturated_share for one in evaluate_stage(run, "sensor").regions}
    assert (shares["dark"], shares["bright"]) == (0.0, 1.0)
    contrast, light = result(evaluate_run(run)).tables
    bounds = [(row["stage"], row["measured_contrast_bound"] or "") for row in contrast.rows()]
    assert [bound for stage, bound in bounds if stage == "sensor"] == [">"]
    assert {bound for stage, bound in bounds if stage in ("scene", "optics")} == {""}
    rows = {row["region"]: row for row in light.rows() if row["stage"] == "sensor"}
    assert [rows[name]["luminance_cd_m2_bound"] or "" for name in ("dark", "bright")] == ["", ">"]


def test_mean_contrast_is_that_of_all_pairs():
    done = small().run()
    luminance, masks = done["sensor"].luminance_cd_m2.astype(float), done.chain.scene.regions()
    pairs = luminance[masks["bright"]][:, None] / luminance[masks["dark"]] - 1
    pair = evaluate_stage(done, "sensor").pairs[0]
    assert pair.mean_contrast == pytest.approx(pairs.mean(), rel=1e-9)
    assert pair.mean_contrast > pair.measured_contrast  # as 1 / x bends upwards


def test_no_light_has_no_contrast():
    run = replace(small(), scene=StepChart(64, 48, (0.0, 10.0))).run()
    pair = evaluate_run(run).stages[0].pairs[0]
    assert pair.true_contrast == inf
    assert pair.cdp is None
    # Unless one is asked for: each bright pixel then has an unbounded contrast to a dark one.
    assert [pair.cdp.above for pair in evaluate_run(run, (0.5, 1.0)).stages[0].pairs] == [1.0, 1.0]


def test_the_files_hold_what_was_evaluated(tmp_path):
    evaluation = evaluate_run(small(scene__square_px=1).run(1))
    write(tmp_path, simulation_files(result(evaluation), evaluation))
    values = valid((tmp_path / "results.json").read_text())
    (pair,), row = evaluation.stages[3].pairs, values["tables"]["detection"]["rows"][3]
    assert (row["stage"], row["cdp"], row["u_cdp"]) == ("sensor", pair.cdp.cdp, pair.cdp.u)
    assert (row["cdp_low"], row["cdp_high"]) == pair.cdp.interval
    assert (row["lowest_contrast"], row["highest_contrast"]) == pair.cdp.detected_range
    assert (row["cdp_neighbours"], row["csnr"]) == (pair.neighbours.cdp, pair.csnr.value)
    assert row["expanded_csnr"] == pytest.approx(1.959964 * pair.csnr.u)
    dark, row = evaluation.stages[3].regions[0], values["tables"]["signal"]["rows"][6]
    assert (row["region"], row["unit"], row["mean"], row["snr"]) == ("dark", "DN", dark.mean, dark.snr.value)
    assert (values["seed"], values["simulated"]) == (1, True)
    assert "<b>" not in (tmp_path / "report.html").read_text()


def test_what_a_merge_brings_back_is_not_called_lost():
    columns = (Column("stage", "stage"), Column("cdp", "CDP"), Column("contrast", "contrast"))
    cdps = {"scene": 1.0, "optics": 1.0, "sensor 32 ms": 0.0, "sensor 8 ms": 0.4, "hdr": 0.75, "isp": 0.7}
    rows = [{"stage": stage, "cdp": cdp, "contrast": 0.5} for stage, cdp in cdps.items()]
    bracket = small({"hdr": {"method": "weighted"}, "isp": {}}, exposure__exposure_s=[0.032, 0.008])
    said = answer(Table.of_items("detection", "", columns, rows), ["isp"], bracket)
    assert said.endswith("sensor, by 0.250 to 0.750.")


def test_saturation_matters_behind_the_last_stage_and_why_there_is_no_cdp():
    bracket = small({"hdr": {"method": "weighted"}}, exposure__exposure_s=[5.0, 0.001])
    for chain, code, severity in (
        (small(exposure__exposure_s=5.0, scene__contrast=1.0), "stage-saturated", "warning"),
        (bracket, "stage-saturated", "info"),
        (replace(small(), scene=Flat(64, 48, 50.0)), "scene-without-contrast", "info"),
        # Half of each pixel is bright.
        (small(scene__square_px=0.5, scene__oversampling=2), "scene-without-contrast", "info"),
    ):
        first = result(evaluate_run(chain.run(0))).findings[0]
        assert (first.code, first.severity) == (code, severity)
    predicted = predicted_result(small(scene__luminance_cd_m2=1e6, sensor__full_well_e=1e6))
    assert [(one.code, one.severity) for one in predicted.findings] == [("stage-saturated", "warning")]
    (row,) = predicted.table("detection").rows()
    assert (row["cdp"], row["snr_dark"], row["snr_bright"]) == (0.0, inf, inf)
    several, *alone = (predicted_result(small(), one).table("detection") for one in ((0.3, 0.6), 0.3, 0.6))
    assert [*zip(several["contrast"], several["cdp"], strict=True)] == [
        (contrast, pytest.approx(one["cdp"][0], rel=1e-9)) for contrast, one in zip((0.3, 0.6), alone, strict=True)
    ]
