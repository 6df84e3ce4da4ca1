"""The same data given twice is not measured twice."""

import os
import shutil

import pytest

from ..conftest import valid
from .importable import write_importable


@pytest.fixture(scope="module")
def folder(tmp_path_factory, labcdp_in):
    """Two sessions, a copy of the first, and one imported again from copies of its pictures; all calibrated."""
    folder = tmp_path_factory.mktemp("twice")
    arguments = write_importable(folder)
    for name in ("first", "again"):
        done = labcdp_in(folder, "import", "plan.toml", name, *arguments)
        assert done.returncode == 0, done.stderr
        # Copies have other times.
        for path in (folder / "readings.csv", *folder.glob("*/*.tif")):
            os.utime(path, (1e9, 1e9))
    shutil.copytree(folder / "first", folder / "copy")
    write_importable(folder, seed=6)
    for command in (["import", "plan.toml", "other", *arguments], ["calibrate", "first"]):
        done = labcdp_in(folder, *command)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize(
    ("second", "share"), [("first", "23 of the 23"), ("copy", "23 of the 23"), ("again", "15 of the 23")]
)
def test_a_session_given_twice_or_a_copy_of_it_is_no_second_measurement(folder, labcdp_in, second, share):
    done = labcdp_in(folder, "calibrate", "first", second, "-o", "twice")
    assert done.returncode == 1
    assert f"{share} frames and readings of session {second} are also in first" in done.stderr
    assert not (folder / "twice").exists()


def test_another_session_is_one(folder, labcdp_in):
    done = labcdp_in(folder, "calibrate", "first", "other", "-o", "both")
    assert done.returncode == 0, done.stderr


def test_a_copy_of_a_calibration_is_no_point_of_the_history(folder, labcdp_in):
    shutil.copytree(folder / "first-calibrate", folder / "copy-calibrate")
    done = labcdp_in(folder, "calibrate", "first", "--without", "P01", "-o", "fewer")
    assert done.returncode == 0, done.stderr
    done = labcdp_in(folder, "history", "first-calibrate", "copy-calibrate", "fewer", "-o", "history", "--json")
    assert "copy-calibrate/calibration.json is a copy of first-calibrate/calibration.json" in done.stderr
    result = valid(done.stdout)
    (row,) = result["tables"]["cameras"]["rows"]
    assert (row["n_points"], row["change_rel"]) == (1, None)
    assert [one["code"] for one in result["findings"]].count("measured-once") == 1


@pytest.mark.parametrize("name", ["first", "copy"])
def test_a_session_does_not_verify_its_own_calibration(folder, labcdp_in, name):
    done = labcdp_in(folder, "verify", "first-calibrate/calibration.json", name)
    assert done.returncode == 1
    assert "which cannot verify it: measure again" in done.stderr
