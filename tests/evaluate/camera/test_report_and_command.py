import json
import re

import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.calibration.emva import characterise_data_set
from labcdp.evaluate.camera.page import write_characterisation
from labcdp.evaluate.camera.result import result
from labcdp.report.envelope import schema
from labcdp.session import example_session


@pytest.fixture(scope="module")
def found(data_set):
    return characterise_data_set(data_set)


@pytest.fixture(scope="module")
def written(found, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    write_characterisation(found, result(found, "set"), folder)
    return folder


def test_all_plots_of_the_standard_are_written(written):
    names = {path.name for path in (written / "figures").iterdir()}
    assert names == {
        f"characterise-{name}.png"
        for name in (
            *("photon-transfer", "sensitivity", "linearity", "snr", "dark-current"),
            *("histogram", "accumulated", "spectrogram", "profile"),
        )
    }


def test_the_page_answers_first_and_claims_no_compliance(written, found):
    page = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert page.index(f"{found.k_dn_per_e.value:.2f}") < page.index("<figure>") < page.index("Signal and noise")
    assert "not a declaration of compliance" in page


def test_result_json_and_sheet_hold_the_same_quantities(written, found):
    values = json.loads((written / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    book = openpyxl.load_workbook(written / "results.xlsx")
    assert book.sheetnames == ["characterisation", "series", "dark_signal", "findings", "about"]
    rows = {row["key"]: row for row in values["tables"]["characterisation"]["rows"]}
    cells = {row[-1]: row for row in book["characterisation"].iter_rows(values_only=True)}
    for key, quantity in found.quantities().items():
        assert (key in rows) == (quantity is not None)
        if quantity is not None:
            assert rows[key]["value"] == quantity.value
            assert rows[key]["u_value"] == quantity.standard_uncertainty
            assert cells[key][1] == pytest.approx(quantity.value, rel=1e-14)
    assert (rows["prnu_rel"]["unit"], rows["k_dn_per_e"]["unit"]) == ("1", "DN/e⁻")
    assert rows["snr_max_db"]["value"] == pytest.approx(10 * np.log10(found.full_well_e.value))
    series = values["tables"]["series"]["rows"]
    assert [row["net_dn"] for row in series] == [point.net_dn for point in found.series]
    assert [row["u_net_dn"] for row in series] == [point.net_uncertainty_dn for point in found.series]
    assert [row["mean_dn"] for row in values["tables"]["dark_signal"]["rows"]] == [d.mean_dn for d in found.darks]


def test_the_command_takes_an_index(labcdp, data_set, tmp_path):
    done = labcdp("characterise", data_set, "-o", "out", "--json")
    assert done.returncode == 0, done.stderr
    assert done.stdout == (tmp_path / "out" / "results.json").read_text()
    values = json.loads(done.stdout)
    row = values["tables"]["characterisation"]["rows"][0]
    assert (row["key"], row["value"]) == ("k_dn_per_e", pytest.approx(0.25, rel=0.05))
    assert values["inputs"][0]["role"] == "index"


def test_the_command_takes_a_session(labcdp, tmp_path):
    done = labcdp("characterise", example_session(), "-o", "out")
    assert done.returncode == 0, done.stderr
    assert "responsivity R" in done.stdout
    # Nothing needs action.
    assert "warning" not in done.stderr
    assert "info: the converter limits the range" in done.stderr
    assert "Simulated data, not a measurement" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("nowhere", r"nowhere does not exist: give a session, or the index of a data set"),
        ("empty", r"empty contains neither a session nor EMVA1288_Data\.txt: give a session or a data set"),
        ("bad.txt", r"bad\.txt, line 1: 'hello' begins with none of the letters"),
    ],
)
def test_mistakes_are_one_line(labcdp, tmp_path, path, message):
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad.txt").write_text("hello\n")
    done = labcdp("characterise", path)
    assert done.returncode == 1
    assert re.fullmatch(rf"labcdp: {message}.*\n", done.stderr)
    assert not list(tmp_path.glob("*-characterisation"))
