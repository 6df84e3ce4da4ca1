import json
import shutil

import numpy as np
import pytest

import labcdp
from labcdp.session import example_session


@pytest.fixture(scope="module")
def calibrated():
    return labcdp.Session.open(example_session()).calibrate()


def same(one, other):
    """Whether two results agree; sums by BLAS may differ in the last digits with the place of arrays in memory."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, list):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    return one == (pytest.approx(other, rel=1e-9, abs=1e-15) if isinstance(one, float) else other)


def test_numbers_are_those_of_the_command_line(calibrated, command, tmp_path):
    shutil.copytree(example_session(), tmp_path / "session")
    printed = command("calibrate", "session", "--json")
    quantities = {row["quantity"]: row["value"] for row in json.loads(printed)["tables"]["calibration"]["rows"]}
    found_range = [quantities[f"{end} calibrated luminance"] for end in ("lowest", "highest")]
    assert same(found_range, list(calibrated.calibration.range_cd_m2))
    tables = json.loads(command("evaluate", "session", "--json"))["tables"]
    result = calibrated.evaluate()
    assert same(json.loads(json.dumps(result.to_dict()["tables"])), tables)
    dataset = result.to_dataset()
    for row in tables["contrasts"]["rows"]:
        found = dataset.sel(pair=row["pair"], contrast=row["target_contrast"])
        for name, key in (("cdp", "cdp"), ("below", "below"), ("above", "above"), ("epsilon", "epsilon")):
            assert same(float(found[name]), row[key])
        assert same([float(found["cdp_low"]), float(found["cdp_high"])], [row["cdp_low"], row["cdp_high"]])
        assert same(float(found["measured_contrast"]), row["camera_contrast"])
        assert same(float(found["meter_contrast"]), row["measured_contrast"])
    for row in tables["luminance"]["rows"]:
        assert same(float(dataset["camera_luminance"].sel(patch=row["patch"])), row["calibrated_cd_m2"])


def test_saved_calibration_gives_the_same_result(calibrated, tmp_path):
    path = calibrated.save(tmp_path / "calibration.json")
    again = labcdp.Session.open(str(example_session())).evaluate(path)
    assert again.to_dataset().equals(calibrated.evaluate().to_dataset())
    with pytest.raises(labcdp.InputError, match="exists"):
        calibrated.save(path)


def test_calibration_serves_pictures_and_frames_of_its_camera(calibrated, tmp_path):
    frame = (
        next((example_session() / "frames").glob("*light*"), None)
        or sorted((example_session() / "frames").iterdir())[-1]
    )
    path = calibrated.save(tmp_path / "calibration.json")
    for calibration in (calibrated.calibration, str(path)):
        image = labcdp.read_image(frame, calibration=calibration)
        assert image.unit == "cd/m^2"
    np.testing.assert_array_equal(
        np.asarray(image), np.asarray(labcdp.read_image(frame, calibration=calibrated.calibration))
    )


def test_objects_show_themselves(calibrated):
    session = calibrated.session
    assert repr(session).startswith("<labcdp.Session example-session: ")
    for one in (session, calibrated, calibrated.evaluate()):
        assert one._repr_html_().startswith("<table>")
        assert repr(one).startswith("<labcdp.")


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("10%",), {}, "contrast is '10%'"),
        ((1.0, 2.0), {}, "epsilon is 2.0"),
        ((), {"pairs": [("a", "b")]}, "pairs need contrasts"),
        ((1.0,), {"pairs": ["ab"]}, "pairs has 'ab'"),
        ((1.0,), {"pairs": [("a", "b")]}, "there is no patch 'a'"),
    ],
)
def test_wrong_arguments_are_refused(calibrated, arguments, options, message):
    with pytest.raises(labcdp.InputError, match=message):
        calibrated.evaluate(*arguments, **options)
