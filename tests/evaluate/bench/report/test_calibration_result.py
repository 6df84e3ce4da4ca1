"""The result of a calibration: budget, checks and patches are those of the calibration, on page and sheets."""

from dataclasses import replace
from io import BytesIO

import pytest
from jsonschema import Draft202012Validator
from openpyxl import load_workbook

from labcdp.calibration.colour.budget import colour_budget
from labcdp.calibration.colour.model import ColourCalibration, CombinationStep
from labcdp.calibration.errors.budget import budget, combined
from labcdp.calibration.findings import FitTest, LeftOut, ModelStep
from labcdp.core.finding import Finding, info, warning
from labcdp.core.response import Response
from labcdp.evaluate.bench.calibration.budget import PATCH_PIXELS
from labcdp.evaluate.bench.calibration.page import calibration_page
from labcdp.evaluate.bench.calibration.result import calibration_result
from labcdp.report.envelope import envelope, schema
from labcdp.report.html import render_page
from labcdp.report.sheets import result_workbook

BETTER = info("model-better", chi_squared=1.0, chi_squared_before=9.0, other="linear")


@pytest.fixture(scope="module")
def calibration(evaluation):
    """The evaluation's calibration, with all kinds of findings."""
    fitted = evaluation.calibration
    first, *rest = fitted.residuals
    found = warning("intercept", intercept_cd_m2=0.012, expanded_cd_m2=0.004, intercept_dn_s=50.0, z=6.0)
    return replace(
        fitted,
        residuals=tuple(rest),
        held_out=(first,),
        left_out=(
            LeftOut("<b>bold</b>", 0.02, None, "saturated"),
            LeftOut("=1+1", None, 2, "contradicts the other readings"),
        ),
        ladder=(
            ModelStep("linear", 1, 0.012, False, info("model-simplest")),
            ModelStep("quadratic", 2, 0.004, True, BETTER),
        ),
        tests=(
            FitTest("glare", 0.012, 0.002, "cd/m²", True, found),
            FitTest("drift", 0.0, 0.0, "1/h", False, info("not-testable-time", "drift")),
        ),
        findings=(found,),
        response=Response("quadratic", (0.0, 4000.0), (0.0, 4200.0)),
    )


@pytest.fixture(scope="module")
def colour(calibration):
    planes = tuple(replace(calibration, state=replace(calibration.state, plane=p)) for p in ("R", "Gr", "Gb", "B"))
    return ColourCalibration(
        planes=planes,
        weights=(0.2, 0.3, 0.3, 0.2),
        weight_covariance=((1e-4, 0.0, 0.0, 0.0), (0.0, 1e-4, 0.0, 0.0), (0.0, 0.0, 1e-4, 0.0), (0.0, 0.0, 0.0, 1e-4)),
        spectral_rel=0.01,
        scatter_rel=0.0,
        range_cd_m2=calibration.range_cd_m2,
        residuals=calibration.residuals,
        held_out=calibration.held_out,
        left_out=calibration.left_out,
        ladder=(
            CombinationStep("combination", 0.004, True, info("combination-best")),
            CombinationStep("green", 0.02, False, info("not-chosen", chosen="combination")),
        ),
        sensitivity=None,
        f1_prime=0.12,
        findings=(Finding("patches-of-one-colour"),),
    )


def rows(result, table, key):
    return {row[key]: row for row in result.table(table).rows()}


@pytest.mark.parametrize("kind", ["calibration", "colour"])
def test_json_page_and_workbook_of_any_calibration(kind, request):
    calibration = request.getfixturevalue(kind)
    result = calibration_result(calibration, "Title <i>here</i>")
    Draft202012Validator(schema()).validate(envelope(result))
    page = render_page(calibration_page(calibration, result))
    assert "Title &lt;i&gt;here&lt;/i&gt;" in page
    assert "<b>bold" not in page
    assert page.index("Simulated data") < page.index("Calibrated range") < page.index("Uncertainty budget")
    book = load_workbook(BytesIO(result_workbook(result, calibration.provenance.measured)))
    assert book.sheetnames[:-1] == [*(table.name for table in result.tables), "findings"]


def test_patches_hold_the_fit_and_those_held_out(calibration):
    table = calibration_result(calibration).table("calibration_patches")
    found = {row["patch"]: row for row in table.rows()}
    for use, patches in (("fit", calibration.residuals), ("held out", calibration.held_out)):
        for patch in patches:
            row = found[patch.patch]
            assert row["used_for"] == use
            assert row["meter_cd_m2"] == patch.reading_cd_m2
            assert row["u_meter_cd_m2"] == patch.reading_random_cd_m2
            assert row["deviation_rel"] == patch.residual_rel
    assert len(found) == 6


@pytest.mark.parametrize("kind", ["calibration", "colour"])
def test_the_budget_is_that_of_the_calibration(kind, request):
    calibration = request.getfixturevalue(kind)
    result = calibration_result(calibration)
    sources = rows(result, "budget", "source")
    totals = list(result.table("uncertainty").rows())
    low, high = calibration.range_cd_m2
    for place, luminance, total in zip(
        ("lowest", "middle", "highest"), (low, (low * high) ** 0.5, high), totals, strict=True
    ):
        if kind == "calibration":
            at = budget(calibration, luminance, n_pixels=PATCH_PIXELS)
        else:
            at = colour_budget(calibration, luminance, n_groups=PATCH_PIXELS // 4)
        whole = combined(at)
        assert total["u_rel"] == pytest.approx(whole.standard_uncertainty_rel)
        assert total["expanded_rel"] == pytest.approx(whole.expanded_95_rel)
        for row in at:
            if row.included:
                assert sources[row.source][f"u_{place}_rel"] == pytest.approx(row.standard_uncertainty_rel)
    assert sources["meter scale"]["included"] == "yes"
    assert sources["meter digits"]["included"] == "in meter repeatability"
    assert sources["meter f1'"]["u_lowest_rel"] is None
    assert sources["shot and read noise"]["common"] is False


def test_quantities_state_the_responsivity_with_the_meter_scale(calibration):
    row = rows(calibration_result(calibration), "calibration", "quantity")["responsivity R"]
    assert row["value"] == calibration.responsivity.responsivity_dn_s_cd_m2
    assert row["u_value"] == pytest.approx(row["value"] * calibration.responsivity_common_rel)
    # 95 % of a rectangular error lie within fewer standard uncertainties than of a normal one.
    assert 1.6 < row["expanded_value"] / row["u_value"] < 1.96


def test_colour_planes_and_their_weights(colour):
    result = calibration_result(colour)
    planes = rows(result, "planes", "plane")
    assert {name: row["weight"] for name, row in planes.items()} == {"R": 0.2, "Gr": 0.3, "Gb": 0.3, "B": 0.2}
    assert planes["R"]["u_weight"] == pytest.approx(0.01)
    assert rows(result, "combinations", "luminance_from")["combination"]["chosen"] is True
    assert rows(result, "calibration", "quantity")["f1' of the combination"]["value"] == 0.12
    assert {row["plane"] for row in result.table("checks").rows()} == {"R", "Gr", "Gb", "B"}
