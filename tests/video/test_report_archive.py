import json
import re
from dataclasses import replace
from pathlib import Path

import openpyxl
import pytest

from labcdp.evaluate.archive import ArchiveResult, VideoOutcome, archive_tasks
from labcdp.json_text import results_json
from labcdp.report.video_archive import write_archive
from labcdp.report.video_files import video_values

from .synthetic_results import synthetic_video


@pytest.fixture
def result(tmp_path: Path) -> ArchiveResult:
    tasks = archive_tasks([tmp_path / name for name in ("a.avi", "b.avi", "c & d.avi", "e.avi")], tmp_path)
    nothing = synthetic_video(30, regions=())
    nothing["cdp"][:] = float("nan")
    data = [synthetic_video(reference=10.0), synthetic_video(30, regions=()), None, nothing]
    outcomes = []
    for task, one in zip(tasks, data, strict=True):
        values = None if one is None else json.loads(results_json(video_values(one)))
        error = "" if values else "no video <at all>"
        outcomes.append(VideoOutcome(task, values, error, resumed=task is tasks[0]))
    return ArchiveResult(tuple(outcomes), ("worker tcp://127.0.0.1:1 died at a.avi",))


def test_page(result: ArchiveResult, tmp_path: Path) -> None:
    write_archive(result, tmp_path)
    page = (tmp_path / "archive.html").read_text()
    assert "3 of 4 videos were evaluated, 1 of them in an earlier run." in page
    assert "1 of 4 videos failed." in page
    assert "<dt>c &amp; d.avi</dt><dd>no video &lt;at all&gt;</dd>" in page
    assert "worker tcp://127.0.0.1:1 died at a.avi" in page


def test_page_leads_to_the_pages_of_the_videos(result: ArchiveResult, tmp_path: Path) -> None:
    spaced = replace(result.outcomes[3], task=replace(result.outcomes[3].task, folder=tmp_path / "e #1"))
    write_archive(replace(result, outcomes=(*result.outcomes[:3], spaced)), tmp_path)
    page = (tmp_path / "archive.html").read_text()
    assert re.findall(r'<a href="([^"]*)">([^<]*)</a>', page) == [
        ("a/report.html", "a"),
        ("b/report.html", "b"),
        ("e%20%231/report.html", "e #1"),
    ]


def test_sheet(result: ArchiveResult, tmp_path: Path) -> None:
    write_archive(result, tmp_path)
    with open(tmp_path / "archive.xlsx", "rb") as file:
        _, a, b, c, e = openpyxl.load_workbook(file)["Videos"].iter_rows(values_only=True)
    assert a[1:6] == ("a", 120, 1000, pytest.approx(35 / 120), 94)
    assert a[9] == pytest.approx(21 / 120)
    assert (b[3], b[9]) == (pytest.approx(7), None)
    assert c[2:] == (*(None,) * 8, "no video <at all>")
    assert e[4:9] == (0, 0, None, None, None)


def test_values(result: ArchiveResult, tmp_path: Path) -> None:
    write_archive(result, tmp_path)
    values = json.loads((tmp_path / "archive.json").read_text())
    assert (values["n_videos"], values["n_failed"]) == (4, 1)
    assert values["videos"][2]["error"] == "no video <at all>"
    assert values["videos"][0]["results"]["reference"]["n_seen"] == 35
