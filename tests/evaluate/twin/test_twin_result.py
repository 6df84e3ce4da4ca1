from dataclasses import replace

from labcdp.evaluate.twin.result import twin_result, verdict


def measured(pair, value):
    return replace(pair, measured=replace(pair.measured, cdp=value))


def test_one_verdict_follows_from_pairs_and_signals(twin):
    result = twin_result(twin)
    assert [row["predicted_cdp"] for row in result.table("pairs").rows()] == [pair.predicted for pair in twin.pairs]
    assert {one.severity for one in result.findings} == {"info"}
    wrong = [measured(pair, 0.0) for pair in twin.pairs[:30]]
    assert verdict(replace(twin, pairs=(*wrong, *twin.pairs[30:]))).code == "twin-differs"
    patch = replace(twin.patches[0], measured=twin.patches[0].measured | {"mean_dn": (1.0, 0.1)})
    # One pair that differs is by chance, a mean that does is not.
    agreeing = [pair for pair in twin.pairs if pair.judgement == "agree"]
    few = replace(twin, pairs=(measured(agreeing[0], 0.0), *agreeing[1:]))
    assert (few.count("differ"), verdict(few).code) == (1, "twin-describes-camera")
    assert verdict(replace(few, patches=(patch, *twin.patches[1:]))).code == "twin-signals-differ"


def test_pairs_with_which_nearly_any_cdp_would_agree_are_undecided_and_counted_apart(twin):
    """80 % of 0 to 1: with 1.96 standard uncertainties, from 0.204 on in the middle and from 0.408 on at an end."""
    for judgement, rows in {
        "undecided": [(1.0, 1.22, 1.0), (1.0, 1.22, 0.0), (0.5, 0.21, 0.5), (0.0, 0.41, 1.0)],
        "agree": [(0.5, 0.19, 0.5), (1.0, 0.4, 1.0)],
        "differ": [(1.0, 0.4, 0.1)],
    }.items():
        for predicted, u, value in rows:
            pair = replace(twin.pairs[0], predicted=predicted, u_predicted=u, u_pixels=1e-3)
            assert measured(pair, value).judgement == judgement
    vacuous = tuple(replace(pair, u_predicted=2.4) for pair in twin.pairs)
    assert verdict(replace(twin, pairs=vacuous)).code == "twin-undecided"
