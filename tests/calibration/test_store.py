import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration import fit, load, save
from labcdp.errors import InputError
from labcdp.vignetting import Cos4Vignetting


@pytest.fixture(scope="module")
def calibration(camera, new_reading, setup):
    luminances, exposures_s = np.geomspace(0.5, 2000, 12), (0.001, 0.008, 0.064)
    rng = np.random.default_rng(1)
    observations = [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(luminances) for t in exposures_s]
    observations = [replace(o, vignetting=Cos4Vignetting(0.006, 3.45e-6)) for o in observations]
    readings = {f"P{i}": [new_reading(round(float(v), 2))] for i, v in enumerate(luminances)}
    return fit(observations, [camera.dark(t, rng) for t in exposures_s], readings, setup)


@pytest.fixture
def document(calibration, tmp_path):
    """A saved file's content, and a function that writes it back and loads it."""
    path = tmp_path / "camera.json"
    save(calibration, path)
    content = json.loads(path.read_text())

    def reload():
        path.write_text(json.dumps(content))
        return load(path)

    return content, reload


def test_round_trip(calibration, tmp_path):
    save(calibration, tmp_path / "camera.json")
    assert load(tmp_path / "camera.json") == calibration


@given(
    responsivity=st.floats(1e-6, 1e9),
    low=st.floats(1e-6, 1.0),
    texts=st.lists(st.text(), max_size=3),
    intercept=st.none() | st.floats(-1e6, 1e6),
)
def test_round_trip_of_any_value(calibration, tmp_path_factory, responsivity, low, texts, intercept):
    other = replace(
        calibration,
        responsivity=replace(calibration.responsivity, responsivity_dn_s_cd_m2=responsivity, intercept_dn_s=intercept),
        range_cd_m2=(low, 2.0),
        vignetting=None,
        warnings=tuple(texts),
    )
    path = tmp_path_factory.getbasetemp() / "any.json"
    save(other, path)
    assert load(path) == other


def test_file_names_format_version_and_units(document):
    content, _ = document
    assert (content["format"], content["version"]) == ("labcdp-calibration", 2)
    calibration = content["calibration"]
    assert calibration["responsivity"]["responsivity_dn_s_cd_m2"] == pytest.approx(1200, rel=0.01)
    assert calibration["state"]["camera"]["serial"] == "503363706"
    assert {"range_cd_m2", "exposures_s", "residuals", "lens", "provenance"} <= set(calibration)


def test_reformatting_is_no_change(document, calibration):
    assert document[1]() == calibration


def test_saving_replaces(calibration, tmp_path):
    path = tmp_path / "camera.json"
    path.write_text("old")
    save(calibration, path)
    assert load(path) == calibration
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


def test_missing_folder(calibration, tmp_path):
    with pytest.raises(InputError, match=r"calibration .*camera\.json cannot be written: No such file or directory"):
        save(calibration, tmp_path / "no" / "camera.json")


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"calibration .*camera\.json cannot be read: No such file or directory"):
        load(tmp_path / "camera.json")


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b'{"format": NaN}'])
def test_no_json(tmp_path, content):
    path = tmp_path / "camera.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"calibration .*camera\.json is not valid JSON: "):
        load(path)


@pytest.mark.parametrize("content", ["[]", "3", "{}", '{"format": "labcdp-session"}'])
def test_other_json(tmp_path, content):
    path = tmp_path / "camera.json"
    path.write_text(content)
    with pytest.raises(
        InputError, match=r"camera\.json is not a calibration: its key format is not 'labcdp-calibration'"
    ):
        load(path)


@pytest.mark.parametrize(
    ("version", "remedy"),
    [(0, "calibrate again"), (1, "calibrate again"), (3, "use a newer labcdp"), ("2", "calibrate again")],
)
def test_other_version(document, version, remedy):
    content, reload = document
    content["version"] = version
    with pytest.raises(InputError, match=f"has version {version!r}, this labcdp reads version 2: {remedy}$"):
        reload()


def test_changed_number(document):
    content, reload = document
    content["calibration"]["responsivity"]["responsivity_dn_s_cd_m2"] *= 1.01
    with pytest.raises(
        InputError, match=r"was changed after it was written .*: restore the original, or calibrate again"
    ):
        reload()


def test_missing_key(document):
    content, reload = document
    del content["calibration"]["dark"]["offset_dn"]
    with pytest.raises(InputError, match=r"key dark\.offset_dn: "):
        reload()


@pytest.mark.parametrize(
    ("place", "key", "value", "message"),
    [
        ("responsivity", "random_rel", "small", r"key responsivity\.random_rel: Input should be a valid number"),
        ("responsivity", "responsivity_dn_s_cd_m2", -1.0, "a camera that sees light has a positive one"),
        ("lens", "f_number", 0.0, "f_number of the lens is 0"),
        ("state", "bit_depth", 11.5, r"key state\.bit_depth: "),
        ("provenance", "measured", "yesterday", r"key provenance\.measured: "),
    ],
)
def test_unusable_value(document, place, key, value, message):
    content, reload = document
    content["calibration"][place][key] = value
    with pytest.raises(InputError, match=message):
        reload()


@pytest.mark.parametrize("place", ["responsivity", "meter_scale"])
def test_unknown_key(document, place):
    content, reload = document
    content["calibration"][place]["colour"] = "green"
    with pytest.raises(InputError, match=rf"has an unknown key {place}\.colour: remove it"):
        reload()


def test_unknown_key_in_a_row(document):
    content, reload = document
    content["calibration"]["residuals"][3]["colour"] = "green"
    with pytest.raises(InputError, match=r"has an unknown key residuals\.3\.colour: remove it"):
        reload()


def test_no_content(document):
    content, reload = document
    del content["calibration"]
    with pytest.raises(InputError, match="key calibration: "):
        reload()
