"""GenICam description of the simulated camera: its registers and the features over them.

Feature names are those of an Allied Vision Manta (``ExposureTimeAbs``, ``AcquisitionFrameRateAbs``, gain in
dB); most register addresses are those that Aravis' GigE Vision simulator acts upon.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from textwrap import indent

from ..pixel_format import PixelFormat


class Address(IntEnum):
    """Register addresses of the simulated camera."""

    VENDOR = 0x48
    MODEL = 0x68
    VERSION = 0x88
    MANUFACTURER_INFO = 0xA8
    SERIAL = 0xD8
    WIDTH = 0x100
    HEIGHT = 0x104
    GAIN = 0x110
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
    TRIGGER_MODE = 0x300
    TRIGGER_SOURCE = 0x304
    TRIGGER_SOFTWARE = 0x30C
    PACKET_SIZE = 0xD04


#: Steps of the gain register per dB, of the temperature register per degree Celsius, of black level per DN.
GAIN_STEPS_PER_DB = 10
TEMPERATURE_STEPS_PER_C = 10
BLACK_LEVEL_STEPS_PER_DN = 1

#: Exposure and gain ranges. Data sheet of the Manta G-505 (recall): 21 us to 60 s, 0 to 26 dB.
EXPOSURE_RANGE_US = (21, 60_000_000)
GAIN_RANGE_DB = (0, 26)
FRAME_PERIOD_RANGE_US = (1_000, 60_000_000)


def description(vendor: str, model: str, formats: Sequence[PixelFormat]) -> str:
    """Write the GenICam register description (GenApi schema 1.0) of the camera.

    Parameters
    ----------
    vendor, model : str
        As shown to the user; blanks are left out of the schema's identifiers.
    formats : sequence of PixelFormat
        Pixel formats to offer.

    Returns
    -------
    str
        XML.
    """
    categories = {
        "DeviceControl": _device(),
        "ImageFormatControl": _image_format(formats),
        "AcquisitionControl": _acquisition(),
        "AnalogControl": _analog(),
        "TransportLayerControl": _transport(),
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


def _device() -> dict[str, str]:
    return {
        "DeviceVendorName": _string("DeviceVendorName", Address.VENDOR, 32),
        "DeviceModelName": _string("DeviceModelName", Address.MODEL, 32),
        "DeviceVersion": _string("DeviceVersion", Address.VERSION, 32),
        "DeviceManufacturerInfo": _string("DeviceManufacturerInfo", Address.MANUFACTURER_INFO, 48),
        "DeviceID": _string("DeviceID", Address.SERIAL, 16),
        "DeviceTemperature": _float(
            "DeviceTemperature", Address.TEMPERATURE, "C", f"* {TEMPERATURE_STEPS_PER_C}", (-40, 125), "RO"
        ),
    }


def _image_format(formats: Sequence[PixelFormat]) -> dict[str, str]:
    return {
        "SensorWidth": _integer("SensorWidth", Address.SENSOR_WIDTH, access="RO"),
        "SensorHeight": _integer("SensorHeight", Address.SENSOR_HEIGHT, access="RO"),
        "Width": _integer("Width", Address.WIDTH, "<Min>2</Min><pMax>SensorWidth</pMax><Inc>2</Inc>"),
        "Height": _integer("Height", Address.HEIGHT, "<Min>1</Min><pMax>SensorHeight</pMax><Inc>1</Inc>"),
        "OffsetX": _integer("OffsetX", Address.OFFSET_X, "<Min>0</Min><pMax>SensorWidth</pMax><Inc>1</Inc>"),
        "OffsetY": _integer("OffsetY", Address.OFFSET_Y, "<Min>0</Min><pMax>SensorHeight</pMax><Inc>1</Inc>"),
        "PixelFormat": _enumeration("PixelFormat", Address.PIXEL_FORMAT, {form.name: form.code for form in formats}),
    }


def _acquisition() -> dict[str, str]:
    return {
        "AcquisitionMode": _enumeration("AcquisitionMode", Address.ACQUISITION_MODE, {"Continuous": 1}),
        "AcquisitionStart": _command("AcquisitionStart", Address.ACQUISITION, 1),
        "AcquisitionStop": _command("AcquisitionStop", Address.ACQUISITION, 0),
        "AcquisitionFrameRateAbs": _frame_rate(),
        "ExposureTimeAbs": _float("ExposureTimeAbs", Address.EXPOSURE_US, "us", "* 1", EXPOSURE_RANGE_US, "RW"),
        "TriggerSelector": (
            '<Enumeration Name="TriggerSelector" NameSpace="Standard"><EnumEntry Name="FrameStart">'
            "<Value>0</Value></EnumEntry><pValue>TriggerSelectorValue</pValue></Enumeration>\n"
            '<Integer Name="TriggerSelectorValue" NameSpace="Custom"><Value>0</Value></Integer>'
        ),
        "TriggerMode": _enumeration("TriggerMode", Address.TRIGGER_MODE, {"Off": 0, "On": 1}),
        "TriggerSource": _enumeration("TriggerSource", Address.TRIGGER_SOURCE, {"Line1": 0, "Software": 1}),
        "TriggerSoftware": _command("TriggerSoftware", Address.TRIGGER_SOFTWARE, 1),
    }


def _analog() -> dict[str, str]:
    return {
        "Gain": _float("Gain", Address.GAIN, "dB", f"* {GAIN_STEPS_PER_DB}", GAIN_RANGE_DB, "RW"),
        "BlackLevel": _float("BlackLevel", Address.BLACK_LEVEL, "DN", f"* {BLACK_LEVEL_STEPS_PER_DN}", (0, 255), "RO"),
    }


def _transport() -> dict[str, str]:
    return {
        "PayloadSize": (
            '<IntSwissKnife Name="PayloadSize" NameSpace="Standard"><pVariable Name="WIDTH">Width</pVariable>'
            '<pVariable Name="HEIGHT">Height</pVariable><pVariable Name="FORMAT">PixelFormat</pVariable>'
            "<Formula>(WIDTH * HEIGHT * ((FORMAT &gt;&gt; 16) &amp; 0xFF) + 7) / 8</Formula></IntSwissKnife>"
        )
    }


def _register(name: str, address: int, access: str) -> str:
    return (
        f'<IntReg Name="{name}Register" NameSpace="Custom"><Address>{address:#x}</Address><Length>4</Length>'
        f"<AccessMode>{access}</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
        "<Endianess>BigEndian</Endianess></IntReg>"
    )


def _string(name: str, address: int, length: int) -> str:
    return (
        f'<StringReg Name="{name}" NameSpace="Standard"><Address>{address:#x}</Address>'
        f"<Length>{length}</Length><AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>"
    )


def _integer(name: str, address: int, limits: str = "", access: str = "RW") -> str:
    return (
        f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>{limits}</Integer>\n'
        f"{_register(name, address, access)}"
    )


def _enumeration(name: str, address: int, values: dict[str, int]) -> str:
    entries = "".join(
        f'<EnumEntry Name="{entry}" NameSpace="Standard"><Value>{value}</Value></EnumEntry>'
        for entry, value in values.items()
    )
    return (
        f'<Enumeration Name="{name}" NameSpace="Standard">{entries}<pValue>{name}Register</pValue>'
        f"</Enumeration>\n{_register(name, address, 'RW')}"
    )


def _command(name: str, address: int, value: int) -> str:
    return (
        f'<Command Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>'
        f"<CommandValue>{value}</CommandValue></Command>\n{_register(name, address, 'WO')}"
    )


def _float(name: str, address: int, unit: str, steps: str, limits: tuple[float, float], access: str) -> str:
    back = steps.replace("*", "/")
    return (
        f'<Float Name="{name}" NameSpace="Standard"><pValue>{name}Converter</pValue><Min>{limits[0]}</Min>'
        f"<Max>{limits[1]}</Max><Unit>{unit}</Unit></Float>\n"
        f'<Converter Name="{name}Converter" NameSpace="Custom"><FormulaTo>FROM {steps}</FormulaTo>'
        f"<FormulaFrom>TO {back}</FormulaFrom><pValue>{name}Register</pValue></Converter>\n"
        f"{_register(name, address, access)}"
    )


def _frame_rate() -> str:
    name = "AcquisitionFrameRateAbs"
    low_us, high_us = FRAME_PERIOD_RANGE_US
    return (
        f'<Float Name="{name}" NameSpace="Standard"><pValue>{name}Converter</pValue>'
        f"<Min>{1e6 / high_us:.4f}</Min><Max>{1e6 / low_us:.1f}</Max><Unit>Hz</Unit></Float>\n"
        f'<Converter Name="{name}Converter" NameSpace="Custom"><FormulaTo>1000000 / FROM</FormulaTo>'
        f"<FormulaFrom>1000000 / TO</FormulaFrom><pValue>{name}Register</pValue></Converter>\n"
        f"{_register(name, Address.FRAME_PERIOD_US, 'RW')}"
    )
