from dataclasses import replace

from labcdp.chain import Chain
from labcdp.evaluate.twin.page import twin_chain_text, write_twin
from labcdp.evaluate.twin.result import twin_result, verdict


def test_the_result_and_the_chain_are_those_of_the_twin(twin):
    result = twin_result(twin)
    rows = {table.name: list(table.rows()) for table in result.tables}
    assert rows["summary"][0]["pairs"] == len(twin.pairs)
    assert [row["predicted_cdp"] for row in rows["pairs"]] == [pair.predicted for pair in twin.pairs]
    parameters = {row["key"]: row["value"] for row in rows["parameters"]}
    assert parameters["k_dn_per_e"] == twin.parameters.quantities["k_dn_per_e"].value
    # Nothing needs action.
    assert {one.severity for one in result.findings} == {"info"}
    assert "twin-describes-camera" in {one.code for one in result.findings}
    chain = twin_chain_text(twin)
    assert len(Chain.from_toml(chain, "chain.toml").scene.patches) == 16
    assert "# u = 0.00" in next(line for line in chain.splitlines() if line.startswith("k_dn_per_e"))


def measured(pair, value):
    return replace(pair, measured=replace(pair.measured, cdp=value))


def test_one_verdict_follows_from_pairs_and_signals_and_its_page_answers_first(twin, tmp_path):
    hostile = '"><img src=x onerror=alert(1)>'
    undetected = [measured(replace(p, asked=replace(p.asked, bright=hostile)), 0.0) for p in twin.pairs[:30]]
    wrong = replace(twin, pairs=(*undetected, *twin.pairs[30:]))
    assert verdict(wrong).code == "twin-differs"
    write_twin(wrong, twin_result(wrong), tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<img src=x" not in page
    places = [page.index(text) for text in ("Simulated data", "Pairs that agree", "<figure>", "<table>", "<details>")]
    assert places == sorted(places)
    patch = replace(twin.patches[0], measured=twin.patches[0].measured | {"mean_dn": (1.0, 0.1)})
    # One pair that differs is by chance, a mean that does is not.
    agreeing = [pair for pair in twin.pairs if pair.judgement == "agree"]
    few = replace(twin, pairs=(measured(agreeing[0], 0.0), *agreeing[1:]))
    assert (few.count("differ"), verdict(few).code) == (1, "twin-describes-camera")
    assert verdict(replace(few, patches=(patch, *twin.patches[1:]))).code == "twin-signals-differ"


def test_pairs_with_which_nearly_any_cdp_would_agree_are_undecided_and_counted_apart(twin):
    """80 % of 0 to 1: with 1.96 standard uncertainties, from 0.204 on in the middle and from 0.408 on at an end."""
    cases = {
        "undecided": [(1.0, 1.22, 1.0), (1.0, 1.22, 0.0), (0.5, 0.21, 0.5), (0.0, 0.41, 1.0)],
        "agree": [(0.5, 0.19, 0.5), (1.0, 0.4, 1.0)],
        "differ": [(1.0, 0.4, 0.1)],
    }
    pairs, expected = [], []
    for judgement, rows in cases.items():
        for predicted, u, value in rows:
            changed = replace(twin.pairs[0], predicted=predicted, u_predicted=u, u_pixels=1e-3)
            pairs.append(measured(changed, value))
            expected.append(judgement)
    assert twin_result(replace(twin, pairs=tuple(pairs))).table("pairs")["judgement"] == expected
    vacuous = tuple(replace(pair, u_predicted=2.4) for pair in twin.pairs)
    assert verdict(replace(twin, pairs=vacuous)).code == "twin-undecided"
