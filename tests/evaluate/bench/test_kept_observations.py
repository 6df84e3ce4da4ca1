"""Kept observations: the same as measured ones to the last bit, and none for anything else."""

import json
import shutil
from collections import Counter
from dataclasses import asdict, astuple, replace

import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.calibration.frames.defects import DefectMap
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.core.errors import SessionError
from labcdp.evaluate.bench.calibrate import calibrate_recorded
from labcdp.evaluate.bench.corrections import calibration_corrections
from labcdp.evaluate.bench.kept import OBSERVATIONS, keep_observations, kept_session
from labcdp.evaluate.bench.observe import frame_maps, observe_session
from labcdp.evaluate.bench.recorded import by_exposure
from labcdp.evaluate.bench.session import evaluate_session, observe_calibrated, target_map
from labcdp.session import Session


@pytest.fixture(scope="module")
def folder(recorded, tmp_path_factory):
    """A calibration with the observations beside it, as `labcdp calibrate` writes them."""
    folder = tmp_path_factory.mktemp("calibrated")
    observed, calibration = calibrate_recorded([recorded])
    save(calibration, folder / "calibration.json")
    keep_observations(observed, folder / OBSERVATIONS)
    return folder


@pytest.fixture(scope="module")
def corrections(folder):
    """What the calibration of the file subtracts."""
    return calibration_corrections(load(folder / "calibration.json"))


@pytest.fixture
def copy(recorded, tmp_path):
    """A copy of the session that may be changed."""
    shutil.copytree(recorded.path, tmp_path / "s")
    with Session.open(tmp_path / "s", writable=True) as session:
        yield session


def values(by_plane):
    return {plane: [asdict(one) for one in group] for plane, group in by_plane.items()}


def test_kept_observations_are_those_that_are_measured(recorded, folder, corrections):
    steps = []
    kept = kept_session(recorded, corrections, folder / OBSERVATIONS, report=lambda *done: steps.append(done))
    measured = observe_session(recorded, corrections=corrections)
    for seen in ("by_plane", "darks_by_plane"):
        assert values(getattr(kept, seen)) == values(getattr(measured, seen))
    assert (kept.readings, kept.input_sha256) == (measured.readings, measured.input_sha256)
    assert kept.frames_sha256 == measured.frames_sha256
    assert steps == [(n, len(recorded.frames())) for n in range(1, len(recorded.frames()) + 1)]


def test_an_evaluation_is_the_same_with_and_without_them(recorded, folder):
    calibration = load(folder / "calibration.json")
    with_them = evaluate_session(*observe_calibrated(recorded, calibration, beside=folder / "calibration.json"))
    without = evaluate_session(*observe_calibrated(recorded, calibration))
    assert [astuple(row) for row in with_them.patches] == [astuple(row) for row in without.patches]
    assert [repr(row.cdp) for row in with_them.contrasts] == [repr(row.cdp) for row in without.contrasts]
    np.testing.assert_array_equal(with_them.map.luminance_cd_m2, without.map.luminance_cd_m2)


@pytest.mark.parametrize("what", ["vignetting", "defects", "dark library", "patches"])
def test_other_settings_are_measured_anew(recorded, folder, corrections, what):
    own = corrections[None]
    pattern, none = np.zeros(shape := own_shape(recorded), np.float32), ((0.0, 0.0), (0.0, 0.0))
    library = DarkLibrary(pattern, pattern, none, none, None, None, 2)
    one_pixel = DefectMap(np.array([3]), np.array([4]), np.array([1], np.uint8), shape)
    changed = {
        "vignetting": replace(own, vignetting=replace(own.vignetting, log_corner=own.vignetting.log_corner + 1e-12)),
        "defects": replace(own, defects=one_pixel),
        "dark library": replace(own, dark_library=library),
        "patches": own,
    }[what]
    without = ["P01"] if what == "patches" else []
    assert kept_session(recorded, {None: changed}, folder / OBSERVATIONS, without) is None


def own_shape(session):
    return session.frames()[0].shape


def test_other_frames_and_regions_are_measured_anew(copy, folder, corrections):
    assert kept_session(copy, corrections, folder / OBSERVATIONS) is not None
    first, *others = copy.configuration.target.patches
    moved = first.model_copy(update={"roi": (first.roi[0] + 1, *first.roi[1:])})
    before = copy.configuration
    copy.configuration = before.model_copy(
        update={"target": before.target.model_copy(update={"patches": (moved, *others)})}
    )
    assert kept_session(copy, corrections, folder / OBSERVATIONS) is None
    copy.configuration = before
    copy.supersede(copy.frames("light")[-1:], "not needed")
    assert kept_session(copy, corrections, folder / OBSERVATIONS) is None


def test_a_frame_that_was_altered_since_is_refused(copy, folder, corrections):
    path = copy.path / copy.frames("dark")[-1].file.name
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(SessionError, match="was altered"):
        kept_session(copy, corrections, folder / OBSERVATIONS)


@pytest.mark.parametrize("damage", ["missing", "cut", "foreign", "other version", "changed number"])
def test_a_file_that_is_not_theirs_is_ignored(recorded, folder, corrections, tmp_path, damage):
    path = tmp_path / OBSERVATIONS
    text = (folder / OBSERVATIONS).read_text()
    document = json.loads(text)
    if damage == "changed number":
        document["observations"][0]["darks"][0]["mean_dn"] += 1
    if damage != "missing":
        path.write_text(
            {
                "cut": text[: len(text) // 2],
                "foreign": '{"format": "something else"}',
                "other version": json.dumps(document | {"version": 0}),
            }.get(damage, json.dumps(document))
        )
    assert kept_session(recorded, corrections, path) is None


def test_each_frame_is_loaded_once(recorded, folder, monkeypatch):
    """By a calibration with the picture of its certificate, and by an evaluation the frames that its maps show."""
    loaded, load = Counter(), Session.load
    monkeypatch.setattr(Session, "load", lambda session, frame: loaded.update([frame.number]) or load(session, frame))
    (observed,), calibration = calibrate_recorded([recorded])
    target_map(observed, frame_maps(observed, calibration))
    assert loaded == Counter(frame.number for frame in recorded.frames())
    loaded.clear()
    evaluate_session(*observe_calibrated(recorded, calibration, beside=folder / "calibration.json"))
    assert loaded == Counter(group[0].number for group in by_exposure(recorded, "light").values())
