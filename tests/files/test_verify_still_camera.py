"""A still camera that was calibrated by its RAW files is verified by later ones, and has a history."""

import json

import numpy as np
import pytest
import tifffile
from jsonschema import Draft202012Validator

from labcdp.acquire.import_files import import_session
from labcdp.calibration import save
from labcdp.calibration.record import save_verification
from labcdp.core.errors import CalibrationError
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.verification import verify_session
from labcdp.report.files import schema
from labcdp.session import Session, SessionConfiguration

from .conftest import BLACK_DN, PLACES, picture_files, write_frame

GREY_ONES = ("--patch", "white", "--patch", "grey", "--patch", "black")


def imported(still_camera, folder):
    """Session of the pictures of a folder."""
    bench = SessionConfiguration.load(still_camera.folder / "bench.toml")
    import_session(bench, folder / "session", picture_files(folder), folder / "readings.csv")
    return folder / "session"


def later(still_camera, name, blue=1.0):
    """Import pictures of a later day, on which blue pixels see another part of the light."""
    folder, rng = still_camera.folder / name, np.random.default_rng(3)
    for file in picture_files(still_camera.folder):
        dn = tifffile.imread(file.path).astype(float)
        if file.role == "light":
            row, column = PLACES["B"]
            dn[row::2, column::2] += (blue - 1) * (dn[row::2, column::2] - BLACK_DN["B"])
        (folder / file.role).mkdir(parents=True, exist_ok=True)
        # Rounding again would be seen in the noise of dark pixels.
        write_frame(folder / file.role / file.path.name, dn + rng.uniform(-0.4, 0.4, dn.shape))
    readings = (still_camera.folder / "readings.csv").read_text(encoding="utf-8").replace("2026-03", "2026-09")
    (folder / "readings.csv").write_text(readings, encoding="utf-8")
    return imported(still_camera, folder)


def test_a_filter_that_fades_is_seen_and_stays_in_the_history(still_camera, labcdp):
    with Session.open(imported(still_camera, still_camera.folder)) as session:
        calibration = calibrate_session(observe_session(session))
        with pytest.raises(CalibrationError, match="the calibration was made from session"):
            verify_session(session, calibration)
    with Session.open(later(still_camera, "sound")) as session:
        sound, _ = verify_session(session, calibration, GREY_ONES[1::2])
    assert sound.verdict == "conform"
    assert "colour-balance-kept" in {one.code for one in sound.findings}
    folder = still_camera.folder / "all"
    folder.mkdir()
    save(calibration, folder / "calibration.json")
    save_verification(sound, folder / "sound.json")
    session = later(still_camera, "faded", blue=0.95)
    faded = labcdp("verify", "all/calibration.json", session, *GREY_ONES, "--output", "all/faded", "--json")
    values = json.loads(faded.stdout)
    Draft202012Validator(schema()).validate(values)
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    (verdict,) = tables["verdict"]
    assert faded.returncode == {"conform": 0, "not conform": 3, "undecided": 4}[verdict["verdict"]]
    assert [row["patch"] for row in tables["patches"]] == ["black", "grey", "white"]
    planes = {row["plane"]: row for row in tables["planes"]}
    assert list(planes) == list(PLACES)
    assert planes["B"]["balance_rel"] == pytest.approx(-0.05, abs=2 * planes["B"]["expanded_balance_rel"])
    assert "B" in [one["subject"] for one in values["findings"] if one["code"] == "colour-balance-changed"]
    done = labcdp("history", "all", "--json", "-o", "history.html")
    tables = {name: table["rows"] for name, table in json.loads(done.stdout)["tables"].items()}
    assert [(one["plane"], one["n_points"]) for one in tables["cameras"]] == [(plane, 3) for plane in PLACES]
    blue = [row["responsivity"] for row in tables["history"] if row["plane"] == "B"]
    assert min(blue) == pytest.approx(0.95 * blue[0], rel=0.01)
