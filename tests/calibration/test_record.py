"""Calibration files: round trips of any value, and what is refused of altered files."""

import json
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.calibration import load, save
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.calibration.sensor.defects import Defect, DefectMap
from labcdp.core.errors import InputError
from labcdp.core.result import warning
from labcdp.core.vignetting import Cos4Vignetting, FlatField, RadialVignetting, middle_of
from labcdp.session import MeterCertificate

SHAPE = (48, 64)
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


def flat(seed=1):
    relative = 1 + 0.01 * np.random.default_rng(seed).normal(size=SHAPE)
    return FlatField(relative / relative[middle_of(SHAPE)].mean(), 0.001, 0.01, 8)


def maps(seed=1):
    """All that a file keeps as arrays."""
    reasons, rng, covariance = np.zeros(SHAPE, np.uint8), np.random.default_rng(2), ((0.1, 0.0), (0.0, 0.2))
    reasons[3, 4], reasons[5, 6] = Defect.HOT | Defect.NOISY, Defect.DEAD
    library = DarkLibrary(rng.normal(size=SHAPE), rng.normal(size=SHAPE), covariance, covariance, 30.0, None, 20)
    return {"vignetting": flat(seed), "defects": DefectMap.of(reasons), "dark_library": library}


@settings(max_examples=25)
@given(
    responsivity=st.floats(1e-6, 1e9),
    texts=st.lists(st.text(), max_size=3),
    certificate=st.none() | CERTIFICATES,
    vignetting=st.sampled_from([None, Cos4Vignetting(0.006, 3.45e-6), RadialVignetting(-0.3, 0.1, 0.0, (30.0, 20.0))]),
)
def test_round_trip_of_any_value(calibrated, tmp_path_factory, responsivity, texts, certificate, vignetting):
    other = replace(
        calibrated,
        responsivity=replace(calibrated.responsivity, responsivity_dn_s_cd_m2=responsivity, intercept_dn_s=None),
        vignetting=vignetting,
        meter_scale=replace(calibrated.meter_scale, certificate=certificate, f1_prime=certificate and 0.08),
        findings=tuple(warning("readings-scatter", text, note=text, values=[1.5, 2.0]) for text in texts),
    )
    path = tmp_path_factory.getbasetemp() / "any.json"
    save(other, path, force=True)
    assert load(path) == other


def test_saving_again_replaces_values_and_arrays_together_with_force_only(calibrated, tmp_path):
    path, full = tmp_path / "camera.json", replace(calibrated, **maps())
    save(full, path)
    with pytest.raises(InputError, match=r"camera\.json exists"):
        save(calibrated, path)
    loaded = load(path)
    assert loaded == full
    assert (loaded.vignetting.relative == full.vignetting.relative).all()
    assert not loaded.vignetting.relative.flags.writeable
    save(calibrated, path, force=True)
    assert load(path) == calibrated
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ((), "[]", "is not a calibration: its key format is not 'labcdp-calibration'"),
        (("format",), "labcdp-session", "is not a calibration: its key format is not 'labcdp-calibration'"),
        (("version",), 4, "has version 4, this labcdp reads version 5: .*calibrate again$"),
        (("version",), 6, "has version 6, this labcdp reads version 5: .*newer labcdp$"),
        (("calibration", "responsivity", "responsivity_dn_s_cd_m2"), 1201.0, "was changed after it was written"),
        (("calibration", "responsivity", "responsivity_dn_s_cd_m2"), -1.0, "a camera that sees light has a positive"),
        (("calibration", "responsivity", "random_rel"), "a", r"key responsivity\.random_rel: Input should be a valid"),
        (("calibration", "lens", "f_number"), 0.0, "f_number of the lens is 0"),
        (("calibration", "provenance", "measured"), "yesterday", r"key provenance\.measured: "),
        (("calibration", "meter_scale", "limit"), 0.02, r"key meter_scale\.limit: Unexpected keyword argument"),
    ],
)
def test_altered_values(calibrated, tmp_path, place, value, message):
    path = tmp_path / "camera.json"
    save(calibrated, path)
    content = inner = json.loads(path.read_text())
    for key in place[:-1]:
        inner = inner[key]
    if place:
        inner[place[-1]] = value
    path.write_text(json.dumps(content) if place else value)
    with pytest.raises(InputError, match=message):
        load(path)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ("%", "key arrays: it is no Base64 text"),
        (3, "key arrays: it is no Base64 text"),
        (None, "key vignetting"),
        ("of another", "was changed after it was written"),
    ],
)
def test_altered_arrays(calibrated, tmp_path, arrays, message):
    path, documents = tmp_path / "camera.json", []
    for seed in (7, 1):
        save(replace(calibrated, **maps(seed)), path, force=True)
        documents.append(json.loads(path.read_text()))
    path.write_text(json.dumps(documents[1] | {"arrays": documents[0]["arrays"] if arrays == "of another" else arrays}))
    with pytest.raises(InputError, match=message):
        load(path)
