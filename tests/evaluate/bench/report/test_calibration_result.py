"""The result of a calibration: budget, checks and patches are those of the calibration, on page and sheets."""

from dataclasses import replace

import pytest
from jsonschema import Draft202012Validator

from labcdp.calibration.budget import budget, combined
from labcdp.calibration.colour.model import ColourCalibration, CombinationStep
from labcdp.calibration.findings import FitTest, LeftOut, ModelStep
from labcdp.core.dn import Response
from labcdp.core.result import Finding, info, warning
from labcdp.evaluate.bench.calibration_page import calibration_page
from labcdp.evaluate.bench.calibration_result import PATCH_PIXELS, calibration_result
from labcdp.report.files import envelope, schema
from labcdp.report.html import render_page


def with_findings(fitted):
    """The calibration with all kinds of findings."""
    first, *rest = fitted.residuals
    found = warning("intercept", intercept_cd_m2=0.012, expanded_cd_m2=0.004, intercept_dn_s=50.0, z=6.0)
    drift = FitTest("drift", 0.0, 0.0, "1/h", False, info("not-testable-time", "drift"))
    return replace(
        fitted,
        residuals=tuple(rest),
        held_out=(first,),
        left_out=(LeftOut("<b>bold</b>", 0.02, None, "saturated"), LeftOut("=1+1", None, 2, "contradicts the others")),
        ladder=(ModelStep("linear", 1, 0.012, True, info("model-simplest")),),
        tests=(FitTest("glare", 0.012, 0.002, "cd/m²", True, found), drift),
        findings=(found,),
        response=Response("quadratic", (0.0, 4000.0), (0.0, 4200.0)),
    )


def of_colours(one):
    return ColourCalibration(
        planes=tuple(replace(one, state=replace(one.state, plane=p)) for p in ("R", "Gr", "Gb", "B")),
        weights=(0.2, 0.3, 0.3, 0.2),
        weight_covariance=tuple(tuple(1e-4 * (i == j) for j in range(4)) for i in range(4)),
        spectral_rel=0.01,
        scatter_rel=0.0,
        sensitivity=None,
        f1_prime=0.12,
        ladder=(CombinationStep("combination", 0.004, True, info("combination-best")),),
        findings=(Finding("patches-of-one-colour"),),
        **{n: getattr(one, n) for n in ("range_cd_m2", "residuals", "held_out", "left_out")},
    )


@pytest.fixture(scope="module", params=["one plane", "colours"])
def calibration(request, evaluation):
    one = with_findings(evaluation.calibration)
    return one if request.param == "one plane" else of_colours(one)


@pytest.fixture(scope="module")
def result(calibration):
    return calibration_result(calibration, "Title <i>here</i>")


def rows(result, table, key):
    return {row[key]: row for row in result.table(table).rows()}


def test_json_page_and_workbook_of_any_calibration(calibration, result):
    Draft202012Validator(schema()).validate(envelope(result))
    page = render_page(calibration_page(calibration, result))
    assert "Title &lt;i&gt;here&lt;/i&gt;" in page
    assert "<b>bold" not in page
    assert page.index("Simulated data") < page.index("Calibrated range") < page.index("Uncertainty budget")


def test_the_budget_is_that_of_the_calibration(calibration, result):
    sources, totals = rows(result, "budget", "source"), list(result.table("uncertainty").rows())
    low, high = calibration.range_cd_m2
    places = zip(("lowest", "middle", "highest"), (low, (low * high) ** 0.5, high), totals, strict=True)
    for place, luminance, total in places:
        if isinstance(calibration, ColourCalibration):
            at = budget(calibration, luminance, n_pixels=PATCH_PIXELS // 4)
        else:
            at = budget(calibration, luminance, n_pixels=PATCH_PIXELS)
        whole = combined(at)
        assert total["u_rel"] == pytest.approx(whole.standard_uncertainty_rel)
        assert total["expanded_rel"] == pytest.approx(whole.expanded_95_rel)
        for row in at:
            if row.included:
                assert sources[row.source][f"u_{place}_rel"] == pytest.approx(row.standard_uncertainty_rel)
    assert sources["meter scale"]["included"] == "yes"
    assert sources["meter f1'"]["u_lowest_rel"] is None


def test_patches_quantities_and_planes_are_those_of_the_calibration(calibration, result):
    found = rows(result, "calibration_patches", "patch")
    assert len(found) == 6
    for use, patches in (("fit", calibration.residuals), ("held out", calibration.held_out)):
        for patch in patches:
            row = found[patch.patch]
            seen = use, patch.reading_cd_m2, patch.reading_random_cd_m2, patch.residual_rel
            assert tuple(row[key] for key in ("used_for", "meter_cd_m2", "u_meter_cd_m2", "deviation_rel")) == seen
    quantities = rows(result, "calibration", "quantity")
    if isinstance(calibration, ColourCalibration):
        weights = {name: row["weight"] for name, row in rows(result, "planes", "plane").items()}
        assert weights == {"R": 0.2, "Gr": 0.3, "Gb": 0.3, "B": 0.2}
        assert quantities["f1' of the combination"]["value"] == 0.12
    else:
        # 95 % of a rectangular error lie within fewer standard uncertainties than of a normal one.
        row = quantities["responsivity R"]
        assert 1.6 < row["expanded_value"] / row["u_value"] < 1.96
