"""Requirements and what was seen: a pair is met where its lowest CDP is; what nobody could see is said."""

from math import nan

import pytest

from labcdp.evaluate.judgement import SeenContrast, judged_pairs
from labcdp.evaluate.requirement import Requirement, requirement_template

REQUIRED = Requirement(contrast=0.8, luminance_cd_m2=(5.0, 50.0), cdp_limit=0.9)


def seen(cdp, low, high, *, luminance=10.0, contrast=0.8, saturated=False, pair="P2 / P1", scene=None):
    return SeenContrast(pair, "a.png", luminance, contrast, saturated, cdp, (low, high), scene)


GOOD, OPEN, BAD = seen(0.97, 0.95, 0.99), seen(0.91, 0.88, 0.94), seen(0.6, 0.55, 0.65)
#: Of no interval, as of saturated regions.
UNKNOWN = seen(0.95, nan, nan, saturated=True)
DARK, LOST = seen(0.1, 0.05, 0.15, luminance=4.0), seen(nan, nan, nan)


@pytest.mark.parametrize(
    ("of_pair", "verdict", "margin", "counts"),
    [
        ([GOOD], "met", 0.07, (1, 1, 1)),
        ([GOOD, OPEN, GOOD], "undecided", 0.01, (3, 2, 3)),
        ([GOOD, OPEN, BAD], "not met", -0.3, (3, 1, 3)),
        ([GOOD, UNKNOWN], "undecided", 0.05, (2, 1, 2)),
        ([GOOD, seen(1.0, 0.99, 1.0, saturated=True)], "undecided", 0.1, (2, 1, 2)),
        ([GOOD, seen(0.0, 0.0, 0.01, saturated=True)], "not met", -0.9, (2, 1, 2)),
        # Where the requirement asks nothing, and where there is nothing, no verdict changes.
        ([GOOD, DARK, LOST], "met", 0.07, (1, 1, 3)),
        ([DARK], "undecided", None, (0, 0, 1)),
        ([LOST], "undecided", None, (0, 0, 1)),
        # By a meter the scene has another contrast than the required one; the camera may be good all the same.
        ([seen(0.0, 0.0, 0.01, contrast=9.6, scene=9.6)], "undecided", None, (0, 0, 1)),
        ([seen(0.0, 0.0, 0.01, contrast=0.3, scene=0.8)], "not met", -0.9, (1, 0, 1)),
    ],
)
def test_the_lowest_cdp_within_the_luminances_decides(of_pair, verdict, margin, counts):
    found = judged_pairs(REQUIRED, of_pair)
    (pair,) = found.pairs
    assert (found.verdict, pair.verdict) == (verdict, verdict)
    assert pair.margin == (None if margin is None else pytest.approx(margin))
    assert (pair.n_judged, pair.n_met, pair.n_seen) == counts


def test_all_pairs_must_meet_it():
    found = judged_pairs(REQUIRED, [GOOD, seen(0.6, 0.55, 0.65, pair="P3 / P1")])
    assert [one.verdict for one in found.pairs] == ["met", "not met"]
    assert found.verdict == "not met"


@pytest.mark.parametrize(
    ("one", "limit"),
    [
        (BAD, "scatter of the pixels"),
        (OPEN, "uncertainty of the CDP"),
        (seen(0.0, 0.0, 0.01, contrast=0.3), "measured contrast"),
        (seen(0.0, 0.0, 0.01, contrast=1.3), "measured contrast"),
        (UNKNOWN, "saturation"),
        (DARK, "luminance outside the requirement"),
        (seen(0.0, 0.0, 0.01, scene=9.6), "contrast outside the requirement"),
        (LOST, "no CDP"),
    ],
)
def test_what_limits_it(one, limit):
    assert judged_pairs(REQUIRED, [one]).pairs[0].limit == limit


@pytest.mark.parametrize(
    ("changes", "of_pair", "codes"),
    [
        ({}, [GOOD], {"requirement-luminance-part"}),
        ({"temperature_c": 60.0}, [GOOD], {"requirement-luminance-part", "requirement-temperature"}),
        ({"glare_cd_m2": 0.3}, [GOOD], {"requirement-luminance-part", "requirement-glare"}),
        ({}, [seen(0.97, 0.95, 0.99, luminance=None)], {"requirement-luminance-unknown"}),
        ({}, [DARK], {"requirement-luminance-other"}),
        ({}, [seen(0.0, 0.0, 0.01, scene=9.6)], {"requirement-other-contrast"}),
        ({}, [GOOD, LOST], {"requirement-luminance-part", "requirement-without-cdp"}),
    ],
)
def test_what_nobody_could_see_is_said(changes, of_pair, codes):
    findings = judged_pairs(REQUIRED.model_copy(update=changes), of_pair).findings
    assert {one.code for one in findings} == codes
    assert all(one.severity == "warning" for one in findings)


def test_the_template_is_a_requirement(tmp_path):
    file = tmp_path / "requirement.toml"
    file.write_text(requirement_template())
    assert Requirement.load(file).contrast == 0.8
