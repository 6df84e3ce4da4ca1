import json
import re
from pathlib import Path

import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.core.result import warning
from labcdp.evaluate.video.archive import ArchiveResult, VideoOutcome, archive_tasks
from labcdp.evaluate.video.archive_page import archive_result, write_archive
from labcdp.evaluate.video.result import video_result
from labcdp.report.files import envelope, schema

from .synthetic_results import synthetic_video


@pytest.fixture
def archive(tmp_path: Path) -> ArchiveResult:
    tasks = archive_tasks([tmp_path / name for name in ("a.avi", "b.avi", "c & d.avi", "e #1.avi")], tmp_path)
    nothing = synthetic_video(30, regions=())
    nothing["cdp"][:] = float("nan")
    data = [synthetic_video(reference=10.0), synthetic_video(30, regions=()), None, nothing]
    outcomes = []
    for task, one in zip(tasks, data, strict=True):
        values = None if one is None else envelope(video_result(one))
        outcomes.append(VideoOutcome(task, values, "" if values else "no video <at all>", resumed=task is tasks[0]))
    return ArchiveResult(tuple(outcomes), (warning("worker-died", "tcp://127.0.0.1:1", video="a.avi"),))


def test_the_page_names_failures_and_leads_to_the_pages_of_the_videos(archive: ArchiveResult, tmp_path: Path) -> None:
    write_archive(archive_result(archive), tmp_path)
    page = (tmp_path / "archive.html").read_text()
    assert page.index("c &amp; d.avi: no video &lt;at all&gt;") < page.index("3 of 4")
    assert "tcp://127.0.0.1:1 died" in page
    assert re.findall(r'<a href="([^"]*)">([^<]*)</a>', page) == [
        ("a/report.html", "a"),
        ("b/report.html", "b"),
        ("e%20%231/report.html", "e #1"),
    ]


def test_json_and_sheet_say_the_same(archive: ArchiveResult, tmp_path: Path) -> None:
    write_archive(archive_result(archive), tmp_path)
    values = json.loads((tmp_path / "archive.json").read_text())
    Draft202012Validator(schema()).validate(values)
    a, b, c, e = values["tables"]["videos"]["rows"]
    assert (a["video"], a["n_frames"], a["contrast"], a["n_detected"], a["n_evaluated"]) == ("a", 120, 10.0, 35, 94)
    assert (a["lost_share"], a["resumed"]) == (pytest.approx(21 / 120), True)
    assert (b["contrast"], b["lost_share"]) == (0.07, None)
    assert (c["error"], c["n_frames"]) == ("no video <at all>", None)
    assert (e["n_detected"], e["n_evaluated"], e["mean_cdp"]) == (0, 0, None)
    assert [one["video"] for one in values["tables"]["lost"]["rows"]] == ["a", "a"]
    assert [(one["code"], one["severity"]) for one in values["findings"]] == [
        ("video-failed", "error"),
        ("worker-died", "warning"),
    ]
    with (tmp_path / "archive.xlsx").open("rb") as file:
        cells = list(openpyxl.load_workbook(file)["videos"].iter_rows(2, values_only=True))
    assert [row[3] for row in cells] == [120, 30, None, 30]
