"""A simulated image: the same numbers in result, JSON and sheet; findings; page and pictures."""

import json
from io import BytesIO

import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.chain import Chain
from labcdp.core.table import Column, Table
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_run
from labcdp.evaluate.sweep.simulation.figures import picture
from labcdp.evaluate.sweep.simulation.page import write_simulation
from labcdp.evaluate.sweep.simulation.result import answer, result
from labcdp.report.files import schema


def codes(toml: str, contrast: float | None = None) -> list[tuple[str, str, str]]:
    found = result(evaluate_run(Chain.from_toml(toml, "test").run(0), contrast)).findings
    return [(one.code, one.severity, one.subject) for one in found]


CHAIN = """
name = "board <b>&"
description = "squares of one pixel"
[scene]
type = "checkerboard"
width = 40
height = 30
luminance_cd_m2 = 50.0
contrast = 1.0
[windscreen]
transmittance = 0.9
glare_fraction = 1.0
glare_subtracted = true
[optics]
f_number = 2.0
transmittance = 0.9
[exposure]
exposure_s = 0.005
[sensor]
pixel_pitch_m = 4e-6
quantum_efficiency = 0.6
full_well_e = 10000
k_dn_per_e = 0.3
read_noise_e = 4.0
dark_current_e_s = 5.0
bits = 12
black_level_dn = 32.0
"""


@pytest.fixture(scope="module")
def run():
    return Chain.from_toml(CHAIN, "board").run(1)


@pytest.fixture(scope="module")
def evaluation(run):
    return evaluate_run(run)


@pytest.fixture(scope="module")
def folder(run, evaluation, tmp_path_factory):
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
    bright = CHAIN.replace("exposure_s = 0.005", "exposure_s = 5.0")
    assert codes(bright) == [
        ("stage-saturated", "warning", "sensor"),
        ("pair-without-light", "warning", "bright / dark"),
    ]
    bracket = CHAIN.replace("exposure_s = 0.005", "exposure_s = [5.0, 0.001]") + '[hdr]\nmethod = "weighted"\n'
    assert codes(bracket) == [("stage-saturated", "info", "sensor 5000 ms")]


def test_why_there_is_no_cdp():
    flat = CHAIN.replace('"checkerboard"', '"flat"').replace("contrast = 1.0\n", "")
    assert codes(flat.replace("0.005", "0.001")) == [("scene-without-contrast", "info", "")]
    black = (
        CHAIN[: CHAIN.index("[scene]")]
        + """
[scene]
type = "step-chart"
width = 40
height = 30
luminances_cd_m2 = [0.0, 10.0]
"""
    )
    assert [code for code, *_ in codes(black)] == ["contrast-to-detect-infinite"]
    assert codes(black, contrast=1.0) == []


def test_picture_of_a_saturated_stage_is_white():
    import cv2

    for value, grey in ((4095, 255), (0, 0)):
        drawn = cv2.imdecode(np.frombuffer(picture(np.full((4, 4), value)), np.uint8), cv2.IMREAD_GRAYSCALE)
        assert np.all(drawn == grey)
