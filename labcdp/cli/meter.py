"""Commands meter and meter-test: readings of a luminance meter, and tests made of what went over its wire."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..errors import InputError
from .terminal import JSON_OPTION, print_json, print_table, say

if TYPE_CHECKING:
    from ..reading import ReadingSeries


def meter(
    port: str | None = typer.Option(None, help="Serial port; default: the only one."),
    n: int = typer.Option(5, "-n", min=1, help="How many readings."),
    model: str = typer.Option("LS-110", help="LS-110 or LS-100."),
    slow: bool = typer.Option(False, "--slow", help="SLOW response, for light that flickers."),
    peak: bool = typer.Option(False, "--peak", help="The highest value instead of the present one."),
    transcript: Path | None = typer.Option(None, help="File to write every byte on the wire to."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Take readings of a luminance meter, with their mean and scatter."""
    from ..drivers.meter import measure_series
    from ..drivers.minolta_ls import MeterMode, MinoltaLS100, MinoltaLS110

    drivers = {"LS-110": MinoltaLS110, "LS-100": MinoltaLS100}
    if model not in drivers:
        raise InputError(f"model is {model!r}: give LS-110 or LS-100")
    with drivers[model](port or _only_port(), transcript=transcript) as opened:
        if slow:
            opened.set_mode(MeterMode.SLOW)
        if peak:
            opened.set_mode(MeterMode.PEAK)
        series = measure_series(opened, n)
    _print_series(series, as_json)


def meter_test(
    transcript: Path = typer.Argument(help="Wire transcript, as labcdp meter --transcript writes it."),
    test: Path = typer.Argument(help="New Python file to write."),
) -> None:
    """Turn a wire transcript into a test that plays it to the driver."""
    from ..drivers.simulated.meter_pty import PtyMeter
    from ..drivers.wire_replay import RecordedMeter, driver_of, play
    from ..drivers.wire_test_file import pytest_file_text
    from ..drivers.wire_transcript import read_transcript
    from ..session.files import write_whole

    if test.exists():
        raise InputError(f"{test} is there already: give a new file, or delete it first")
    wire = read_transcript(transcript)
    recorded = RecordedMeter(wire)
    with PtyMeter(recorded, response_time_s=0) as port:
        outcomes = play(recorded, driver_of(wire, port.port))
    text = pytest_file_text(wire, outcomes)
    try:
        write_whole(test.parent, test.name, text.encode("ascii"))
    except OSError as error:
        raise InputError(f"{test} cannot be written ({error.strerror}): give another file") from error
    n_errors = sum("error" in outcome for outcome in outcomes)
    say(f"{test}: {len(outcomes)} calls of the driver, {n_errors} of them end in an error as recorded")


def _only_port() -> str:
    from ..drivers.minolta_ls import find_meter_ports

    ports = find_meter_ports()
    if not ports:
        raise InputError("no serial port was found: plug the adapter in, or give --port")
    if len(ports) > 1:
        raise InputError(f"there are several serial ports ({', '.join(p.device for p in ports)}): give --port")
    return ports[0].device


def _print_series(series: ReadingSeries, as_json: bool) -> None:
    summary = {
        "mean_cd_m2": series.mean_cd_m2,
        "scatter_cd_m2": series.scatter_cd_m2,
        "scatter_rel": series.scatter_rel,
        "standard_uncertainty_random_cd_m2": series.standard_uncertainty_random_cd_m2,
        "standard_uncertainty_common_rel": series.standard_uncertainty_common_rel,
    }
    if as_json:
        print_json({"readings": [reading.to_dict() for reading in series.readings], **summary})
        return
    print_table(
        "Readings",
        ("number", "as sent", "luminance", "uncertainty (k = 1)"),
        [
            (
                str(number),
                f"{reading.value:g} {reading.unit}",
                f"{reading.luminance_cd_m2:.6g} cd/m2",
                f"{reading.standard_uncertainty_random_cd_m2:.2g} cd/m2",
            )
            for number, reading in enumerate(series.readings, start=1)
        ],
    )
    one = len(series.readings) == 1
    print_table(
        "All readings",
        ("quantity", "value", "relative"),
        [
            ("mean", f"{series.mean_cd_m2:.6g} cd/m2", ""),
            ("scatter (standard deviation)", *_with_share(None if one else series.scatter_cd_m2, series.mean_cd_m2)),
            (
                "random uncertainty of the mean (k = 1)",
                *_with_share(series.standard_uncertainty_random_cd_m2, series.mean_cd_m2),
            ),
            ("uncertainty of the meter's scale (k = 1)", "", f"{series.standard_uncertainty_common_rel:.2%}"),
        ],
    )


def _with_share(value_cd_m2: float | None, mean_cd_m2: float) -> tuple[str, str]:
    if value_cd_m2 is None:
        return "unknown from one reading", ""
    return f"{value_cd_m2:.2g} cd/m2", f"{value_cd_m2 / mean_cd_m2:.2%}" if mean_cd_m2 else ""
