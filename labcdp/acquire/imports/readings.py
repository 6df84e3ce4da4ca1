"""Readings of a meter from a CSV file, for the patches of a target."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ...core.errors import InputError
from ...core.finding import Finding, warning
from ...core.reading import Reading
from ...drivers.manual.csv import CsvMeter
from ...drivers.manual.text import MeterAccuracy, stated_accuracy
from ...drivers.minolta_ls.protocol import LS100, LS110
from ...session import MeterConfiguration, SessionConfiguration

_DATA_SHEETS = {sheet.model: sheet for sheet in (LS100, LS110)}


def read_readings(configuration: SessionConfiguration, path: Path) -> tuple[list[tuple[str, Reading]], list[Finding]]:
    """Return the readings with their patches, each line once, and findings."""
    described = configuration.meter
    with CsvMeter(path, described.identity, _accuracy(described)) as meter:
        by_patch = meter.readings
    names = [patch.name for patch in configuration.target.patches]
    for name in by_patch:
        if name not in names:
            raise InputError(f"{path} has readings of patch {name!r}, the target has {', '.join(names)}: correct one")
    for name in names:
        if name not in by_patch:
            raise InputError(f"{path} has no reading of patch {name!r}: add one, or take the patch from the target")
    finest = min(reading.resolution for readings in by_patch.values() for reading in readings)
    findings = []
    result = []
    for patch, readings in by_patch.items():
        once = list({reading.raw: reading for reading in readings}.values())
        if len(once) < len(readings):
            count = len(readings) - len(once)
            findings.append(warning("lines-repeated", patch, path=str(path), count=count))
        result += [(patch, _with_digits(reading, described, finest)) for reading in once]
    return result, findings


def _accuracy(described: MeterConfiguration) -> MeterAccuracy:
    sheet = _DATA_SHEETS.get(described.model) if described.entry == "serial" else None
    if sheet is not None:
        return MeterAccuracy(sheet.scale_half_width_rel, sheet.repeatability_rel, 1)
    return stated_accuracy(described)


def _with_digits(reading: Reading, described: MeterConfiguration, finest: float) -> Reading:
    """Resolution by the data sheet, with the decimals of the finest number of the list.

    Spreadsheets drop trailing zeros, and rounding affects all numbers of a list.
    """
    sheet = _DATA_SHEETS.get(described.model) if described.entry == "serial" else None
    if sheet is None:
        return reading
    resolution = min(reading.resolution, max(finest, sheet.shown_resolution(reading.value)))
    digits = sheet.digit_error(reading.value, reading.unit)
    return replace(reading, resolution=resolution, digits_half_width=digits * resolution)
