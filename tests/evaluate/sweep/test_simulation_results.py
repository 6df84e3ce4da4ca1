"""A simulated image: the same numbers in result, JSON and sheet; findings; page and pictures."""

import json
from dataclasses import replace
from io import BytesIO

import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.chain import Chain, Flat, StepChart
from labcdp.core.table import Column, Table
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_run
from labcdp.evaluate.sweep.simulation.figures import picture
from labcdp.evaluate.sweep.simulation.page import write_simulation
from labcdp.evaluate.sweep.simulation.result import answer, result
from labcdp.report.files import schema

from .chains import small


def codes(chain: Chain, contrast: float | None = None) -> list[tuple[str, str, str]]:
    found = result(evaluate_run(chain.run(0), contrast)).findings
    return [(one.code, one.severity, one.subject) for one in found]


@pytest.fixture(scope="module")
def evaluation():
    return evaluate_run(small(scene__square_px=1).run(1))


@pytest.fixture(scope="module")
def folder(evaluation, tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulation")
    write_simulation(result(evaluation), evaluation, folder)
    return folder


def test_tables_hold_what_was_evaluated(evaluation):
    found = result(evaluation)
    (pair,), row = evaluation.stages[3].pairs, list(found.table("detection").rows())[3]
    assert (row["stage"], row["cdp"], row["u_cdp"]) == ("sensor", pair.cdp.cdp, pair.cdp.standard_error)
    assert (row["cdp_low"], row["cdp_high"]) == pair.cdp.confidence_interval
    assert (row["lowest_contrast"], row["highest_contrast"]) == pair.cdp.interval
    assert row["cdp_neighbours"] == pair.neighbours.cdp
    assert (row["csnr"], row["u_csnr"]) == (pair.csnr.value, pair.csnr.standard_error)
    assert row["expanded_csnr"] == pytest.approx(1.959964 * pair.csnr.standard_error)
    dark, row = evaluation.stages[3].regions[0], list(found.table("signal").rows())[6]
    assert (row["region"], row["unit"], row["mean"], row["snr"]) == ("dark", "DN", dark.mean, dark.snr.value)
    assert row["luminance_cd_m2"] == dark.luminance_cd_m2


def test_json_and_sheet_hold_the_same_numbers(evaluation, folder):
    values = json.loads((folder / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    book = openpyxl.load_workbook(BytesIO((folder / "results.xlsx").read_bytes()))
    for name, table in values["tables"].items():
        keys = [column["name"] for column in table["columns"]]
        for row, cells in zip(table["rows"], book[name].iter_rows(min_row=2, values_only=True), strict=True):
            for key, cell in zip(keys, cells, strict=True):
                assert cell == (pytest.approx(row[key], rel=1e-14) if isinstance(row[key], float) else row[key])
    assert (values["seed"], values["simulated"], values["configuration"]["epsilon"]) == (1, True, 0.5)
    assert values["configuration"]["chain"]["sensor"]["bits"] == 12


def test_page_answers_first_and_escapes_text(evaluation, folder):
    page = (folder / "report.html").read_text()
    assert "board &lt;b&gt;&amp;" in page
    assert page.index(f"{evaluation.stages[-1].pairs[0].neighbours.cdp:.2f}") < page.index("<figure>")
    names = {path.name for path in (folder / "figures").iterdir()}
    stages = ("scene", "windscreen", "optics", "sensor")
    assert names == {"chain-1.png", "contrasts-1.png", *(f"stage-{stage}.png" for stage in stages)}


def test_what_a_merge_brings_back_is_not_called_lost():
    columns = (Column("stage", "stage"), Column("cdp", "CDP"), Column("contrast", "contrast"))
    cdps = {"scene": 1.0, "optics": 1.0, "sensor 32 ms": 0.0, "sensor 8 ms": 0.4, "hdr": 0.75, "isp": 0.7}
    rows = [{"stage": stage, "cdp": cdp, "contrast": 0.5} for stage, cdp in cdps.items()]
    assert answer(Table.of_rows("detection", "", columns, rows), ["isp"]) == (
        "A contrast of 50 % between bright and dark is detected behind isp with a probability of 0.700. The stage that "
        "costs most is sensor: it lowers the CDP by 0.250, to 0.750."
    )


def test_saturation_matters_behind_the_last_stage():
    saturated = [("stage-saturated", "warning", "sensor"), ("pair-without-light", "warning", "bright / dark")]
    assert codes(small(exposure__exposure_s=5.0, scene__contrast=1.0))[:1] == saturated[:1]
    bracket = small('[hdr]\nmethod = "weighted"\n', exposure__exposure_s=[5.0, 0.001])
    assert codes(bracket) == [("stage-saturated", "info", "sensor 5000 ms")]


def test_why_there_is_no_cdp():
    assert codes(replace(small(), scene=Flat(64, 48, 50.0))) == [("scene-without-contrast", "info", "")]
    black = replace(small(), scene=StepChart(64, 48, (0.0, 10.0)))
    assert [code for code, *_ in codes(black)] == ["contrast-to-detect-infinite"]
    assert codes(black, contrast=1.0) == []


def test_picture_of_a_saturated_stage_is_white():
    import cv2

    for value, grey in ((4095, 255), (0, 0)):
        drawn = cv2.imdecode(np.frombuffer(picture(np.full((4, 4), value)), np.uint8), cv2.IMREAD_GRAYSCALE)
        assert np.all(drawn == grey)
