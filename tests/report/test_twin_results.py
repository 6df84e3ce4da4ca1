import json
from dataclasses import replace
from io import BytesIO

import pytest
from openpyxl import load_workbook

from labcdp.calibration.emva.result import Quantity
from labcdp.chain import chain_from_toml
from labcdp.errors import InputError
from labcdp.evaluate import calibrate_session, characterise_session, observe_session
from labcdp.evaluate.twin import twin_session
from labcdp.evaluate.twin_diagnosis import Finding
from labcdp.evaluate.twin_pair import Mended
from labcdp.evaluate.twin_prediction import Mending
from labcdp.report.twin_results import write_twin
from labcdp.report.twin_tables import (
    difference_table,
    finding_table,
    influence_table,
    mean_table,
    noise_table,
    pair_table,
    parameter_table,
)
from labcdp.report.twin_wording import simulated, twin_results
from labcdp.session import Session, example_session


@pytest.fixture(scope="module")
def twin():
    with Session.open(example_session()) as session:
        observed = observe_session(session)
        return twin_session(session, observed, calibrate_session(observed), characterise_session(session))


@pytest.fixture(scope="module")
def written(twin, tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin")
    return {path.name: path.read_bytes() for path in write_twin(twin, folder)}


def with_difference(twin, name, number=30):
    """The twin with its first pairs measured as if nothing were detected, and a bright patch of another name."""
    pairs = [
        replace(pair, asked=replace(pair.asked, bright=name), measured=replace(pair.measured, cdp=0.0))
        if i < number
        else pair
        for i, pair in enumerate(twin.pairs)
    ]
    return replace(twin, pairs=tuple(pairs))


def test_the_files_hold_the_same_numbers(twin, written):
    assert set(written) == {"chain.toml", "report.html", "results.xlsx", "results.json", "twin.png"}
    values = json.loads(written["results.json"])
    assert values["pairs_compared"] == len(twin.pairs)
    assert values["pairs_agreeing"] == twin.agreeing
    assert values["pairs"][3]["predicted"] == twin.pairs[3].predicted
    assert values["parameters"]["k_dn_per_e"]["value"] == twin.parameters.quantities["k_dn_per_e"].value
    assert written["twin.png"].startswith(b"\x89PNG")


def test_the_chain_file_can_be_run_and_tells_uncertainties(written):
    text = written["chain.toml"].decode()
    chain = chain_from_toml(text, "chain.toml")
    assert len(chain.scene.patches) == 16
    assert "k_dn_per_e = " in text
    line = next(line for line in text.splitlines() if line.startswith("k_dn_per_e"))
    assert "# +- 0.00" in line
    assert "DN/e-" in line


def test_the_page_says_the_result_first_and_that_it_is_simulated(twin, written):
    page = written["report.html"].decode()
    result = twin_results(twin)[0]
    assert f"{twin.agreeing} agree with the measurement" in result
    assert page.index("Simulated: camera") < page.index("agree with the measurement") < page.index("<table>")
    assert "<script" not in page


def test_the_spreadsheet_has_every_pair_and_influence(twin, written):
    book = load_workbook(BytesIO(written["results.xlsx"]))
    assert book.sheetnames == ["Summary", "Pairs", "Influences", "Patches", "Parameters", "Provenance"]
    assert book["Pairs"].max_row == 1 + len(twin.pairs)
    assert book["Influences"].max_row == 1 + sum(len(pair.influences) for pair in twin.pairs)
    column = [cell.value for cell in book["Pairs"]["G"][1:]]
    assert column == pytest.approx([pair.measured.cdp for pair in twin.pairs], rel=1e-14)


def test_pairs_that_differ_are_told_and_hostile_names_stay_text(twin, tmp_path):
    hostile = '"><img src=x onerror=alert(1)>'
    wrong = with_difference(twin, hostile)
    assert len(difference_table(wrong).rows) == len(wrong.pairs) - wrong.agreeing >= 25
    assert "does not describe this camera in full" in " ".join(twin_results(wrong))
    page = next(path for path in write_twin(wrong, tmp_path) if path.suffix == ".html").read_text(encoding="utf-8")
    assert "Pairs that differ" in page
    assert "<img src=x" not in page
    assert "&lt;img src=x" in page


def test_what_the_signals_contradict_is_told_before_the_pairs(twin, tmp_path):
    """On the page, in the sentences at its top, and in the verdict of a pair that it explains."""
    finding = Finding("read noise", 20.0, 10.0, "e-", -50.0, Mending())
    pair = with_difference(twin, "P12", 1).pairs[0]
    pair = replace(pair, mended=Mended("read noise", "10 e- instead of 20", 0.0, 0.0))
    wrong = replace(twin, findings=(finding,), pairs=(pair, *twin.pairs[1:]))
    assert finding_table(wrong).rows == (("read noise", "20.00", "10.00", "e-", "50.0"),)
    assert difference_table(wrong).rows[0][2] == "read noise"
    assert "the read noise is off: 20.00 e- in the twin, 10.00 e- by the camera" in " ".join(twin_results(wrong))
    assert pair.verdict == (
        "differ; the read noise explains it: with 10 e- instead of 20, as the signals of the patches ask, the twin "
        "predicts 0.0000"
    )
    page = next(path for path in write_twin(wrong, tmp_path) if path.suffix == ".html").read_text(encoding="utf-8")
    assert (
        page.index("What the patches&#39; signals contradict")
        < page.index("Pairs that differ")
        < page.index("All pairs")
    )


def vacuous(pair):
    return replace(pair, predicted_standard_uncertainty=2.4)


def of_the_signals(name, patch=None):
    return Finding(name, 20.0, 10.0, "e-", -3.9, Mending(patch=patch))


def test_a_finding_and_pairs_that_all_agree_make_one_verdict(twin, tmp_path):
    """No sentence may say that the twin describes the camera while another says that a parameter is off."""
    agreeing = replace(twin, pairs=tuple(pair for pair in twin.pairs if pair.agrees))
    text = " ".join(twin_results(agreeing))
    assert "The twin describes this camera within what its parameters" in text
    wrong = replace(agreeing, findings=(of_the_signals("responsivity"),))
    text = " ".join(twin_results(wrong))
    assert (
        "No pair differs, but the signals of the patches contradict the twin: the twin does not describe this camera "
        "in full. By the signals of the patches, the responsivity is off" in text
    )
    assert "win describes this camera" not in text
    page = next(path for path in write_twin(wrong, tmp_path) if path.suffix == ".html").read_text(encoding="utf-8")
    assert "win describes this camera" not in page


def test_as_many_differing_pairs_as_chance_leaves_do_not_excuse_a_finding(twin):
    some = with_difference(replace(twin, pairs=tuple(pair for pair in twin.pairs if pair.agrees)), "P12", 1)
    assert some.differing == 1
    assert "That is what chance leaves" in twin_results(some)[1]
    assert "the twin describes this camera." in twin_results(some)[1]
    text = " ".join(twin_results(replace(some, findings=(of_the_signals("DSNU"),))))
    assert "No more pairs differ than by chance, but the signals of the patches contradict the twin" in text
    assert "describes this camera" not in text


def test_a_wrong_reading_is_no_fault_of_the_twin(twin):
    agreeing = replace(twin, pairs=tuple(pair for pair in twin.pairs if pair.agrees))
    text = " ".join(twin_results(replace(agreeing, findings=(of_the_signals("meter reading of P05", "P05"),))))
    assert "contradict what the meter read: the twin can be judged when these readings were taken again" in text
    assert "describe" not in text


def test_undecided_pairs_are_counted_apart(twin, tmp_path):
    """In the sentences, the tables and the figure; none of them says that they agree."""
    agreeing = replace(twin, pairs=tuple(pair for pair in twin.pairs if pair.agrees)[:10])
    some = replace(agreeing, pairs=(*map(vacuous, agreeing.pairs[:4]), *agreeing.pairs[4:]))
    first, second, third, _ = twin_results(some)
    assert first.endswith("; 6 agree with the measurement within the joint 95 % interval, 4 are undecided.")
    assert second.startswith("Of an undecided pair nearly any CDP would agree")
    assert third.endswith("leave open, as far as the 6 decided pairs tell.")
    assert [row[1] for row in pair_table(some).rows] == ["undecided"] * 4 + ["agree"] * 6
    assert difference_table(some).rows == ()
    files = {path.name: path for path in write_twin(some, tmp_path)}
    assert json.loads(files["results.json"].read_text())["pairs_undecided"] == 4
    assert [cell.value for cell in load_workbook(files["results.xlsx"])["Pairs"]["O"][1:5]] == ["undecided"] * 4


def test_nothing_is_claimed_of_a_camera_of_which_no_pair_is_decided(twin):
    none = replace(twin, pairs=tuple(map(vacuous, twin.pairs)))
    text = " ".join(twin_results(none))
    assert "0 agree with the measurement" in text
    assert "No pair tells whether the twin describes this camera" in text
    assert "win describes" not in text.replace("whether the twin describes", "")


def test_what_a_dark_library_leaves_has_a_row_of_its_own(twin):
    left = {"DSNU left by the dark library": Quantity(1.29, 0.0, "e-", "noise of the dark library")}
    rows = parameter_table(replace(twin, left=left)).rows
    assert rows[:-1] == parameter_table(twin).rows
    assert rows[-1] == ("DSNU left by the dark library", "1.290", "e-", "noise of the dark library")


def test_the_tables_have_one_row_each(twin):
    assert len(pair_table(twin).rows) == len(twin.pairs)
    assert len(mean_table(twin).rows) == len(noise_table(twin).rows) == 16
    assert {len(row) for row in noise_table(twin).rows} == {9}
    table = influence_table(twin)
    assert table.rows[0][0] == "number of pixels"
    assert sum(float(row[1]) for row in table.rows) == pytest.approx(100, abs=2)
    assert sum(int(row[2]) for row in table.rows) == len(twin.pairs)


def test_a_real_bench_has_no_banner(twin):
    state = twin.calibration.state
    real = replace(state, camera=replace(state.camera, simulated=False))
    assert simulated(replace(twin, calibration=replace(twin.calibration, state=real))) == ""


def test_a_folder_that_cannot_be_made_is_named(twin, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file cannot be written \(.*\): give a folder you can write to"):
        write_twin(twin, tmp_path / "file")
