"""GenICam description of the simulated camera: its registers and the features over them.

Features have the names of an Allied Vision Manta (``ExposureTimeAbs``, ``StreamBytesPerSecond``) or those of the
Standard Features Naming Convention (SFNC 2); most register addresses are those that Aravis' GigE Vision simulator
acts upon.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from textwrap import indent
from typing import Literal

from ....core.pixel_format import PixelFormat
from .genicam_xml import (
    command,
    enumeration,
    fixed_enumeration,
    formula,
    integer,
    low_half,
    number,
    rate,
    string,
    switch,
)

#: Naming convention of the features: Allied Vision's (formerly Prosilica), or that of the standard.
Naming = Literal["prosilica", "sfnc"]


class Address(IntEnum):
    """Register addresses of the simulated camera."""

    VENDOR = 0x48
    MODEL = 0x68
    VERSION = 0x88
    MANUFACTURER_INFO = 0xA8
    SERIAL = 0xD8
    WIDTH = 0x100
    HEIGHT = 0x104
    BINNING_HORIZONTAL = 0x108
    BINNING_VERTICAL = 0x10C
    GAIN = 0x110
    GAIN_AUTO = 0x114
    SENSOR_HEIGHT = 0x118
    SENSOR_WIDTH = 0x11C
    EXPOSURE_US = 0x120
    ACQUISITION = 0x124
    PIXEL_FORMAT = 0x128
    ACQUISITION_MODE = 0x12C
    OFFSET_X = 0x130
    OFFSET_Y = 0x134
    FRAME_PERIOD_US = 0x138
    BLACK_LEVEL = 0x13C
    TEMPERATURE = 0x140
    BYTES_PER_SECOND = 0x144
    THROUGHPUT_LIMIT_MODE = 0x148
    EXPOSURE_AUTO = 0x14C
    GAMMA = 0x150
    EXPOSURE_MODE = 0x154
    BLACK_LEVEL_AUTO = 0x158
    LUT_ENABLE = 0x15C
    REVERSE_X = 0x160
    REVERSE_Y = 0x164
    TRIGGER_MODE = 0x300
    TRIGGER_SOURCE = 0x304
    TRIGGER_ACTIVATION = 0x308
    TRIGGER_SOFTWARE = 0x30C
    TICK_FREQUENCY_HIGH = 0x93C
    TICK_FREQUENCY_LOW = 0x940
    CONTROL_PRIVILEGE = 0xA00
    STREAM_PORT = 0xD00
    PACKET_SIZE = 0xD04
    PACKET_DELAY = 0xD08


#: Steps of the gain register per dB, of the temperature register per degree Celsius, of black level per DN.
GAIN_STEPS_PER_DB = 10
TEMPERATURE_STEPS_PER_C = 10
BLACK_LEVEL_STEPS_PER_DN = 1
GAMMA_STEPS_PER_UNIT = 100

#: Exposure and gain ranges. Data sheet of the Manta G-505 (recall): 21 us to 60 s, 0 to 26 dB.
EXPOSURE_RANGE_US = (21, 60_000_000)
GAIN_RANGE_DB = (0, 26)
FRAME_PERIOD_RANGE_US = (1_000, 60_000_000)
BLACK_LEVEL_RANGE_DN = (0, 255)
BINNING_RANGE = (1, 4)

#: Share of a gigabit link in bytes per second that the stream may take; kept, but the simulator sends at will.
BYTES_PER_SECOND_RANGE = (1_000_000, 124_000_000)

#: The camera's timestamps are nanoseconds.
TICK_FREQUENCY_HZ = 1_000_000_000

_LEVELS = {"RisingEdge": 0, "FallingEdge": 1, "AnyEdge": 2, "LevelHigh": 3, "LevelLow": 4}
_AUTO = {"Off": 0, "Continuous": 1}


def description(vendor: str, model: str, formats: Sequence[PixelFormat], naming: Naming = "prosilica") -> str:
    """Write the GenICam register description (GenApi schema 1.0) of the camera.

    Parameters
    ----------
    vendor, model : str
        As shown to the user; blanks are left out of the schema's identifiers.
    formats : sequence of PixelFormat
        Pixel formats to offer.
    naming : {'prosilica', 'sfnc'}
        Whose names the features have.

    Returns
    -------
    str
        XML.
    """
    categories = {
        "DeviceControl": _device(),
        "ImageFormatControl": _image_format(formats),
        "AcquisitionControl": _acquisition(naming),
        "AnalogControl": _analog(),
        "TransportLayerControl": _transport(naming),
    }
    root = "\n".join(f"<pFeature>{name}</pFeature>" for name in categories)
    parts = [f'<Category Name="Root" NameSpace="Standard">\n{root}\n</Category>']
    for category, features in categories.items():
        members = "\n".join(f"<pFeature>{name}</pFeature>" for name in features)
        parts.append(f'<Category Name="{category}" NameSpace="Standard">\n{members}\n</Category>')
        parts.extend(features.values())
    parts.append('<Port Name="Device" NameSpace="Standard"/>')
    body = indent("\n".join(parts), "  ")
    return f"""<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="{model.replace(" ", "")}" VendorName="{vendor.replace(" ", "")}"
  StandardNameSpace="None" SchemaMajorVersion="1" SchemaMinorVersion="0" SchemaSubMinorVersion="1"
  MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ProductGuid="0" VersionGuid="0"
  xmlns="http://www.genicam.org/GenApi/Version_1_0"
  xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_0 GenApiSchema.xsd">
{body}
</RegisterDescription>
"""


def _limits(low: float, high: float) -> str:
    return f"<Min>{low}</Min><Max>{high}</Max>"


def _device() -> dict[str, str]:
    return {
        "DeviceVendorName": string("DeviceVendorName", Address.VENDOR, 32),
        "DeviceModelName": string("DeviceModelName", Address.MODEL, 32),
        "DeviceVersion": string("DeviceVersion", Address.VERSION, 32),
        "DeviceManufacturerInfo": string("DeviceManufacturerInfo", Address.MANUFACTURER_INFO, 48),
        "DeviceID": string("DeviceID", Address.SERIAL, 16),
        "DeviceTemperature": number(
            "DeviceTemperature", Address.TEMPERATURE, "C", TEMPERATURE_STEPS_PER_C, (-40, 125), "RO"
        ),
    }


def _image_format(formats: Sequence[PixelFormat]) -> dict[str, str]:
    size = "<Min>1</Min><pMax>{}</pMax><Inc>1</Inc>"
    offset = "<Min>0</Min><pMax>{}</pMax><Inc>1</Inc>"
    binning = _limits(*BINNING_RANGE) + "<Inc>1</Inc>"
    return {
        "SensorWidth": integer("SensorWidth", Address.SENSOR_WIDTH, access="RO"),
        "SensorHeight": integer("SensorHeight", Address.SENSOR_HEIGHT, access="RO"),
        "BinningHorizontal": integer("BinningHorizontal", Address.BINNING_HORIZONTAL, binning),
        "BinningHorizontalMode": fixed_enumeration("BinningHorizontalMode", "Average"),
        "BinningVertical": integer("BinningVertical", Address.BINNING_VERTICAL, binning),
        "BinningVerticalMode": fixed_enumeration("BinningVerticalMode", "Average"),
        "WidthMax": formula("WidthMax", "SENSOR / BINNING", SENSOR="SensorWidth", BINNING="BinningHorizontal"),
        "HeightMax": formula("HeightMax", "SENSOR / BINNING", SENSOR="SensorHeight", BINNING="BinningVertical"),
        "Width": integer("Width", Address.WIDTH, size.format("WidthMax")),
        "Height": integer("Height", Address.HEIGHT, size.format("HeightMax")),
        "OffsetX": integer("OffsetX", Address.OFFSET_X, offset.format("OffsetXMax"))
        + formula("OffsetXMax", "MAX - SIZE", MAX="WidthMax", SIZE="Width"),
        "OffsetY": integer("OffsetY", Address.OFFSET_Y, offset.format("OffsetYMax"))
        + formula("OffsetYMax", "MAX - SIZE", MAX="HeightMax", SIZE="Height"),
        "ReverseX": switch("ReverseX", Address.REVERSE_X),
        "ReverseY": switch("ReverseY", Address.REVERSE_Y),
        "PixelFormat": enumeration("PixelFormat", Address.PIXEL_FORMAT, {form.name: form.code for form in formats}),
    }


def _acquisition(naming: Naming) -> dict[str, str]:
    exposure, frame_rate = {
        "prosilica": ("ExposureTimeAbs", "AcquisitionFrameRateAbs"),
        "sfnc": ("ExposureTime", "AcquisitionFrameRate"),
    }[naming]
    return {
        "AcquisitionMode": enumeration("AcquisitionMode", Address.ACQUISITION_MODE, {"Continuous": 1}),
        "AcquisitionStart": command("AcquisitionStart", Address.ACQUISITION, 1),
        "AcquisitionStop": command("AcquisitionStop", Address.ACQUISITION, 0),
        frame_rate: rate(frame_rate, Address.FRAME_PERIOD_US, FRAME_PERIOD_RANGE_US),
        exposure: number(exposure, Address.EXPOSURE_US, "us", 1, EXPOSURE_RANGE_US),
        "ExposureAuto": enumeration("ExposureAuto", Address.EXPOSURE_AUTO, _AUTO),
        "ExposureMode": enumeration("ExposureMode", Address.EXPOSURE_MODE, {"Timed": 0, "TriggerWidth": 1}),
        "TriggerSelector": fixed_enumeration("TriggerSelector", "FrameStart"),
        "TriggerMode": enumeration("TriggerMode", Address.TRIGGER_MODE, {"Off": 0, "On": 1}),
        "TriggerSource": enumeration("TriggerSource", Address.TRIGGER_SOURCE, {"Line1": 0, "Software": 1}),
        "TriggerActivation": enumeration("TriggerActivation", Address.TRIGGER_ACTIVATION, _LEVELS),
        "TriggerSoftware": command("TriggerSoftware", Address.TRIGGER_SOFTWARE, 1),
    }


def _analog() -> dict[str, str]:
    return {
        "Gain": number("Gain", Address.GAIN, "dB", GAIN_STEPS_PER_DB, GAIN_RANGE_DB),
        "GainAuto": enumeration("GainAuto", Address.GAIN_AUTO, _AUTO),
        "BlackLevel": number("BlackLevel", Address.BLACK_LEVEL, "DN", BLACK_LEVEL_STEPS_PER_DN, BLACK_LEVEL_RANGE_DN),
        "BlackLevelAuto": enumeration("BlackLevelAuto", Address.BLACK_LEVEL_AUTO, _AUTO),
        "LUTEnable": switch("LUTEnable", Address.LUT_ENABLE),
        "Gamma": number("Gamma", Address.GAMMA, "", GAMMA_STEPS_PER_UNIT, (1, 1)),
    }


def _transport(naming: Naming) -> dict[str, str]:
    throughput = _limits(*BYTES_PER_SECOND_RANGE)
    bandwidth = {
        "prosilica": {
            "StreamBytesPerSecond": integer("StreamBytesPerSecond", Address.BYTES_PER_SECOND, throughput),
        },
        "sfnc": {
            "DeviceLinkThroughputLimit": integer("DeviceLinkThroughputLimit", Address.BYTES_PER_SECOND, throughput),
            "DeviceLinkThroughputLimitMode": enumeration(
                "DeviceLinkThroughputLimitMode", Address.THROUGHPUT_LIMIT_MODE, {"Off": 0, "On": 1}
            ),
        },
    }[naming]
    size_in_bytes = "(WIDTH * HEIGHT * ((FORMAT &gt;&gt; 16) &amp; 0xFF) + 7) / 8"
    return {
        "PayloadSize": formula("PayloadSize", size_in_bytes, WIDTH="Width", HEIGHT="Height", FORMAT="PixelFormat"),
        "GevSCPSPacketSize": low_half("GevSCPSPacketSize", Address.PACKET_SIZE, _limits(576, 9000)),
        "GevSCPD": integer("GevSCPD", Address.PACKET_DELAY, _limits(0, 100_000_000)),
        "GevTimestampTickFrequency": integer("GevTimestampTickFrequency", Address.TICK_FREQUENCY_LOW, access="RO"),
    } | bandwidth
