"""Many pictures in a few numbers, which follow from those of each; and contrasts where the answer changes."""

from itertools import pairwise

import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.core.table import Column, Table
from labcdp.evaluate.picture.settings import ImageSettings
from labcdp.evaluate.picture.summary import summary_cards, summary_table, trend
from labcdp.evaluate.verdict import cdp_verdict, changes_of

_COLUMNS = [
    Column(name, name)
    for name in (
        "picture", "number", "pair", "contrast", "contrast_origin", "cdp", "verdict", "measured_contrast",
        "measured_contrast_bound",
    )
]  # fmt: skip


def _table(cdp):
    """Return the table of pictures with the CDP of contrasts 0.1, 0.2, …, a row of `cdp` a picture."""
    rows = [
        {
            "picture": f"{number}.png", "number": number, "pair": "a / b", "contrast": 0.1 * (place + 1),
            "contrast_origin": "given", "cdp": one, "verdict": cdp_verdict(one, (one, one), 0.8),
            "measured_contrast": number / 10, "measured_contrast_bound": ">" if number == 2 else "",
        }
        for number, of_picture in enumerate(cdp, start=1)
        for place, one in enumerate(of_picture)
    ]  # fmt: skip
    return Table.of_items("cdp", "CDP", _COLUMNS, rows)


def test_mean_spread_worst_and_verdicts_are_those_of_the_pictures():
    cdp = np.random.default_rng(0).uniform(0.5, 1.0, (20, 2))
    first, second = summary_table(_table(cdp), 0.8).rows()
    for row, values in ((first, cdp[:, 0]), (second, cdp[:, 1])):
        assert row["mean_cdp"] == pytest.approx(values.mean())
        assert row["std_cdp"] == pytest.approx(values.std(ddof=1))
        assert (row["lowest_cdp"], row["lowest_picture"]) == (values.min(), f"{values.argmin() + 1}.png")
        assert (row["n_detected"], row["n_not_detected"]) == ((values >= 0.8).sum(), (values < 0.8).sum())
    # A bound is no measured contrast.
    assert first["mean_measured_contrast"] == pytest.approx(np.delete(np.arange(1, 21), 1).mean() / 10)


def test_the_trend_is_that_of_a_straight_line_and_its_u_covers():
    x = np.arange(12.0)
    change, expanded = trend(x, 0.9 - 0.02 * x)
    assert (change, expanded) == (pytest.approx(-0.22), pytest.approx(0.0, abs=1e-12))
    noise = np.random.default_rng(1).normal(size=(2000, 12))
    found = [trend(x, 0.5 + 0.01 * x + 0.1 * one) for one in noise]
    covered = np.mean([abs(one - 0.11) <= u for one, u in found])
    assert 0.935 < covered < 0.965


@pytest.mark.parametrize(
    ("answers", "most", "places"),
    [
        ([0.0, 0.0, 0.1, 0.9, 1.0, 1.0, 1.0], 2, [2, 3]),
        ([0.0, 0.0, 1.0, 1.0, 1.0, 0.2, 0.0], 3, [1, 2, 4]),
        ([1.0] * 5, 3, [0, 2, 4]),
        ([None, None, 0.5, 0.5], 2, [1, 2]),
        ([0.3, 0.4], 3, [0, 1]),
    ],
)
def test_contrasts_are_shown_where_the_answer_changes(answers, most, places):
    found = changes_of(answers, most)
    assert found == places
    assert all(a < b for a, b in pairwise(found))


def test_cards_have_the_verdict_of_the_limit():
    cdp = np.column_stack([np.full(6, 0.1), np.full(6, 0.95), np.linspace(0.6, 1.0, 6)])
    table = _table(cdp)
    cards = list(summary_cards(summary_table(table, 0.8), 0.8))
    assert [(card.state, card.verdict) for card in cards] == [
        ("bad", "detected in 0 of 6"), ("good", "detected in 6 of 6"), ("open", "detected in 3 of 6"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("cdp", "interval", "verdict"),
    [
        (0.95, (0.93, 0.97), "detected"),
        (0.91, (0.88, 0.93), "undecided"),
        (0.5, (0.4, 0.6), "not detected"),
        (0.95, (float("nan"), float("nan")), "undecided"),
    ],
)
def test_a_contrast_is_undecided_where_the_interval_is_unknown_or_has_the_limit_in_it(cdp, interval, verdict):
    assert cdp_verdict(cdp, interval, 0.9) == verdict


@pytest.mark.parametrize("limit", [0.0, 1.5, -1.0])
def test_a_limit_that_is_no_probability_is_refused(limit):
    with pytest.raises(InputError, match="CDP limit"):
        ImageSettings(neighbours=True, cdp_limit=limit)
