"""GenICam description of a simulated camera, made of a table of its features."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache
from importlib.resources import files
from math import ceil, floor
from typing import Any, Final, Literal
from xml.sax.saxutils import quoteattr

from ...core.disk import parse_toml
from ...core.dn import PIXEL_FORMATS

#: Naming convention of the features: Allied Vision's (formerly Prosilica), or that of the standard (SFNC 2).
Naming = Literal["prosilica", "sfnc"]

#: Features with their properties by category and name; see the file of `standard_features`.
FeatureTable = Mapping[str, Mapping[str, Mapping[str, Any]]]

_OF_THE_STANDARD: Final = {
    "ExposureTimeAbs": "ExposureTime",
    "AcquisitionFrameRateAbs": "AcquisitionFrameRate",
    "StreamBytesPerSecond": "DeviceLinkThroughputLimit",
}
_TRANSPORT_OF_THE_STANDARD: Final = {
    "DeviceLinkThroughputLimitMode": {"register": 0x148, "choices": {"Off": 0, "On": 1}},
    "GevGVSPExtendedIDMode": {"register": "LONG_IDS", "choices": {"Off": 0, "On": 1}, "value": 0},
}

#: Names of the chunks of a frame, in the order of the entries of ChunkSelector, and their ids.
CHUNK_IDS: Final = {"ExposureTime": 0x1001, "Gain": 0x1002, "Timestamp": 0x1003, "FrameID": 0x1004}


def chunk_bytes(name: str) -> int:
    """Return the size of a chunk."""
    return 8 if name == "Timestamp" else 4


def _chunk_features() -> dict[str, dict[str, Any]]:
    """Return the features of chunk data, which the camera has with the names of the standard."""
    enabled = RegisterAddress.CHUNKS_ENABLED
    selector = {"register": 0x18C, "choices": {name: number for number, name in enumerate(CHUNK_IDS)}, "value": 0}
    features: dict[str, dict[str, Any]] = {
        "ChunkModeActive": {"pIsLocked": "TLParamsLocked", "register": "CHUNK_MODE", "switch": True, "value": 0},
        "ChunkSelector": selector,
        "ChunkEnable": {"register": int(enabled), "switch": True, "index": "ChunkSelector"},
    }
    kinds = {"ExposureTime": {"unit": "us", "steps": 1}, "Gain": {"unit": "dB", "steps": 10}}
    for number, (name, chunk) in enumerate(CHUNK_IDS.items()):
        features[f"{name}Enabled"] = {"register": enabled + 4 * number, "access": "RO", "hidden": True, "value": 0}
        content = {"chunk": chunk, "register": 0, "bytes": chunk_bytes(name), "access": "RO"}
        features[f"Chunk{name}"] = content | kinds.get(name, {})
    return features


def _payload_with_chunks(payload: Mapping[str, Any]) -> dict[str, Any]:
    """Return the feature PayloadSize of a camera with chunks, each of which is followed by its id and size."""
    bits = "(WIDTH * HEIGHT * ((FORMAT &gt;&gt; 16) &amp; 0xFF))"
    chunks = " + ".join(f"{chunk_bytes(name) + 8} * {name.upper()}" for name in CHUNK_IDS)
    formula = f"(1 - ACTIVE) * (({bits} + 7) / 8) + ACTIVE * (({bits} + 31) / 32 * 4 + 8 + {chunks})"
    switches = {name.upper(): f"{name}Enabled" for name in CHUNK_IDS}
    return {**payload, "formula": formula, "ACTIVE": "ChunkModeActiveRegister", **switches}


class RegisterAddress(IntEnum):
    """Addresses of registers that the simulated camera acts upon; most are those of Aravis' GigE Vision simulator."""

    VENDOR = 0x48
    MODEL = 0x68
    MANUFACTURER_INFO = 0xA8
    WIDTH = 0x100
    HEIGHT = 0x104
    BINNING_HORIZONTAL = 0x108
    BINNING_VERTICAL = 0x10C
    SENSOR_HEIGHT = 0x118
    SENSOR_WIDTH = 0x11C
    PIXEL_FORMAT = 0x128
    OFFSET_X = 0x130
    OFFSET_Y = 0x134
    FRAME_PERIOD_US = 0x138
    BLACK_LEVEL = 0x13C
    TEMPERATURE = 0x140
    REVERSE_X = 0x160
    REVERSE_Y = 0x164
    CHUNK_MODE = 0x180
    CHUNKS_ENABLED = 0x190
    LONG_IDS = 0x1B0
    TRIGGER_MODE = 0x300
    TRIGGER_SOFTWARE = 0x30C
    TICK_FREQUENCY_HIGH = 0x93C


@cache
def standard_features(naming: Naming = "prosilica", colour_filter: str | None = None) -> FeatureTable:
    """Return the features of the simulated camera, with the names of a Manta or of the standard.

    With the names of the standard it has chunk data and ids of 64 bits. With a Bayer pattern it offers its formats
    alone, starts on even pixels, and neither bins nor mirrors.
    """
    text = (files("labcdp") / "data" / "simulated-camera.toml").read_text(encoding="utf-8")
    table: dict[str, dict[str, Any]] = parse_toml(text)
    if colour_filter is not None:
        table["ImageFormatControl"] = _behind_filters(table["ImageFormatControl"], colour_filter)
    if naming == "prosilica":
        return table
    renamed = {
        category: {_OF_THE_STANDARD.get(name, name): feature for name, feature in features.items()}
        for category, features in table.items()
    }
    transport = renamed["TransportLayerControl"] | _TRANSPORT_OF_THE_STANDARD
    transport["PayloadSize"] = _payload_with_chunks(transport["PayloadSize"])
    return renamed | {"ChunkDataControl": _chunk_features(), "TransportLayerControl": transport}


def _behind_filters(features: dict[str, Any], colour_filter: str) -> dict[str, Any]:
    names = [f"Bayer{colour_filter}{suffix}" for suffix in ("8", "12", "12Packed", "16")]
    formats = {"choices": {name: PIXEL_FORMATS[name].code for name in names}, "value": PIXEL_FORMATS[names[1]].code}
    changed = {"PixelFormat": features["PixelFormat"] | formats}
    changed |= {name: features[name] | {"range": [1, 1]} for name in ("BinningHorizontal", "BinningVertical")}
    changed |= {name: features[name] | {"increment": 2} for name in ("OffsetX", "OffsetY")}
    return {name: changed.get(name, of) for name, of in features.items() if name not in ("ReverseX", "ReverseY")}


def feature(name: str) -> Mapping[str, Any]:
    """Return a feature of the standard table, by the name that a Manta has for it."""
    return next(features[name] for features in standard_features().values() if name in features)


def description(vendor: str, model: str, table: FeatureTable) -> str:
    """Write the GenICam register description (GenApi schema 1.0, XML) of a camera.

    Parameters
    ----------
    vendor, model : str
        As shown to the user; blanks are left out of the schema's identifiers.
    table : FeatureTable
        Its features.
    """
    nodes = [_category("Root", table), _node("Integer", "Never", "<Value>0</Value>")]
    chunks = sorted(
        {values["chunk"] for features in table.values() for values in features.values() if "chunk" in values}
    )
    nodes += [_node("Port", _chunk_port(chunk), f"<ChunkID>{chunk:x}</ChunkID>") for chunk in chunks]
    for name, features in table.items():
        nodes.append(
            _category(name, [feature_name for feature_name, values in features.items() if not values.get("hidden")])
        )
        nodes += [_nodes(feature_name, values) for feature_name, values in features.items()]
    return f"""<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName={_identifier(model)} VendorName={_identifier(vendor)}
  StandardNameSpace="None" SchemaMajorVersion="1" SchemaMinorVersion="0" SchemaSubMinorVersion="1"
  MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ProductGuid="0" VersionGuid="0"
  xmlns="http://www.genicam.org/GenApi/Version_1_0"
  xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_0 GenApiSchema.xsd">
{"".join(nodes)}<Port Name="Device" NameSpace="Standard"/>
</RegisterDescription>
"""


def _identifier(text: str) -> str:
    """Write a text without blanks as the value of an attribute in XML."""
    return quoteattr(text.replace(" ", ""))


def initial_values(table: FeatureTable) -> dict[int, int]:
    """Return what registers hold after power-on, by address."""
    features = [values for category in table.values() for values in category.values()]
    return {_address(values): values["value"] for values in features if "value" in values}


@dataclass(frozen=True)
class Values:
    """Values that a register takes, of 32 bits without a sign.

    Parameters
    ----------
    low, high : int
        Bounds.
    choices : frozenset of int
        The only ones; empty for all within the bounds.
    mask : int
        Bits that are compared.
    """

    low: int = 0
    high: int = 0xFFFFFFFF
    choices: frozenset[int] = frozenset()
    mask: int = 0xFFFFFFFF


def writable_registers(table: FeatureTable, width: int, height: int) -> dict[int, Values]:
    """Return the values that the registers of writable features take, by address.

    Parameters
    ----------
    table : FeatureTable
        Features of the camera.
    width, height : int
        Size of its sensor in pixels.
    """
    registers: dict[int, Values] = {}
    for category in table.values():
        for values in category.values():
            if "register" in values and "length" not in values and values.get("access") != "RO":
                address = _address(values)
                taken = _taken(values)
                # Two commands may share a register.
                before = registers.get(address, taken)
                registers[address] = replace(taken, choices=taken.choices | before.choices)
                for number in range(len(category[values["index"]]["choices"]) if "index" in values else 0):
                    registers[address + 4 * number] = taken
    # Aravis' simulator allocates frames of these sizes.
    sizes = {RegisterAddress.WIDTH: Values(1, width), RegisterAddress.HEIGHT: Values(1, height)}
    return registers | {address: size for address, size in sizes.items() if address in registers}


def _taken(values: Mapping[str, Any]) -> Values:
    if "choices" in values:
        return Values(choices=frozenset(values["choices"].values()))
    if "command" in values:
        return Values(choices=frozenset({values["command"]}))
    if "range" not in values:
        return Values(0, 1) if "switch" in values else Values()
    low, high = values["range"]
    # Where another feature bounds it, what follows from frames of any size and rate is harmless.
    bounds = [_in_register(limit, values) for limit in ([high, low] if values.get("period") else [low, high])]
    least, most = (None if bound is None or bound < 0 else bound for bound in bounds)
    mask = 0xFFFF if values.get("lower_half") else 0xFFFFFFFF
    return Values(0 if least is None else floor(least), 0xFFFFFFFF if most is None else ceil(most), mask=mask)


def _in_register(limit: float | str, values: Mapping[str, Any]) -> float | None:
    """Return what a register holds at a limit of its feature; None if it depends on another one."""
    if isinstance(limit, str):
        return None
    if values.get("period"):
        return 1e6 / limit
    return limit * values["steps"] if "unit" in values else limit


def _category(name: str, members: Any) -> str:
    return _node("Category", name, "".join(f"<pFeature>{member}</pFeature>" for member in members))


def _nodes(name: str, values: Mapping[str, Any]) -> str:
    """Write a feature, and the nodes that it refers to."""
    access, register = values.get("access", "RW"), f"<pValue>{name}Register</pValue>"
    conditions = "".join(f"<{key}>{value}</{key}>" for key, value in values.items() if key.startswith("pIs"))
    if "length" in values:
        at = f"<Address>{_address(values):#x}</Address><Length>{values['length']}</Length>"
        return _node("StringReg", name, f"{at}<AccessMode>RO</AccessMode><pPort>Device</pPort>")
    if "formula" in values:
        variables = {key: value for key, value in values.items() if key.isupper()}
        body = "".join(f'<pVariable Name="{key}">{value}</pVariable>' for key, value in variables.items())
        return _node("IntSwissKnife", name, f"{body}<Formula>{values['formula']}</Formula>")
    if "choices" in values:
        entries = "".join(_node("EnumEntry", key, f"<Value>{n}</Value>") for key, n in values["choices"].items())
        if "register" not in values:  # it cannot be changed
            entries += f"<pValue>{name}Value</pValue>"
            return _node("Enumeration", name, entries) + _node("Integer", f"{name}Value", "<Value>0</Value>")
        feature = _node("Enumeration", name, conditions + entries + register)
    elif "command" in values:
        feature, access = _node("Command", name, f"{register}<CommandValue>{values['command']}</CommandValue>"), "WO"
    elif "switch" in values:
        feature = _node("Boolean", name, conditions + register)
    elif "unit" in values:
        to, back = ("1000000 / FROM", "1000000 / TO")
        if not values.get("period"):
            # Of whole numbers some clients take the whole part.
            to, back = f"FROM * {values['steps']}", f"TO / {values['steps']:.1f}"
        body = f"{conditions}<pValue>{name}Converter</pValue>{_limits(values)}<Unit>{values['unit']}</Unit>"
        converter = f"<FormulaTo>{to}</FormulaTo><FormulaFrom>{back}</FormulaFrom>{register}"
        feature = _node("Float", name, body) + _node("Converter", f"{name}Converter", converter)
    else:
        feature = _node("Integer", name, conditions + register + _limits(values))
    # Bits are counted from the highest.
    half = "<LSB>31</LSB><MSB>16</MSB>" if values.get("lower_half") else ""
    index = f'<pIndex Offset="4">{values["index"]}Register</pIndex>' if "index" in values else ""
    port = _chunk_port(values["chunk"]) if "chunk" in values else "Device"
    body = f"<Address>{_address(values):#x}</Address>{index}<Length>{values.get('bytes', 4)}</Length>"
    # Others than the client change them.
    cached = "<Cachable>NoCache</Cachable>" if access == "RO" else ""
    body += f"<AccessMode>{access}</AccessMode><pPort>{port}</pPort>{cached}{half}<Sign>Unsigned</Sign>"
    body += "<Endianess>BigEndian</Endianess>"
    return feature + _node("MaskedIntReg" if half else "IntReg", f"{name}Register", body)


def _chunk_port(chunk: int) -> str:
    return f"Chunk{chunk:x}"


def _address(values: Mapping[str, Any]) -> int:
    named = values["register"]
    return int(RegisterAddress[named]) if isinstance(named, str) else int(named)


def _limits(values: Mapping[str, Any]) -> str:
    if "range" not in values:
        return ""
    low, high = values["range"]
    step = "" if "unit" in values else f"<Inc>{values.get('increment', 1)}</Inc>"
    return f"<Min>{low}</Min>" + (f"<pMax>{high}</pMax>" if isinstance(high, str) else f"<Max>{high}</Max>") + step


def _node(kind: str, name: str, body: str) -> str:
    return f'<{kind} Name="{name}" NameSpace="Standard">{body}</{kind}>\n'
