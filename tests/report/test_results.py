"""The files: all there, whole, the same again, and one clear error if they cannot be."""

import json
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from labcdp.errors import InputError
from labcdp.evaluate import SessionEvaluation
from labcdp.report import write_results

NAMES = [
    "results.json",
    "report.html",
    "results.xlsx",
    "figures/target.png",
    "figures/luminance.png",
    "figures/fit.png",
    "figures/contrast-1.png",
    "figures/contrast-2.png",
]


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_writes_these_files_and_the_same_again(evaluation: SessionEvaluation, written: Path, tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    assert write_results(evaluation, folder) == [folder / name for name in NAMES]
    assert sorted(files(written)) == sorted(NAMES)
    assert files(folder) == files(written)


def test_json_holds_the_evaluation(evaluation: SessionEvaluation, written: Path) -> None:
    text = (written / "results.json").read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(json.dumps(evaluation.to_dict()))


def test_json_has_null_for_what_is_not_finite(evaluation: SessionEvaluation, tmp_path: Path) -> None:
    nan = float("nan")
    row = evaluation.contrasts[0]
    unknown = replace(
        row.calibrated_cdp,
        result=replace(row.cdp, standard_error=nan, confidence_interval=(nan, nan)),
        confidence_interval=(nan, nan),
    )
    row = replace(row, calibrated_cdp=unknown)
    write_results(replace(evaluation, contrasts=[row]), tmp_path)
    contrast = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["contrasts"][0]
    assert contrast["standard_error"] is None
    assert contrast["confidence_interval_95"] == [None, None]
    assert "(unknown)" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_pictures_open_and_are_not_blank(written: Path) -> None:
    for path in (written / "figures").iterdir():
        picture = cv2.imread(str(path))
        assert picture is not None
        assert picture.std() > 20


def test_replaces_an_earlier_evaluation_and_leaves_other_files(evaluation: SessionEvaluation, tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    for name in ("report.html", "figures/contrast-1.png", "figures/contrast-mine.png", "figures/contrast-2.png.txt"):
        (tmp_path / name).write_bytes(b"old")
    write_results(replace(evaluation, contrasts=[]), tmp_path)
    found = files(tmp_path)
    assert set(found) == {*NAMES[:6], "figures/contrast-mine.png", "figures/contrast-2.png.txt"}
    assert found["report.html"] != b"old"


def test_a_file_in_place_of_the_folder(evaluation: SessionEvaluation, tmp_path: Path) -> None:
    (tmp_path / "taken").write_bytes(b"mine")
    with pytest.raises(InputError, match=r"taken/figures cannot be written \(Not a directory\): give a folder you can"):
        write_results(evaluation, tmp_path / "taken")
    assert files(tmp_path) == {"taken": b"mine"}


def test_a_folder_in_place_of_a_file(evaluation: SessionEvaluation, tmp_path: Path) -> None:
    (tmp_path / "report.html").mkdir()
    with pytest.raises(InputError, match=r"report\.html cannot be written \(Is a directory\)"):
        write_results(replace(evaluation, contrasts=[]), tmp_path)
    # Nor a part of the results: they belong together.
    assert set(files(tmp_path)) == set()


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size: writing fails as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_file_that_does_not_fit_leaves_no_half_of_it(evaluation: SessionEvaluation, tmp_path: Path) -> None:
    with largest_file(100_000), pytest.raises(InputError, match=r"report\.html cannot be written \(File too large\)"):
        write_results(replace(evaluation, contrasts=[]), tmp_path)
    # Nor a part of the results: they belong together.
    assert set(files(tmp_path)) == set()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write to a read-only folder")
def test_a_read_only_folder(evaluation: SessionEvaluation, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(InputError, match=r"figures cannot be written \(Permission denied\)"):
            write_results(evaluation, tmp_path)
    finally:
        tmp_path.chmod(0o700)
    assert files(tmp_path) == {}
