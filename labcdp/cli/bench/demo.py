"""Command demo: one bench session from the first frame to the report, on the simulated bench."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import typer

from ...acquire import acquire
from ...calibration import save
from ...core.result import Finding, Result, info
from ...core.table import Column, Table
from ...drivers.simulated.bench import SimulatedBench
from ...drivers.simulated.devices import SimulatedBenchFile
from ...evaluate.bench.calibrate import calibrate_session
from ...evaluate.bench.calibration_page import write_calibration_report
from ...evaluate.bench.calibration_result import calibration_result
from ...evaluate.bench.observe import observe_session
from ...evaluate.bench.session import evaluate_session
from ...evaluate.bench.session_page import draw_figures, write_results
from ...evaluate.bench.session_result import session_input, session_result
from ...output import ResultsFolder
from ...session import Session, SessionConfiguration, example_configuration
from ..output import FORCE_OPTION, OPEN_OPTION, output_option, results_folder, show_page
from ..terminal import JSON_OPTION, print_result, progress_bars, say
from .devices_of_session import simulated_bench_file, simulated_devices


def demo(
    context: typer.Context,
    output: Path | None = output_option("labcdp-demo"),
    seed: int = typer.Option(0, help="Random seed of camera and meter noise.", min=0),
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Record, calibrate and evaluate the target of the 2018 thesis on the simulated bench."""
    started = time.monotonic()
    configuration = SessionConfiguration.from_toml(example_configuration(), "the demonstration's configuration")
    with results_folder(context, "labcdp", output, force) as results:
        result, written = demonstrate(configuration, simulated_bench_file(None, seed), results)
    print_result(result, as_json)
    if not as_json:
        say(f"Written in {time.monotonic() - started:.0f} s: {', '.join(str(path) for path in written)}")
    show_page(results.folder / "report.html", open_page)


def demonstrate(
    configuration: SessionConfiguration, described: SimulatedBenchFile, results: ResultsFolder
) -> tuple[Result, list[Path]]:
    """Record a session on a simulated bench and write all that is made of it; returns its result and the files."""
    specimens = described.devices()
    bench = SimulatedBench(configuration, specimens)
    with Session.create(results.path("session"), configuration) as session:
        session.add_event("simulated bench", described.model_dump(mode="json"))
        with progress_bars() as bars:
            with simulated_devices(configuration, bench) as devices:
                acquire(session, devices.camera, devices.meter, devices.operator, bars.acquisition)
                transport = devices.transport
            observed = observe_session(session, report=lambda done, total: bars.update("reading", done, total))
            bars.update("evaluating", 0, 3)
            calibration = calibrate_session(observed)
            save(calibration, results.path("calibration.json"))
            bars.update("evaluating", 1, 3)
            evaluation = evaluate_session(session, observed, calibration)
            bars.update("evaluating", 2, 3)
            inputs = [replace(session_input(session), path=str(results.folder / "session"))]
            result = session_result(evaluation, inputs, "demo", described.seed)
            truth = _truth(result, bench, transport)
            of_truth = _compared(truth, specimens.meter.scale_rel)
            result = replace(result, tables=(*result.tables, truth), findings=(*result.findings, of_truth))
            of_calibration = calibration_result(calibration, configuration.name, inputs)
            figures = draw_figures(evaluation)
            written = [
                *write_calibration_report(calibration, of_calibration, results, figures["calibration"]),
                *write_results(evaluation, result, results, figures),
            ]
            bars.update("evaluating", 3, 3)
    return result, [results.folder / "session", results.folder / "calibration.json", *written]


def _truth(result: Result, bench: SimulatedBench, transport: str) -> Table:
    """Compare the calibrated luminance with the simulated one."""
    columns = (
        Column("patch", "patch"),
        Column("simulated_cd_m2", "simulated", "cd/m²", "Luminance of the simulated target."),
        Column("calibrated_cd_m2", "calibrated", "cd/m²", "By the calibrated camera."),
        Column("error_rel", "error", "%", "Calibrated over simulated, minus 1.", decimals=2),
        Column("transport", "camera", "", "How the frames of the simulated camera were transferred."),
    )
    rows = []
    for row in result.table("luminance").rows():
        simulated = bench.luminance_cd_m2[row["patch"]]
        calibrated = row["calibrated_cd_m2"]
        rows.append(
            {
                "patch": row["patch"],
                "simulated_cd_m2": simulated,
                "calibrated_cd_m2": calibrated,
                "error_rel": calibrated / simulated - 1,
                "transport": transport,
            }
        )
    return Table.of_rows("simulation", "Calibrated and simulated luminance", columns, rows, detail=True)


def _compared(truth: Table, meter_scale_rel: float) -> Finding:
    largest = max(map(abs, truth["error_rel"]))
    return info("simulated-luminance", largest_rel=largest, meter_scale_rel=meter_scale_rel)
