"""Cameras whose features are those of real ones; see cameras.toml."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.camera_settings import FREE_RUN, SOFTWARE_TRIGGER, Region

from ..conftest import features, opened

CAMERAS = tomllib.loads(Path(__file__).with_name("cameras.toml").read_text(encoding="utf-8"))["camera"]


@pytest.fixture(params=CAMERAS, ids=lambda camera: camera["name"])
def facts(aravis, request):
    return request.param


@pytest.fixture
def camera(facts):
    """The driver of the camera, which sends with 20 frames/s after it was switched on."""
    added = facts["add"]
    table = features(*facts["without"], *(name for category in added.values() for name in category))
    table |= {category: table.get(category, {}) | of_category for category, of_category in added.items()}
    with opened(vendor=facts["vendor"], model=facts["model"], features=table, frame_rate_hz=20.0) as camera:
        yield camera


def test_a_real_camera_is_opened_read_set_and_grabbed_from(camera, facts):
    values = camera.features()
    found = facts["found"]
    # A gamma that is switched off may be out of reach.
    assert {name: values.get(name, found[name]) for name in found} == found
    assert {one.name for one in camera.describe_features()} == values.keys()
    without_value = {"ChunkExposureTime", "ChunkTimestamp", "EventExposureEnd", "Hue", "DecimationHorizontal"}
    assert not values.keys() & without_value
    assert list(camera.not_understood) == facts["not_understood"]
    assert camera.settings.frame_rate_hz == pytest.approx(facts.get("frame_rate_hz", 20.0))
    assert camera.temperature_c == facts.get("temperature_c")
    settings = camera.configure(**facts["settings"])
    assert {name: getattr(settings, name) for name in facts["settings"]} == pytest.approx(facts["settings"], rel=1e-4)
    frame = camera.snap()
    assert (frame.shape, frame.temperature_c) == ((48, 64), facts.get("temperature_c"))
    assert (frame.exposure_s, frame.gain_db) == pytest.approx((settings.exposure_s, settings.gain_db))


#: Of each setting that some camera refuses.
WRONG = {"decimation": 2, "gain_db": 40.0, "black_level": -1.0, "exposure_s": 40.0}


def test_what_it_does_not_take_is_refused_and_changes_nothing(camera, facts):
    before = camera.configure(**facts["settings"])
    for name, message in facts["refused"].items():
        with pytest.raises(CameraSettingError, match=message):
            camera.configure(**{name: WRONG[name]})
        assert camera.settings == before


@pytest.mark.parametrize("facts", [one for one in CAMERAS if one["name"] != "rc_visard"], ids=lambda one: one["name"])
def test_triggers_and_regions_of_a_real_camera(camera):
    camera.configure(trigger=SOFTWARE_TRIGGER, region=Region(8, 4, 32, 16))
    assert [frame.shape for frame in camera.grab(2)] == [(16, 32)] * 2
    assert camera.configure(trigger=FREE_RUN).trigger == FREE_RUN


@pytest.mark.parametrize("facts", [one for one in CAMERAS if one["name"] == "Blackfly S"], ids=lambda one: one["name"])
def test_exposure_and_frame_rate_that_limit_each_other_are_set_at_once(camera):
    for exposure_s, frame_rate_hz in ((0.1, 5.0), (0.002, 200.0)):
        settings = camera.configure(exposure_s=exposure_s, frame_rate_hz=frame_rate_hz)
        assert (settings.exposure_s, settings.frame_rate_hz) == pytest.approx((exposure_s, frame_rate_hz), rel=1e-3)
    # So fast ones are taken several at once.
    ids = []
    for frame in camera.grab(50, on_refused=lambda error: ids.append(error.frame_id)):
        ids.append(frame.frame_id)
    assert all(step % 65535 == 1 for step in np.diff(ids))
