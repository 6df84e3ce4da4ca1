import json
import re
from io import BytesIO

import cv2
import numpy as np
import openpyxl
import pytest

from labcdp.chain import chain_from_toml
from labcdp.contrast import Estimate
from labcdp.errors import InputError
from labcdp.evaluate import evaluate_run
from labcdp.report import detection_table, signal_table, write_simulation
from labcdp.report.simulation_tables import decibels, ratio

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
    return chain_from_toml(CHAIN, "board").run(1)


@pytest.fixture(scope="module")
def evaluation(run):
    return evaluate_run(run)


@pytest.fixture(scope="module")
def folder(run, evaluation, tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulation")
    write_simulation(evaluation, run, folder)
    return folder


def test_tables_have_a_row_for_each_region_and_pair(evaluation):
    signal, detection = signal_table(evaluation), detection_table(evaluation)
    assert [row[0] for row in signal.rows] == [
        f"{stage}: {region}" for stage in ("scene", "windscreen", "optics", "sensor") for region in ("dark", "bright")
    ]
    assert [row[0] for row in detection.rows] == ["scene", "windscreen", "optics", "sensor"]
    for table in (signal, detection):
        assert {len(row) for row in table.rows} == {len(table.columns)}
    assert "CDP pixel to pixel" in detection.columns


def test_page_shows_every_figure_and_loads_nothing(folder):
    page = (folder / "report.html").read_text()
    assert "board &lt;b&gt;&amp;" in page
    assert len(list((folder / "figures").iterdir())) == 6
    assert page.count("<figure>") == 6 + len(list((folder / "images").iterdir()))
    assert not re.search(r'(src|href)="(?!data:)', page)


def test_spreadsheet_holds_the_numbers_of_the_json(folder):
    values = json.loads((folder / "results.json").read_text())
    book = openpyxl.load_workbook(BytesIO((folder / "results.xlsx").read_bytes()))
    assert book.sheetnames == ["Detection", "Signal", "Chain", "Provenance"]
    heads = [cell.value for cell in book["Detection"][1]]
    row = {head: cell.value for head, cell in zip(heads, book["Detection"][5], strict=True)}
    pair = values["stages"][3]["pairs"][0]
    assert row["Stage"] == "sensor"
    assert row["CDP"] == pair["cdp"]["cdp"]
    assert row["Standard error"] == pair["cdp"]["standard_error"]
    assert row["CDP pixel to pixel"] == pair["cdp_neighbours"]["cdp"]
    assert row["d'"] == pair["d_prime"]["value"]
    assert row["Contrast of the scene in %"] == 100.0


def test_picture_of_a_small_frame_is_enlarged_without_mixing_pixels(run, folder):
    picture = cv2.imread(str(folder / "images" / "scene.png"), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (30 * 15, 40 * 15)
    bright = run["scene"].values == 100.0
    np.testing.assert_array_equal(picture[7::15, 7::15], np.where(bright, 255, 0))


def test_pictures_of_an_earlier_chain_go(run, evaluation, tmp_path):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "stage-isp.png").write_bytes(b"old")
    (tmp_path / "notes.txt").write_text("mine")
    write_simulation(evaluation, run, tmp_path)
    assert not (tmp_path / "figures" / "stage-isp.png").exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_folder_that_cannot_be_made(run, evaluation, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match=r"cannot be written .*: give a folder you can write to"):
        write_simulation(evaluation, run, tmp_path / "taken")


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(float("inf"), float("nan")), "∞"),
        (Estimate(float("nan"), float("nan")), "-"),
        (Estimate(5e7, 1e4), "> 1e6"),
        (Estimate(12.3456, 0.012), "12.35"),
        (Estimate(12.3456, 0.56), "12.35"),
        (Estimate(12.3456, 5.6), "12.3"),
        (Estimate(1234.56, 56.0), "1235"),
    ],
)
def test_ratio_has_the_digits_it_is_worth(estimate, text):
    assert ratio(estimate) == text


def test_decibels_have_two_decimals():
    assert decibels(Estimate(12.3456, 0.1)) == "12.35"
    assert decibels(Estimate(float("-inf"), float("nan"))) == "-∞"
