"""A still camera that was calibrated by its RAW files is verified by later ones, and has a history."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile
from jsonschema import Draft202012Validator

from labcdp.acquire.imports.check import ImportFile
from labcdp.acquire.imports.files import import_session
from labcdp.calibration import save
from labcdp.calibration.verify.file import save_verification
from labcdp.core.errors import CalibrationError
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.verify import verify_session
from labcdp.report.envelope import schema
from labcdp.session import Session, SessionConfiguration

PLACES = {"R": (0, 0), "Gr": (0, 1), "Gb": (1, 0), "B": (1, 1)}
BLACK_DN = {"R": 510, "Gr": 512, "Gb": 512, "B": 515}
GREY_ONES = ("--patch", "white", "--patch", "grey", "--patch", "black")


@pytest.fixture
def later(still_camera, labcdp, new_dng):
    """Import pictures of a later day, on which planes see another part of the light."""

    def record(name, factors):
        folder = still_camera.folder / name
        rng = np.random.default_rng(3)
        for role in ("light", "dark"):
            (folder / role).mkdir(parents=True)
            for path in sorted((still_camera.folder / role).iterdir()):
                dn = tifffile.imread(path).astype(float)
                for plane, factor in factors.items():
                    row, column = PLACES[plane]
                    net = dn[row::2, column::2] - BLACK_DN[plane]
                    # Rounding again would be seen in the noise of dark pixels.
                    dn[row::2, column::2] = BLACK_DN[plane] + (factor * net if role == "light" else net)
                dn += rng.uniform(-0.4, 0.4, dn.shape)
                pixels = np.clip(np.rint(dn), 0, 15000).astype(np.uint16)
                denominator = int(path.name.split("_")[0])
                new_dng(folder / role / path.name, pixels, black=tuple(BLACK_DN.values()), white=15000,
                        exposure=(1, denominator), iso=100)  # fmt: skip
        readings = (still_camera.folder / "readings.csv").read_text(encoding="utf-8").replace("2026-03", "2026-09")
        (folder / "readings.csv").write_text(readings, encoding="utf-8")
        return imported(still_camera, folder)

    return record


def imported(still_camera, folder):
    """Import the pictures of a folder."""
    files = [ImportFile(path, role) for role in ("light", "dark") for path in sorted((folder / role).iterdir())]
    configuration = SessionConfiguration.load(still_camera.folder / "bench.toml")
    import_session(configuration, folder / "session", files, folder / "readings.csv")
    return folder / "session"


def test_a_filter_that_fades_is_seen_and_stays_in_the_history(still_camera, labcdp, later):
    with Session.open(imported(still_camera, still_camera.folder)) as session:
        calibration = calibrate_session(observe_session(session))
        with pytest.raises(CalibrationError, match="the calibration was made from session"):
            verify_session(session, calibration)
    with Session.open(still_camera.folder / later("sound", {})) as session:
        sound, _ = verify_session(session, calibration, GREY_ONES[1::2])
    assert sound.verdict == "conform"
    assert "colour-balance-kept" in {one.code for one in sound.findings}
    folder = still_camera.folder / "all"
    folder.mkdir()
    save(calibration, folder / "calibration.json")
    save_verification(sound, folder / "sound.json")
    session = later("faded", {"B": 0.95})
    faded = labcdp("verify", "all/calibration.json", session, *GREY_ONES, "--output", "all/faded", "--json")
    values = json.loads(faded.stdout)
    Draft202012Validator(schema()).validate(values)
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    (verdict,) = tables["verdict"]
    assert faded.returncode == {"conform": 0, "not conform": 3, "undecided": 4}[verdict["verdict"]]
    blue = tables["planes"][3]
    assert blue["balance_rel"] == pytest.approx(-0.05, abs=2 * blue["expanded_balance_rel"])
    assert "B" in [one["subject"] for one in values["findings"] if one["code"] == "colour-balance-changed"]
    assert [row["patch"] for row in tables["patches"]] == ["black", "grey", "white"]
    assert [plane["plane"] for plane in tables["planes"]] == list(PLACES)
    done = labcdp("history", "all", "--json", "-o", "history.html")
    cameras = json.loads(done.stdout)["tables"]["cameras"]["rows"]
    assert [one["plane"] for one in cameras] == list(PLACES)
    assert [one["n_points"] for one in cameras] == [3] * 4
    rows = [row for row in json.loads(done.stdout)["tables"]["history"]["rows"] if row["plane"] == "B"]
    assert min(row["responsivity"] for row in rows) == pytest.approx(0.95 * rows[0]["responsivity"], rel=0.01)
