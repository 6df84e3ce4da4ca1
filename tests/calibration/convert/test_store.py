import json

import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.calibration.sensor.defects import Defect, DefectMap
from labcdp.core.errors import InputError
from labcdp.core.vignetting import Cos4Vignetting, FlatField, RadialVignetting, middle_of

SHAPE = (48, 64)


def flat(seed=1):
    relative = 1 + 0.01 * np.random.default_rng(seed).normal(size=SHAPE)
    return FlatField(relative / relative[middle_of(SHAPE)].mean(), 0.001, 0.01, 8)


def defects():
    reasons = np.zeros(SHAPE, np.uint8)
    reasons[3, 4], reasons[5, 6] = Defect.HOT | Defect.NOISY, Defect.DEAD
    return DefectMap.of(reasons)


def library():
    rng = np.random.default_rng(2)
    covariance = ((0.1, 0.0), (0.0, 0.2))
    return DarkLibrary(rng.normal(size=SHAPE), rng.normal(size=SHAPE), covariance, covariance, 30.0, None, 20)


@pytest.fixture
def full(make_calibration):
    return make_calibration(vignetting=flat(), defects=defects(), dark_library=library())


@pytest.mark.parametrize(
    "vignetting", [None, Cos4Vignetting(0.006, 3.45e-6), RadialVignetting(-0.3, 0.1, 0.0, (30.0, 20.0)), flat()]
)
def test_round_trip_of_every_vignetting(make_calibration, tmp_path, vignetting):
    calibration = make_calibration(vignetting=vignetting)
    save(calibration, tmp_path / "c.json")
    loaded = load(tmp_path / "c.json")
    assert loaded == calibration
    assert type(loaded.vignetting) is type(vignetting)


def test_round_trip_with_all_arrays(full, tmp_path):
    save(full, tmp_path / "camera.json")
    loaded = load(tmp_path / "camera.json")
    assert loaded == full
    assert (loaded.vignetting.relative == full.vignetting.relative).all()
    assert not loaded.vignetting.relative.flags.writeable
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


def test_saving_again_replaces_values_and_arrays_together(full, make_calibration, tmp_path):
    path, other = tmp_path / "camera.json", make_calibration(vignetting=flat(seed=7))
    save(full, path)
    with pytest.raises(InputError, match=r"camera\.json exists"):
        save(other, path)
    assert load(path) == full
    save(other, path, force=True)
    assert load(path) == other
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ("", "key arrays: "),
        ("%", "key arrays: it is no Base64 text"),
        (3, "key arrays: it is no Base64 text"),
        (None, "key vignetting"),
        ("of another", "was changed after it was written"),
    ],
)
def test_altered_arrays(full, make_calibration, tmp_path, arrays, message):
    path = tmp_path / "camera.json"
    save(make_calibration(vignetting=flat(seed=7), defects=defects(), dark_library=library()), path)
    other = json.loads(path.read_text())["arrays"]
    save(full, path, force=True)
    document = json.loads(path.read_text())
    document["arrays"] = other if arrays == "of another" else arrays
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=message):
        load(path)
