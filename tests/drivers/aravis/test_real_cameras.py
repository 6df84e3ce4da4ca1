"""Cameras whose features differ from those of a Manta, as their makers describe them.

Names, types and ranges are those of the documents named beside each; registers and all that is not said there is the
simulated camera's.
"""

from dataclasses import replace

import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.camera_settings import CameraSetup
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp, features

SWITCH, AUTO = {"switch": True}, {"choices": {"Off": 0, "Continuous": 1, "Once": 2}}
RATE = {"register": "FRAME_PERIOD_US", "unit": "Hz", "period": True}
MANTA = ("Gain", "GainAuto", "BlackLevel", "BlackLevelAuto", "LUTEnable", "Gamma", "AcquisitionFrameRateAbs")
MANTA += ("StreamBytesPerSecond", "ReverseX", "ReverseY")

#: Basler, User's Manual for ace GigE cameras, AW000893, sections 10.1 and 10.2: GainRaw of the acA1300-30gm from 300
#: to 850 in 8 bits, BlackLevelRaw, a switch of the frame rate and of the gamma correction.
ACE = features(
    *MANTA,
    GainSelector={"choices": {"All": 0}},
    GainAuto={"register": 0x114, "value": 1, **AUTO},
    GainRaw={"register": 0x110, "range": [300, 850], "value": 300},
    BlackLevelRaw={"register": "BLACK_LEVEL", "range": [0, 255]},
    GammaEnable={"register": 0x174, "value": 1, **SWITCH},
    Gamma={"register": 0x150, "unit": "", "steps": 100, "range": [0, 4], "value": 45},
    AcquisitionFrameRateEnable={"register": 0x178, **SWITCH},
    AcquisitionFrameRateAbs=RATE | {"range": [0.1, 1000]},
)
#: Point Grey (FLIR), features in a public report of an Aravis user: limits of the automatic gain, switches named
#: ...Enabled, sharpness.
POINT_GREY = features(
    *MANTA,
    GainSelector={"choices": {"All": 0}},
    GainAuto={"register": 0x114, "value": 1, **AUTO},
    Gain={"register": 0x110, "unit": "dB", "steps": 10, "range": [0, 24]},
    AutoGainLowerLimit={"register": 0x180, "unit": "dB", "steps": 10, "range": [0, 24]},
    BlackLevel={"register": "BLACK_LEVEL", "unit": "%", "steps": 10, "range": [0, 10]},
    BlackLevelEnabled={"register": 0x184, "value": 1, **SWITCH},
    Gamma={"register": 0x150, "unit": "", "steps": 100, "range": [0.5, 4], "value": 125},
    Sharpness={"register": 0x170, "range": [0, 4095], "value": 1024},
    AcquisitionFrameRateEnabled={"register": 0x178, **SWITCH},
    AcquisitionFrameRate=RATE | {"range": [1, 1000]},
)
#: Roboception, rc_visard, user's manual, section 8.1: exposure of 66 to 18000 us, gain of 0 to 18 dB, 1 to 25 frames/s,
#: automatic exposure after switching on, and neither black level nor binning nor gamma.
RC_VISARD = features(
    *MANTA,
    *("ExposureTimeAbs", "ExposureMode", "BinningHorizontal", "BinningVertical", "OffsetX", "OffsetXMax", "OffsetY"),
    *("OffsetYMax", "TriggerSelector", "TriggerMode", "TriggerSource", "TriggerActivation", "TriggerSoftware"),
    WidthMax={"register": "SENSOR_WIDTH", "access": "RO"},
    HeightMax={"register": "SENSOR_HEIGHT", "access": "RO"},
    ExposureTime={"register": 0x120, "unit": "us", "steps": 1, "range": [66, 18000], "value": 5000},
    ExposureAuto={"register": 0x14C, "value": 1, **AUTO},
    GainSelector={"choices": {"All": 0}},
    Gain={"register": 0x110, "unit": "dB", "steps": 10, "range": [0, 18]},
    AcquisitionFrameRate=RATE | {"range": [1, 25]},
)


def opened(table, frame_rate_hz=20.0):
    return SimulatedGigECamera(replace(SMALL, features=table, frame_rate_hz=frame_rate_hz), Ramp()), AravisCamera(
        "127.0.0.1"
    )


def test_a_gain_in_steps_is_not_taken_for_decibels(aravis):
    served, driver = opened(ACE)
    with served, driver as camera:
        assert (camera.feature("GainAuto"), camera.feature("GammaEnable"), camera.feature("Gamma")) == (
            "Off",
            False,
            1.0,
        )
        assert camera.configure(exposure_s=0.003, gain_db=0.0).gain_db == 0.0
        with pytest.raises(CameraSettingError, match="its gain not in dB but as GainRaw, a feature to set by name"):
            camera.configure(gain_db=6.0)
        camera.prepare(CameraSetup(black_level=32, frame_rate_hz=30.0, features={"GainRaw": 400}))
        assert (camera.feature("BlackLevelRaw"), camera.feature("AcquisitionFrameRateEnable")) == (32, True)
        assert camera.snap().gain_db == 0.0
        assert camera.not_understood == ()


def test_automatics_are_off_and_what_changes_the_picture_unnoticed_is_listed(aravis):
    served, driver = opened(POINT_GREY)
    with served, driver as camera:
        assert (camera.feature("GainAuto"), camera.feature("Gamma")) == ("Off", 1.0)
        settings = camera.configure(gain_db=12.0, black_level=1.5, frame_rate_hz=40.0)
        assert (settings.gain_db, settings.black_level, settings.frame_rate_hz) == pytest.approx((12.0, 1.5, 40.0))
        assert camera.not_understood == ("AutoGainLowerLimit", "Sharpness")


def test_a_camera_of_few_features_and_narrow_ranges_is_used_as_far_as_it_goes(aravis):
    served, driver = opened(RC_VISARD)
    with served, driver as camera:
        assert camera.feature("ExposureAuto") == "Off"
        assert camera.exposure_range_s == pytest.approx((66e-6, 18e-3))
        for wanted, message in (
            ({"exposure_s": 0.02}, "exposure_s is 0.02 s: the camera takes 6.6e-05 to 0.018 s"),
            ({"gain_db": 20.0}, "gain_db is 20 dB: the camera takes 0 to 18 dB"),
            ({"binning": (2, 2)}, "the camera has no binning"),
            ({"black_level": 8.0}, "the camera's black level cannot be set: ask for 0, not 8"),
        ):
            with pytest.raises(CameraSettingError, match=message):
                camera.configure(**wanted)
        assert camera.configure(exposure_s=0.018, gain_db=18.0).exposure_s == pytest.approx(0.018)
        assert camera.snap().shape == (48, 64)
