import json
import re

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from labcdp.calibration.emva import characterise_data_set
from labcdp.report.files import schema
from labcdp.session import example_session


@pytest.fixture(scope="module")
def written(data_set, labcdp_in, tmp_path_factory):
    """Folder with what the command writes for the index of a data set."""
    folder = tmp_path_factory.mktemp("results")
    done = labcdp_in(folder, "characterise", data_set, "-o", "out", "--json")
    assert done.returncode == 0, done.stderr
    assert done.stdout == (folder / "out" / "results.json").read_text()
    return folder / "out"


def test_result_json_and_sheet_hold_the_same_quantities(written, data_set):
    found = characterise_data_set(data_set)
    values = json.loads((written / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    assert values["inputs"][0]["role"] == "index"
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    rows = {row["key"]: row for row in tables["characterisation"]}
    for key, quantity in found.quantities().items():
        assert (key in rows) == (quantity is not None)
        if quantity is not None:
            assert (rows[key]["value"], rows[key]["u_value"]) == (quantity.value, quantity.standard_uncertainty)
    assert rows["k_dn_per_e"]["value"] == pytest.approx(0.25, rel=0.05)
    assert (rows["prnu_rel"]["unit"], rows["k_dn_per_e"]["unit"]) == ("1", "DN/e⁻")
    assert rows["snr_max_db"]["value"] == pytest.approx(10 * np.log10(found.full_well_e.value))


def test_all_plots_of_the_standard_and_a_page_that_answers_first_and_claims_no_compliance(written):
    names = {path.name.removeprefix("characterise-").removesuffix(".png") for path in (written / "figures").iterdir()}
    plots = {"photon-transfer", "sensitivity", "linearity", "snr", "dark-current"}
    assert names == plots | {"histogram", "accumulated", "spectrogram", "profile"}
    page = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    k = next(iter(json.loads((written / "results.json").read_text())["tables"]["characterisation"]["rows"]))
    assert page.index(f"{k['value']:.2f}") < page.index("<figure>") < page.index("Signal and noise")
    assert "not a declaration of compliance" in page


def test_the_command_takes_a_session(labcdp, tmp_path):
    done = labcdp("characterise", example_session(), "-o", "out")
    assert done.returncode == 0, done.stderr
    assert "responsivity R" in done.stdout
    # Nothing needs action.
    assert "warning" not in done.stderr
    assert "info: the converter limits the range" in done.stderr
    assert "Simulated data, not a measurement" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for path, message in (("nowhere", "nowhere does not exist: give a session, or"), ("out", "out contains neither a")):
        done = labcdp("characterise", path)
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)
        assert message in done.stderr
