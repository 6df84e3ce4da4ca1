import json
import re
from pathlib import Path

import pytest
import xarray as xr
from jsonschema import Draft202012Validator

from labcdp.evaluate.video.archive import ArchiveResult, VideoOutcome, archive_tasks
from labcdp.evaluate.video.archive_page import archive_result, write_archive
from labcdp.evaluate.video.result import video_result
from labcdp.report.files import envelope, schema


def test_page_and_json_of_an_archive_say_what_became_of_each_video(
    tmp_path: Path, followed: xr.Dataset, near: xr.Dataset
) -> None:
    tasks = archive_tasks([tmp_path / name for name in ("a.avi", "b.avi", "c & d.avi", "e #1.avi")], tmp_path)
    nothing = near.assign(cdp=near["cdp"] * float("nan"))
    values = [envelope(video_result(one)) for one in (followed, near, nothing)]
    errors = ["", "", "no video <at all>", ""]
    outcomes = zip(tasks, (*values[:2], None, values[2]), errors, (True, False, False, False), strict=True)
    write_archive(archive_result(ArchiveResult(tuple(VideoOutcome(*one) for one in outcomes), ())), tmp_path)
    page = (tmp_path / "archive.html").read_text()
    assert "c &amp; d.avi: no video &lt;at all&gt;" in page
    links = re.findall(r'<a href="([^"]*)">', page)
    assert links == ["a/report.html", "b/report.html", "e%20%231/report.html"]
    found = json.loads((tmp_path / "archive.json").read_text())
    Draft202012Validator(schema()).validate(found)
    a, _, c, e = found["tables"]["videos"]["rows"]
    first = values[0]["tables"]["contrasts"]["rows"][0]
    assert {name: a[name] for name in first} == first
    lost = followed["lost"].mean("frame").max().item()
    assert (a["video"], a["n_frames"], a["lost_share"], a["resumed"]) == ("a", 24, pytest.approx(lost), True)
    assert (c["error"], c["n_frames"]) == ("no video <at all>", None)
    assert (e["n_detected"], e["n_evaluated"], e["mean_cdp"]) == (0, 0, None)
