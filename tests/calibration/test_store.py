import json
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration import fit, load, save
from labcdp.core.errors import InputError
from labcdp.core.result import warning
from labcdp.core.vignetting import Cos4Vignetting
from labcdp.session import MeterCertificate

NAMES = st.text("abc 1-ü", min_size=1).map(str.strip).filter(bool)
CERTIFICATES = st.builds(
    MeterCertificate,
    number=NAMES,
    laboratory=NAMES,
    date=st.dates(date(1990, 1, 1), date(2020, 1, 1)),
    due_date=st.none() | st.dates(date(2020, 1, 2), date(2100, 1, 1)),
    correction=st.floats(0.5, 2.0),
    expanded_uncertainty_rel=st.floats(1e-6, 1.0),
    degrees_of_freedom=st.none() | st.floats(1.0, 1e6),
    conditions=st.text(),
)


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


@given(
    responsivity=st.floats(1e-6, 1e9),
    low=st.floats(1e-6, 1.0),
    texts=st.lists(st.text(), max_size=3),
    intercept=st.none() | st.floats(-1e6, 1e6),
    certificate=st.none() | CERTIFICATES,
)
def test_round_trip_of_any_value(calibration, tmp_path_factory, responsivity, low, texts, intercept, certificate):
    other = replace(
        calibration,
        responsivity=replace(calibration.responsivity, responsivity_dn_s_cd_m2=responsivity, intercept_dn_s=intercept),
        range_cd_m2=(low, 2.0),
        vignetting=None,
        meter_scale=replace(calibration.meter_scale, certificate=certificate, f1_prime=certificate and 0.08),
        findings=tuple(warning("readings-scatter", text, note=text, values=[1.5, 2.0]) for text in texts),
    )
    path = tmp_path_factory.getbasetemp() / "any.json"
    save(other, path, force=True)
    assert load(path) == other


def test_saving_replaces_with_force_only(calibration, tmp_path):
    path = tmp_path / "camera.json"
    path.write_text("old")
    with pytest.raises(InputError, match=r"camera\.json exists"):
        save(calibration, path)
    save(calibration, path, force=True)
    assert load(path) == calibration
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


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
    [(0, "calibrate again"), (4, "calibrate again"), (6, "use a newer labcdp"), ("5", "calibrate again")],
)
def test_other_version(document, version, remedy):
    content, reload = document
    content["version"] = version
    with pytest.raises(InputError, match=f"has version {version!r}, this labcdp reads version 5: {remedy}$"):
        reload()


def test_changed_number(document):
    content, reload = document
    content["calibration"]["responsivity"]["responsivity_dn_s_cd_m2"] *= 1.01
    with pytest.raises(
        InputError, match=r"was changed after it was written .*: restore the original, or calibrate again"
    ):
        reload()


@pytest.mark.parametrize(
    ("place", "key", "value", "message"),
    [
        ("responsivity", "random_rel", "small", r"key responsivity\.random_rel: Input should be a valid number"),
        ("responsivity", "responsivity_dn_s_cd_m2", -1.0, "a camera that sees light has a positive one"),
        ("lens", "f_number", 0.0, "f_number of the lens is 0"),
        ("state", "bit_depth", 11.5, r"key state\.bit_depth: "),
        ("provenance", "measured", "yesterday", r"key provenance\.measured: "),
        ("meter_scale", "limit", 0.02, r"key meter_scale\.limit: Unexpected keyword argument"),
    ],
)
def test_unusable_value(document, place, key, value, message):
    content, reload = document
    content["calibration"][place][key] = value
    with pytest.raises(InputError, match=message):
        reload()
