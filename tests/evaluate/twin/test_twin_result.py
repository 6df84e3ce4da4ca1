import json
from dataclasses import replace
from io import BytesIO

import pytest
from jsonschema import validate
from openpyxl import load_workbook

from labcdp.chain import Chain
from labcdp.evaluate.twin.report.page import write_twin
from labcdp.evaluate.twin.report.result import twin_result
from labcdp.evaluate.twin.report.verdict import verdict
from labcdp.report.envelope import schema


@pytest.fixture(scope="module")
def written(twin, tmp_path_factory):
    return files_of(twin, tmp_path_factory.mktemp("twin"))


def files_of(twin, folder):
    return {path.name: path.read_bytes() for path in write_twin(twin, twin_result(twin), folder)}


def with_difference(twin, name, number=30):
    """The twin with its first pairs measured as if nothing were detected, and a bright patch of another name."""
    pairs = [
        replace(pair, asked=replace(pair.asked, bright=name), measured=replace(pair.measured, cdp=0.0))
        if i < number
        else pair
        for i, pair in enumerate(twin.pairs)
    ]
    return replace(twin, pairs=tuple(pairs))


def vacuous(pair):
    return replace(pair, u_predicted=2.4)


def test_the_files_hold_the_same_numbers(twin, written):
    assert set(written) == {"chain.toml", "report.html", "results.xlsx", "results.json", "twin.png"}
    values = json.loads(written["results.json"])
    validate(values, schema())
    rows = {name: table["rows"] for name, table in values["tables"].items()}
    assert rows["summary"][0]["pairs"] == len(rows["pairs"]) == len(twin.pairs)
    assert rows["summary"][0]["agreeing"] == twin.count("agree")
    assert rows["pairs"][3]["predicted_cdp"] == twin.pairs[3].predicted
    k = next(row for row in rows["parameters"] if row["key"] == "k_dn_per_e")
    assert k["value"] == twin.parameters.quantities["k_dn_per_e"].value
    book = load_workbook(BytesIO(written["results.xlsx"]))
    column = next(cells for cells in book["pairs"].columns if cells[0].value == "measured CDP")
    assert [cell.value for cell in column[1:]] == pytest.approx([pair.measured.cdp for pair in twin.pairs], rel=1e-14)


def test_the_chain_file_can_be_run_and_states_uncertainties(written):
    text = written["chain.toml"].decode()
    chain = Chain.from_toml(text, "chain.toml")
    assert len(chain.scene.patches) == 16
    line = next(line for line in text.splitlines() if line.startswith("k_dn_per_e"))
    assert "# +- 0.00" in line
    assert "DN/e-" in line


def test_the_page_answers_first(written):
    page = written["report.html"].decode()
    places = [page.index(text) for text in ("Simulated data", "Pairs that agree", "<figure>", "<table>", "<details>")]
    assert places == sorted(places)
    assert "<script" not in page


def test_the_example_ends_without_warnings(twin):
    found = twin_result(twin).findings
    assert [one.code for one in found if one.severity != "info"] == []
    assert "twin-describes-camera" in [one.code for one in found]


def test_one_verdict_follows_from_pairs_and_signals(twin, tmp_path):
    hostile = '"><img src=x onerror=alert(1)>'
    wrong = with_difference(twin, hostile)
    assert verdict(wrong).code == "twin-differs"
    page = files_of(wrong, tmp_path)["report.html"].decode()
    assert "<img src=x" not in page
    assert "&lt;img src=x" in page
    agreeing = replace(twin, pairs=tuple(pair for pair in twin.pairs if pair.judgement == "agree"))
    one_differs = with_difference(agreeing, "P12", 1)
    assert one_differs.count("differ") == 1
    patch = replace(twin.patches[0], measured=twin.patches[0].measured | {"mean_dn": (1.0, 0.1)})
    for few in (agreeing, one_differs):
        assert verdict(few).code == "twin-describes-camera"
        odd = replace(few, patches=(patch, *twin.patches[1:]))
        assert verdict(odd).code == "twin-signals-differ"
        (found,) = (one for one in twin_result(odd).findings if one.code == "signal-differs")
        assert (found.subject, found.values["worst"]) == ("mean", patch.name)
    assert verdict(replace(twin, pairs=tuple(map(vacuous, twin.pairs)))).code == "twin-undecided"


def test_undecided_pairs_are_counted_apart(twin):
    agreeing = replace(twin, pairs=tuple(pair for pair in twin.pairs if pair.judgement == "agree")[:10])
    some = twin_result(replace(agreeing, pairs=(*map(vacuous, agreeing.pairs[:4]), *agreeing.pairs[4:])))
    assert some.table("pairs")["judgement"] == ["undecided"] * 4 + ["agree"] * 6
    assert some.table("summary")["undecided"] == [4]
