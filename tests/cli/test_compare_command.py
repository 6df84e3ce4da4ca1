"""The command compare: files of any kind by name, one page, and refusals."""

import shutil

from labcdp import compare

from .conftest import only_line, rows_of


def test_pictures_side_by_side_and_refusals(labcdp, inputs, tmp_path):
    shutil.copy(inputs / "a.png", tmp_path / "b.png")
    command = ("image", inputs / "a.png", "b.png", "--roi", inputs / "rois.json", "--contrast", "100%")
    assert labcdp(*command, "--output", "both").returncode == 0
    done = labcdp("compare", "both", "--json")
    assert {row["differs"] for row in rows_of(done, "differences")} == {"no"}
    folder = tmp_path / "both-compare"
    assert (folder / "results.json").read_text() == done.stdout
    written = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert written == {"labcdp-files.json", "results.json", "report.html", "results.xlsx", "figures/comparison.png"}
    # The pictures themselves give what the results of labcdp image give.
    own = labcdp("compare", inputs / "a.png", "b.png", "--roi", inputs / "rois.json", "--contrast", "100%", "--json")
    assert rows_of(own, "differences") == rows_of(done, "differences")
    found = compare(inputs / "a.png", tmp_path / "b.png", regions=inputs / "rois.json", contrast=1.0)
    assert found.to_dict()["tables"]["differences"]["rows"] == rows_of(done, "differences")
    assert "give its regions with --roi" in only_line(labcdp("compare", inputs / "a.png", "b.png", "-o", "x"))
    assert "both-compare" in only_line(labcdp("compare", "both", "--epsilon", "40%"))
    assert "is a picture, but" in only_line(labcdp("compare", "both", inputs / "c" / "calibration.json", "-o", "x"))
    assert not (tmp_path / "x").exists()
