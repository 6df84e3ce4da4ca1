"""The same data given twice is not measured twice."""

import os
import shutil

import cv2
import pytest
import tifffile

from ..conftest import valid
from .conftest import only_line
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


@pytest.fixture(scope="module")
def half_new(folder, labcdp_in):
    """A session of the first one's light pictures, as PNG of other names and times, with new dark ones and readings."""
    for source in (folder / "again/frames").glob("*light*.tif"):
        kept = folder / "mixed" / f"-{source.stem}.png"
        kept.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(kept), tifffile.imread(source))
    arguments = write_importable(folder / "new", seed=8)
    exposures = [f"--exposure=mixed/{path.name}={path.stem.split('_')[-1]}" for path in (folder / "mixed").iterdir()]
    exposures += [one.replace("dark/", "new/dark/") for one in arguments if "dark/" in one]
    options = ("--light", "mixed", "--dark", "new/dark", "--readings", "new/readings.csv", *exposures)
    done = labcdp_in(folder, "import", "plan.toml", "half", *options)
    assert done.returncode == 0, done.stderr
    return "half"


def test_frames_of_a_calibration_do_not_verify_it_in_other_files(folder, labcdp_in, half_new):
    for name, share in (("again", "15 of the 15"), (half_new, "9 of the 15")):
        done = labcdp_in(folder, "verify", "first-calibrate/calibration.json", name)
        assert f"{share} frames of session {name}" in only_line(done)
    done = labcdp_in(folder, "verify", "first-calibrate/calibration.json", "other")
    assert done.returncode in (0, 3, 4), done.stderr


def test_calibrations_and_verifications_of_the_same_frames_are_one_measurement(folder, labcdp_in):
    def change(*commands):
        for command in commands:
            done = labcdp_in(folder, *command)
            assert done.returncode in (0, 3, 4), done.stderr
        done = labcdp_in(
            folder, "history", *(command[-1] for command in commands), "-o", commands[-1][-1] + "-h", "--json"
        )
        (row,) = valid(done.stdout)["tables"]["cameras"]["rows"]
        return row["n_points"], row["change_rel"] is None

    assert change(("calibrate", "first", "-o", "one"), ("calibrate", "again", "-o", "two")) == (1, True)
    assert change(("calibrate", "first", "-o", "three"), ("calibrate", "other", "-o", "four")) == (2, False)
    of_other = "verify", "four/calibration.json"
    assert change((*of_other, "first", "-o", "five"), (*of_other, "again", "-o", "six")) == (1, True)


@pytest.mark.parametrize("name", ["first", "copy"])
def test_a_session_does_not_verify_its_own_calibration(folder, labcdp_in, name):
    done = labcdp_in(folder, "verify", "first-calibrate/calibration.json", name)
    assert done.returncode == 1
    assert "which cannot verify it: measure again" in done.stderr
