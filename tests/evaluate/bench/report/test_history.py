"""The history of cameras: planes of one camera together, changes with their U."""

from dataclasses import replace

import pytest
from jsonschema import Draft202012Validator

from labcdp.calibration.verify.history import histories
from labcdp.core.errors import InputError
from labcdp.core.frame import PLANES
from labcdp.evaluate.bench.history import by_camera, history_result, write_history
from labcdp.report.files import envelope, schema


@pytest.fixture(scope="module")
def mono(evaluation):
    return histories({"c.json": evaluation.calibration}, {})


@pytest.fixture(scope="module")
def planes(mono):
    """Two measurements of four planes; blue lost a tenth, and the second one found nothing of red."""
    (one,) = mono
    (first,) = one.points
    later = {"source": "v.json", "measured": first.measured.replace(year=first.measured.year + 1)}
    later |= {"verdict": "undecided", "weight": None, "k_dn_per_e": None}
    r, *others = first.responsivity
    found = {"R": None, "Gr": (r, *others), "Gb": (r, *others), "B": (0.9 * r, *others)}
    weights = dict(zip(PLANES, (0.2, 0.45, 0.45, -0.1), strict=True))
    return [
        replace(
            one, plane=p, points=(replace(first, weight=weights[p]), replace(first, responsivity=found[p], **later))
        )
        for p in PLANES
    ]


def test_points_by_time_with_weights_and_verdicts_on_page_picture_and_sheet(planes, mono, tmp_path):
    (camera,) = by_camera(planes)
    assert [one.plane for one in camera] == list(PLANES)
    # A monochrome camera of the same name is another one.
    assert len(by_camera([*planes, *mono])) == 2
    result = history_result(planes)
    Draft202012Validator(schema()).validate(envelope(result))
    rows = list(result.table("history").rows())
    assert [row["plane"] for row in rows] == [*PLANES, *PLANES]
    assert [row["weight"] for row in rows[:4]] == [0.2, 0.45, 0.45, -0.1]
    assert {row["by"] for row in rows[4:]} == {"verification: undecided"}
    assert rows[4]["responsivity"] is rows[4]["expanded_r"] is None
    for name in ("h.html", "h.png", "h.xlsx"):
        write_history(planes, result, tmp_path / name)
    page = (tmp_path / "h.html").read_text()
    assert page.index("changed</span>") < page.index("data:image/png")
    both = [*planes, *mono]
    with pytest.raises(InputError, match="a picture shows one camera and setting, these are 2"):
        write_history(both, history_result(both), tmp_path / "two.png")
