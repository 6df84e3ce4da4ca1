"""What multiplies the DN is read in dB, or named."""

import pytest

from labcdp.drivers.aravis.known_state import not_understood
from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.simulated.genicam import feature

from ..conftest import features, opened

#: 12 dB, or a factor or steps, in the register of the simulated camera.
GAIN = {**feature("Gain"), "value": 120}
CAMERAS = {
    "Gain": ({"Gain": GAIN}, 12.0, ()),
    "GainAbs": ({"GainAbs": GAIN}, 12.0, ()),
    "GainAbs without a unit": ({"GainAbs": {**GAIN, "unit": ""}}, 0.0, ("GainAbs",)),
    "Gain in percent": ({"Gain": {**GAIN, "unit": "%"}}, 0.0, ("Gain",)),
    "Gain as a factor": ({"Gain": {**GAIN, "unit": "", "range": [1, 26]}}, 0.0, ("Gain",)),
    "GainRaw": ({"GainRaw": {"register": 0x110, "range": [0, 500], "value": 120}}, 0.0, ("GainRaw",)),
    "a second gain": (
        {"Gain": GAIN, "DigitalGain": {"register": 0x1D0, "range": [0, 9], "value": 2}}, 12.0, ("DigitalGain",)
    ),
    "several to select": (
        {"Gain": GAIN, "GainSelector": {"register": 0x1D0, "choices": {"AnalogAll": 0, "DigitalAll": 1}}},
        12.0, ("GainSelector",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CAMERAS)
def test_a_gain_is_read_in_db_or_not_understood(aravis, name):
    added, gain_db, listed = CAMERAS[name]
    table = features("Gain", "GainAuto")
    table |= {"AnalogControl": {**table["AnalogControl"], **added}}
    with opened(vendor="Acme", features=table) as camera:
        assert camera.snap().gain_db == gain_db
        assert camera.not_understood == listed
        if gain_db == 0:
            with pytest.raises(CameraSettingError, match=f"its gain not in dB but as {listed[0]}"):
                camera.configure(gain_db=6.0)


def test_what_changes_dn_is_listed_unless_it_is_switched_off():
    """Names of the SFNC and of vendors."""
    changing = (
        *("GainFactor", "BalanceRatio", "BalanceRatioRaw", "Sharpness", "LUTValue", "GammaMode", "PixelCorrection"),
        *("DefectCorrectStaticEnable", "FlatFieldCorrectionEnable", "NoiseReduction", "Contrast", "Brightness"),
        *("MultiExposureMode", "OffsetRaw", "SensorDigitizationTaps", "AdcBitDepth", "CorrectionMode"),
    )
    assert not_understood(changing) == changing
    harmless = ("GammaEnable", "GammaMode", "LUTEnable", "LUTValue", "OffsetX", "PixelFormat", "GainAutoMax")
    assert not_understood(harmless) == ()
