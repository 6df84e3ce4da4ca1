import json

import numpy as np
import pytest
import tifffile

from labcdp.session import Session, example_session

from .conftest import only_line, results_of


@pytest.fixture
def luminance(labcdp, inputs):
    """Run the command with the calibration of the example session; returns the finished process."""
    return lambda *arguments: labcdp("luminance", inputs / "c/calibration.json", *arguments)


def test_a_session_becomes_one_map(luminance, tmp_path):
    result = results_of(luminance(example_session(), "-o", "map.tif", "--preview", "map.png", "--json"))
    assert sorted(set(result["configuration"]["exposures_s"])) == [0.002, 0.008, 0.032]
    quantities = {row["quantity"]: row["value"] for row in result["tables"]["luminance"]["rows"]}
    assert quantities["valid pixels"] > 0.999
    # The patches read 414 and 34 cd/m^2 in the thesis; the brightest and the lower right one lie there.
    with tifffile.TiffFile(tmp_path / "map.tif") as tiff:
        values, page = tiff.pages.first.asarray(), json.loads(tiff.pages.first.description)
    assert 380 < np.quantile(values, 0.99) < 450
    assert quantities["highest"] >= values[5:-5, 5:-5].max() * 0.99
    assert page["calibration"]["camera"].startswith("Allied Vision")
    assert page["unit"] == "cd/m^2"
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_chosen_frames_and_those_that_labcdp_did_not_record(luminance, tmp_path):
    done = luminance(example_session(), "-o", "b.exr", "--exposure", "8ms")
    assert done.returncode == 0
    assert "Luminance of 2 frames at 8 ms" in done.stdout
    assert "saturated" in done.stdout
    assert "add a shorter exposure" in done.stderr
    one = results_of(luminance(example_session(), "-o", "one.npz", "--frame", 3, "--json"))
    assert one["configuration"]["frames"] == ["frames/0003_light_8ms.tif"]
    with Session.open(example_session()) as session:
        dn = session.load(session.frames("light")[2]).dn
    # As another program would write it: the exposure, tag 33434, as a rational, type 5.
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack", extratags=[(33434, 5, 1, (1, 125), True)])
    result = results_of(luminance("a.tif", "-o", "a.npz", "--json"))
    assert result["configuration"]["exposures_s"] == [0.008]
    texts = [finding["text"] for finding in result["findings"]]
    assert any("does not state its camera: it is assumed to be Allied Vision" in text for text in texts)
    first = [values["tables"]["luminance"]["rows"][0]["value"] for values in (one, result)]
    assert first[0] == first[1]
    assert "a.npz holds no DN, but floats" in only_line(luminance("a.npz", "-o", "c.npz"))
