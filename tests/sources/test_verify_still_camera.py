"""A still camera that was calibrated by its RAW files is verified by later ones, and has a history."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile

from labcdp.acquire.import_check import ImportFile
from labcdp.acquire.import_files import import_session
from labcdp.calibration import save
from labcdp.calibration.verification_file import save_verification
from labcdp.evaluate import calibrate_session, observe_session
from labcdp.evaluate.verify import verify_session
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
        sound = verify_session(session, calibration)
    assert sound.verdict == "valid"
    assert "the colour balance is where it was" in sound.findings
    folder = still_camera.folder / "all"
    folder.mkdir()
    save(calibration, folder / "calibration.json")
    save_verification(sound, folder / "sound.json")
    session = later("faded", {"B": 0.95})
    faded = labcdp("verify", "all/calibration.json", session, *GREY_ONES, "--output", "all/faded", "--json")
    values = json.loads(faded.stdout)
    assert values["verdict"] != "valid"
    assert faded.returncode == (3 if values["verdict"] == "not valid" else 0)
    balance = values["balance"]
    assert (balance["odd"], balance["against"]) == ("blue", "green")
    assert balance["change_rel"] == pytest.approx(-0.05, abs=2 * balance["half_width_95_rel"])
    assert any("the colour balance has changed: blue has lost" in text for text in values["findings"])
    assert [row["patch"] for row in values["patches"]] == ["white", "grey", "black"]
    assert [plane["plane"] for plane in values["planes"]] == list(PLACES)
    done = labcdp("history", "all", "--json", "-o", "history.html")
    cameras = json.loads(done.stdout)["cameras"]
    assert [one["plane"] for one in cameras] == list(PLACES)
    assert [len(one["points"]) for one in cameras] == [3] * 4
    assert "which is more than its uncertainty" in (still_camera.folder / "history.html").read_text()
