"""Command meter: readings of a luminance meter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from ...core.errors import InputError
from ...core.quantity import Quantity, quantity_table
from ...core.result import Result
from ...core.table import Column, Table, uncertain, uncertain_values
from ..options import METER_MODEL_OPTION, METER_OPTION
from ..terminal import JSON_OPTION, print_result

if TYPE_CHECKING:
    from ...core.reading import ReadingSeries


def meter(
    port: str | None = METER_OPTION,
    n: int = typer.Option(5, "-n", min=1, help="Number of readings."),
    model: Literal["LS-110", "LS-100"] = METER_MODEL_OPTION,
    slow: bool = typer.Option(False, "--slow", help="Use the SLOW response, for flickering light."),
    peak: bool = typer.Option(False, "--peak", help="Measure the peak value instead of the present one."),
    transcript: Path | None = typer.Option(None, help="New file for the bytes exchanged with the meter."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Take readings of a luminance meter, with their mean and scatter."""
    from ...drivers.meter import measure_series
    from ...drivers.minolta_ls.meter import DRIVERS, MeterMode

    modes = [mode for mode, wanted in ((MeterMode.SLOW, slow), (MeterMode.PEAK, peak)) if wanted]
    with DRIVERS[model](port or _only_port(), modes=modes, transcript=transcript) as opened:
        opened.ask_if_simulated()
        series = measure_series(opened, n)
    print_result(_result(series), as_json)


def _only_port() -> str:
    from ...drivers.minolta_ls.meter import find_meter_ports

    ports = find_meter_ports()
    if not ports:
        raise InputError("no serial port was found: connect the adapter, or give --meter")
    if len(ports) > 1:
        raise InputError(f"there are several serial ports ({', '.join(p.device for p in ports)}): give --meter")
    return ports[0].device


def _result(series: ReadingSeries) -> Result:
    columns = (
        Column("number", "number"),
        Column("as_sent", "as sent", "", "Value and unit on the display of the meter."),
        *uncertain(Column("luminance_cd_m2", "luminance", "cd/m²", "U and u without the scale error of the meter.")),
        Column("time", "time", "", "Time of the reading."),
        Column("value", "value", "", "Value on the display.", shown=False),
        Column("unit", "unit", "", "Unit on the display.", shown=False),
        Column("peak", "peak", "", "Whether it is a held peak.", shown=False),
        Column("raw", "raw", "", "Bytes on the wire.", shown=False),
    )
    rows = [
        {
            "number": number,
            "as_sent": f"{reading.value:g} {reading.unit}",
            **uncertain_values("luminance_cd_m2", reading.luminance_cd_m2, reading.standard_uncertainty_random_cd_m2),
            "time": reading.timestamp.isoformat(),
            "value": reading.value,
            "unit": reading.unit,
            "peak": reading.peak,
            "raw": reading.raw,
        }
        for number, reading in enumerate(series.readings, start=1)
    ]
    several = len(series.readings) > 1
    quantities = [
        Quantity("mean", series.mean_cd_m2, "cd/m²", "scale excluded", series.standard_uncertainty_random_cd_m2),
        Quantity("scatter", series.scatter_cd_m2 if several else None, "cd/m²", "standard deviation of the readings"),
        Quantity("relative scatter", series.scatter_rel if several else None, "%"),
        Quantity("u of the meter's scale", series.standard_uncertainty_common_rel, "%", "common to all readings"),
    ]
    meter = series.readings[0].meter
    return Result(
        "meter",
        f"{meter.model} {meter.serial}",
        (Table.of_rows("readings", "Readings", columns, rows), quantity_table("series", "All readings", quantities)),
        simulated=meter.simulated,
    )
