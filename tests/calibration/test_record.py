"""Calibration files: round trips of any value, and what is refused of altered files."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.calibration import load, save
from labcdp.calibration.frames.defects import Defect, DefectMap
from labcdp.calibration.record import SavedFile
from labcdp.core.errors import InputError
from labcdp.core.result import warning
from labcdp.core.vignetting import Cos4Vignetting, RadialVignetting

from .conftest import STATE, flat_field, large_dark_library
from .test_verify import CERTIFICATE


def maps(seed=1):
    """All that a file keeps as arrays."""
    reasons = np.zeros(STATE.image_shape, np.uint8)
    reasons[3, 4], reasons[5, 6] = Defect.HOT | Defect.NOISY, Defect.DEAD
    return {"vignetting": flat_field(seed=seed), "defects": DefectMap.of(reasons), "dark_library": large_dark_library()}


@settings(max_examples=25)
@given(
    responsivity=st.floats(1e-6, 1e9),
    texts=st.lists(st.text(), max_size=3),
    certificate=st.sampled_from([None, CERTIFICATE]),
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
    save(calibrated, path, force=True)
    assert load(path) == calibrated
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


def without_number(path):
    """Make a file as labcdp wrote it before calibrations had numbers, meters a drift and patches a U, with its hash."""
    document = json.loads(path.read_text())
    del document["number"], document["calibration"]["meter_scale"]["drift_rel"]
    for row in document["calibration"]["residuals"]:
        for key in ("reading_U_rel", "u_rel", "U_rel", "dof"):
            del row[key]
    content = {"kind": document["kind"], "calibration": document["calibration"]}
    if document["arrays"] is not None:
        content["arrays"] = hashlib.sha256(document["arrays"].encode()).hexdigest()
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    document["sha256"] = hashlib.sha256(canonical.encode()).hexdigest()
    path.write_text(json.dumps(document))
    return document["sha256"]


@pytest.mark.parametrize("full", [False, True])
def test_the_number_is_that_of_the_content_and_old_files_have_one(calibrated, tmp_path, full):
    one = replace(calibrated, **maps()) if full else calibrated
    other = replace(one, responsivity=replace(one.responsivity, responsivity_dn_s_cd_m2=2350.0))
    paths = [tmp_path / f"{name}.json" for name in ("one", "other", "again")]
    save(one, paths[0])
    save(other, paths[1])
    save(load(paths[0]), paths[2])
    numbers = [SavedFile.of(path).number for path in paths]
    assert numbers == [json.loads(path.read_text())["number"] for path in paths]
    assert numbers[0] == numbers[2] != numbers[1]
    assert SavedFile.of(paths[0]).sha256 == hashlib.sha256(paths[0].read_bytes()).hexdigest()
    # Spaces change the hash of the file, not the number.
    paths[2].write_text(json.dumps(json.loads(paths[0].read_text())))
    assert SavedFile.of(paths[2]).number == numbers[0]
    assert SavedFile.of(paths[2]).sha256 != SavedFile.of(paths[0]).sha256
    digest = without_number(paths[0])
    unknown = {"reading_U_rel": None, "u_rel": None, "U_rel": None, "dof": None}
    assert load(paths[0]) == replace(one, residuals=tuple(replace(row, **unknown) for row in one.residuals))
    assert SavedFile.of(paths[0]).number.replace("-", "") == digest[:12]


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("format",), "labcdp-session", "is not a calibration: its key format is not 'labcdp-calibration'"),
        (("version",), 4, "has version 4, this labcdp reads version 6: .*calibrate again$"),
        (("calibration", "responsivity", "responsivity_dn_s_cd_m2"), 1201.0, "was changed after it was written"),
        (("calibration", "responsivity", "responsivity_dn_s_cd_m2"), -1.0, "a camera that sees light has a positive"),
        (("calibration", "meter_scale", "limit"), 0.02, r"key meter_scale\.limit: Unexpected keyword argument"),
        (("number",), "0000-0000-0000", "was changed after it was written"),
        (("arrays",), "%", "key arrays"),
        (("arrays",), "of another", "was changed after it was written"),
    ],
)
def test_altered_values_and_arrays_are_refused(calibrated, tmp_path, place, value, message):
    path, documents = tmp_path / "camera.json", []
    for seed in (7, 1):
        save(replace(calibrated, **maps(seed)), path, force=True)
        documents.append(json.loads(path.read_text()))
    inner = documents[1]
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = documents[0]["arrays"] if value == "of another" else value
    path.write_text(json.dumps(documents[1]))
    with pytest.raises(InputError, match=message):
        load(path)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"noise": {"k_dn_per_e": -0.4}}, "k_dn_per_e"),
        ({"noise": {"k_dn_per_e": 1e300}}, "k_dn_per_e"),
        ({"noise": {"prnu_rel": -0.01}}, "prnu_rel"),
        ({"state": {"image_shape": [-5, 64]}}, "image_shape"),
        ({"state": {"image_shape": [10**18, 64]}}, "image_shape"),
        ({"state": {"bit_depth": 0}}, "bit_depth"),
        ({"dark": {"noise_dn": -1.0}}, "noise_dn"),
        ({"dark": {"covariance": [[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]]}}, "variances in covariance"),
        ({"responsivity": {"random_rel": -0.01}}, "random_rel"),
        ({"responsivity": {"responsivity_dn_s_cd_m2": -5.0}}, "responsivity_dn_s_cd_m2"),
        ({"responsivity": {"responsivity_dn_s_cd_m2": 1e-300}}, "responsivity_dn_s_cd_m2"),
        ({"responsivity": {"chi_squared": 1e300}}, "chi_squared"),
        ({"fit_errors": [{"source": "fit", "net_dn": [1.0], "relative": [-1e300]}]}, r"fit_errors\.0\.relative\.0"),
        ({"meter_scale": {"limits_rel": -0.02}}, "limits_rel"),
        ({"exposures_s": [-0.01]}, "exposures_s"),
    ],
)
def test_what_no_camera_has_is_refused_before_the_hash_is_compared(calibrated, tmp_path, changes, named):
    path = tmp_path / "c.json"
    save(calibrated, path)
    document = json.loads(path.read_text())
    for key, values in changes.items():
        if isinstance(values, dict):
            document["calibration"][key] |= values
        else:
            document["calibration"][key] = values
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=named):
        load(path)
