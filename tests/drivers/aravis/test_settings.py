import tomllib
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from labcdp.core.frame import Readout
from labcdp.drivers.camera import CameraSettingError, FrameTimeoutError
from labcdp.drivers.camera_settings import FREE_RUN, SOFTWARE_TRIGGER, Region, Trigger

from ..conftest import features, opened


@pytest.mark.parametrize("camera", ["prosilica", "sfnc"], indirect=True)
def test_all_settings_at_once_are_applied_and_reported(camera):
    wanted = {"exposure_s": 0.002, "gain_db": 3.5, "pixel_format": "Mono8", "region": Region(4, 6, 16, 12)}
    wanted |= {"binning": (2, 2), "black_level": 20, "frame_rate_hz": 40, "trigger": Trigger("Line1", "FallingEdge")}
    settings = camera.configure(**wanted)
    assert settings == camera.settings
    applied = {name: getattr(settings, name) for name in wanted}
    assert applied == wanted | {"frame_rate_hz": pytest.approx(40)}


def test_region_binning_mirror_and_black_level_reach_the_pixels_and_the_readout(camera):
    whole = camera.snap()
    camera.configure(region=Region(10, 20, 30, 8))
    part = camera.snap()
    np.testing.assert_array_equal(part.dn, whole.dn[20:28, 10:40])
    assert (part.readout, part.readout.sensor_size) == (Readout(10, 20), (64, 48))
    assert whole.dn[part.readout.window_in(part.shape, whole.readout, whole.shape)].shape == part.shape
    # Binning alone shows the whole sensor.
    assert astuple(camera.configure(binning=(2, 4)).region) == (0, 0, 32, 12)
    camera.configure(region=Region(3, 1, 16, 8), black_level=27)
    camera.set_feature("ReverseX", True)
    binned = camera.snap()
    assert binned.readout == Readout(3, 1, binning=(2, 4), mirrored=(True, False))
    # Columns 6 and 7 of the ramp average to 6.5, rounded up; black level raised from 7 to 27.
    np.testing.assert_array_equal(binned.dn, np.tile(np.arange(3, 19)[::-1] * 2 + 1 + 20, (8, 1)))


def test_what_the_camera_does_not_take_is_refused_and_nothing_changed(camera):
    before = camera.configure(exposure_s=0.004, region=Region(2, 4, 32, 16), binning=(1, 2))
    for wrong in (
        *({"region": region} for region in (Region(0, 0, 65, 48), Region(60, 0, 8, 8), Region(0, -1, 8, 8))),
        *({"binning": (9, 1)}, {"frame_rate_hz": 5000}, {"trigger": Trigger("Line7")}, {"exposure": 0.01}),
    ):
        with pytest.raises(CameraSettingError):
            camera.configure(**({"exposure_s": 0.008, "pixel_format": "Mono8"} | wrong))
        assert camera.settings == before, wrong


def test_a_software_trigger_is_sent_for_each_frame_and_silence_of_a_line_is_named(camera):
    camera.configure(trigger=SOFTWARE_TRIGGER, exposure_s=0.3)
    frames = list(camera.grab(3))
    assert np.diff([frame.frame_id for frame in frames]).tolist() == [1, 1]
    # Each begins with its trigger, and is not there sooner than its exposure has passed.
    assert (frames[-1].timestamp - frames[0].timestamp).total_seconds() >= 2 * 0.29
    camera.configure(trigger=Trigger("Line1"), exposure_s=0.001)
    silence = (
        r"no frame came from .* within 0\.2 s, although it answers: it waits for an edge on Line1; check that line"
    )
    with pytest.raises(FrameTimeoutError, match=silence):
        camera.snap(timeout_s=0.2)
    camera.configure(trigger=FREE_RUN)
    assert len(list(camera.grab(3))) == 3


def test_features_are_read_and_written_by_name_in_their_type(camera):
    values = [camera.feature(name) for name in ("DeviceTemperature", "SensorWidth", "PixelFormat", "ReverseX")]
    assert [(type(value), value) for value in values] == [(float, 31.5), (int, 64), (str, "Mono12"), (bool, False)]
    assert camera.set_feature("ExposureTimeAbs", 1234) == 1234.0
    assert camera.settings.exposure_s == pytest.approx(1234e-6)
    assert camera.set_feature("PixelFormat", "Mono8") == "Mono8"
    assert camera.set_feature("Height", 24) == 24
    assert camera.snap().shape == (24, 64)


def test_wrong_values_and_names_are_refused(camera):
    before = camera.features()
    for name, value in (
        *(("ExposureTimeAbs", 1e9), ("ExposureTimeAbs", True), ("Width", 8.0), ("PixelFormat", "RGB8")),
        *(("DeviceTemperature", 20.0), ("ExposureTime", 5.0)),
    ):
        with pytest.raises(CameraSettingError, match=name):
            camera.set_feature(name, value)
        assert camera.features() == before, name


# Cameras whose features are those of real ones; see cameras.toml


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
