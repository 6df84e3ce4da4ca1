import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import tifffile
from jsonschema import Draft202012Validator

from labcdp.calibration import save
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.report.envelope import schema
from labcdp.session import Session, example_session


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """Calibration of the session that ships with labcdp."""
    path = tmp_path_factory.mktemp("calibrated") / "calibration.json"
    with Session.open(example_session()) as session:
        save(calibrate_session(observe_session(session)), path)
    return path


def test_a_session_becomes_one_map(labcdp, calibrated, tmp_path):
    done = labcdp("luminance", calibrated, example_session(), "-o", "map.tif", "--preview", "map.png", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(result)
    assert sorted(set(result["configuration"]["exposures_s"])) == [0.002, 0.008, 0.032]
    quantities = {row["quantity"]: row["value"] for row in result["tables"]["luminance"]["rows"]}
    assert quantities["valid pixels"] > 0.999
    values = tifffile.imread(tmp_path / "map.tif", key=0)
    # The patches read 414 and 34 cd/m^2 in the thesis; the brightest and the lower right one lie there.
    assert 380 < np.quantile(values, 0.99) < 450
    assert quantities["highest"] >= values[5:-5, 5:-5].max() * 0.99
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    with tifffile.TiffFile(tmp_path / "map.tif") as tiff:
        page = json.loads(tiff.pages.first.description)
    assert page["calibration"]["camera"].startswith("Allied Vision")
    assert page["unit"] == "cd/m^2"


def test_chosen_frames_and_exposures(labcdp, calibrated):
    (one,) = json.loads(
        labcdp("luminance", calibrated, example_session(), "-o", "a.npz", "--frame", 3, "--json").stdout
    )["configuration"]["frames"]
    assert one == "frames/0003_light_8ms.tif"
    done = labcdp("luminance", calibrated, example_session(), "-o", "b.exr", "--exposure", "8ms")
    assert done.returncode == 0
    assert "Luminance of 2 frames at 8 ms" in done.stdout
    assert "saturated" in done.stdout
    assert "add a shorter exposure" in done.stderr


def test_pictures_that_labcdp_did_not_record(labcdp, fails, calibrated, tmp_path):
    with Session.open(example_session()) as session:
        dn = session.load(session.frames("light")[0]).dn
    cv2.imwrite(str(tmp_path / "a.png"), dn)
    assert "a.png does not state its exposure time: use frames recorded by labcdp" in fails(
        "luminance", calibrated, "a.png", "-o", "a.npz"
    )
    # As another program would write it: the exposure, tag 33434, as a rational, type 5.
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack", extratags=[(33434, 5, 1, (1, 500), True)])
    done = labcdp("luminance", calibrated, "a.tif", "-o", "a.npz", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["configuration"]["exposures_s"] == [0.002]
    texts = [finding["text"] for finding in result["findings"]]
    assert any("does not state its camera: it is assumed to be Allied Vision" in text for text in texts)
    of_session = labcdp("luminance", calibrated, example_session(), "-o", "b.npz", "--frame", 1, "--json")
    tables = (result["tables"], json.loads(of_session.stdout)["tables"])
    assert len({table["luminance"]["rows"][0]["value"] for table in tables}) == 1
    cv2.imwrite(str(tmp_path / "colours.png"), np.dstack([dn, dn, dn // 2]))
    assert "colours.png: it is coloured, and the calibration is for the DN of the sensor" in fails(
        "luminance", calibrated, "colours.png", "-o", "c.npz"
    )
    assert "a.npz holds no DN, but floats" in fails("luminance", calibrated, "a.npz", "-o", "c.npz")


def test_a_frame_warmer_than_the_dark_frames_is_reported(labcdp, calibrated, tmp_path):
    with Session.open(example_session()) as session, Session.create(tmp_path / "warm", session.configuration) as warm:
        frame = session.load(max(session.frames("light"), key=lambda record: record.exposure_s))
        warm.add_frame(replace(frame, temperature_c=frame.temperature_c + 10), "light")
    done = labcdp("luminance", calibrated, "warm", "-o", "a.npz", "--json")
    assert done.returncode == 0, done.stderr
    (found,) = [one for one in json.loads(done.stdout)["findings"] if one["code"] == "temperature-not-covered"]
    assert (found["values"]["temperature_c"], found["values"]["highest_c"]) == (45.0, 35.0)


def test_bad_input_is_one_line(fails, calibrated, tmp_path):
    session = example_session()
    assert "ends in .tif, .tiff, .exr, .npz" in fails("luminance", calibrated, session, "-o", "a.jpg")
    assert "no frame 99: its frames are 1 to 12" in fails(
        "luminance", calibrated, session, "-o", "a.npz", "--frame", 99
    )
    assert "it has 2ms, 8ms, 32ms" in fails("luminance", calibrated, session, "-o", "a.npz", "--exposure", "5ms")
    assert "give a number above 0 with s, ms or us" in fails(
        "luminance", calibrated, session, "-o", "a.npz", "--exposure", "5"
    )
    assert "of patch 'P' alone" in fails("luminance", calibrated, session, "-o", "a.npz", "--patch", "P")
    assert "give it alone" in fails("luminance", calibrated, session, session, "-o", "a.npz")
    assert "cannot be read" in fails("luminance", calibrated, "no.tif", "-o", "a.npz")
    assert "is not a calibration" in fails("luminance", _json(tmp_path, {}), session, "-o", "a.npz")
    document = json.loads(calibrated.read_text())
    document["calibration"]["lens"]["f_number"] = 8.0
    assert "was changed after it was written" in fails("luminance", _json(tmp_path, document), session, "-o", "a.npz")
    assert not (tmp_path / "a.npz").exists()


def _json(folder, content):
    (folder / "other.json").write_text(json.dumps(content))
    return "other.json"
