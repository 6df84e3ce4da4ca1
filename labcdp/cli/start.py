"""Commands demo and init: a session from the first frame to the report on the simulated bench, and templates."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from ..acquire import acquire
from ..calibration import save
from ..chain import preset_text
from ..core.disk import reason
from ..core.disk.files import shell_word
from ..core.errors import InputError
from ..core.result import Result, info
from ..core.table import Column, Table
from ..drivers.simulated.bench import SimulatedBench
from ..drivers.simulated.devices import SimulatedBenchFile
from ..evaluate.bench.calibrate import calibrate_session
from ..evaluate.bench.calibration_page import calibration_files
from ..evaluate.bench.calibration_result import calibration_result
from ..evaluate.bench.observe import observe_session
from ..evaluate.bench.session import evaluate_session
from ..evaluate.bench.session_page import session_files
from ..evaluate.bench.session_result import session_input, session_result
from ..evaluate.camera.sensor import chain_text
from ..evaluate.chart.chart_file import chart_template
from ..evaluate.requirement import requirement_template
from ..evaluate.samples import sample_files
from ..output import ResultsFolder, write_file
from ..session import Session, SessionConfiguration, example_configuration
from ..session.configuration import example_camera, example_simulated_bench
from .bench.connected import simulated_bench_file, simulated_devices
from .options import Force, Results, Seed, output_file
from .terminal import print_result, progress_bars


def demo(results: Results, *, seed: Seed = 0) -> None:
    """Record, calibrate and evaluate the target of the 2018 thesis on the simulated bench, into labcdp-demo.

    Parameters
    ----------
    seed
        Random seed of camera and meter noise.
    """
    started = time.monotonic()
    configuration = SessionConfiguration.from_toml(example_configuration(), "the demonstration's configuration")
    with results.folder("labcdp") as folder:
        result, written = demonstrate(configuration, simulated_bench_file(None, seed), folder)
    following = f"Written in {time.monotonic() - started:.0f} s: {', '.join(str(path) for path in written)}"
    results.print(result, following, page=folder.folder / "report.html")


def demonstrate(
    configuration: SessionConfiguration, described: SimulatedBenchFile, results: ResultsFolder
) -> tuple[Result, list[Path]]:
    """Record a session on a simulated bench and write all that is made of it; returns its result and the files."""
    specimens = described.devices()
    bench = SimulatedBench(configuration, specimens)
    with Session.create(results.path("session"), configuration) as session, progress_bars() as bars:
        session.add_event("simulated bench", described.model_dump(mode="json"))
        with simulated_devices(configuration, bench) as devices:
            acquire(session, devices.camera, devices.meter, devices.operator, bars.acquisition, bench=devices.bench)
        observed = observe_session(session, report=lambda done, total: bars.set("reading", done, total))
        bars.set("evaluating", 0, 3)
        calibration = calibrate_session(observed)
        save(calibration, results.path("calibration.json"))
        bars.set("evaluating", 1, 3)
        evaluation = evaluate_session(observed, calibration)
        bars.set("evaluating", 2, 3)
        inputs = [replace(session_input(session), path=str(results.folder / "session"))]
        result = replace(session_result(evaluation, (), "demo", described.seed), inputs=tuple(inputs))
        truth = _truth(result, bench, devices.transport)
        largest_rel = max(map(abs, truth["error_rel"]))
        compared = info("simulated-luminance", largest_rel=largest_rel, meter_scale_rel=specimens.meter.scale_rel)
        result = replace(result, tables=(*result.tables, truth), findings=(*result.findings, compared))
        of_calibration = calibration_result(calibration, configuration.name, inputs)
        written = [
            *results.add(calibration_files(calibration, of_calibration)),
            *results.add(session_files(evaluation, result)),
        ]
        bars.set("evaluating", 3, 3)
    return result, [results.folder / "session", results.folder / "calibration.json", *written]


def _truth(result: Result, bench: SimulatedBench, transport: str) -> Table:
    """Compare the calibrated luminance with the simulated one."""
    luminance = result.table("luminance")
    patches, calibrated = luminance["patch"], luminance["calibrated_cd_m2"]
    simulated = [bench.luminance_cd_m2[patch] for patch in patches]
    columns = (
        Column("patch", "patch"),
        Column("simulated_cd_m2", "simulated", "cd/m²", "Luminance of the simulated target."),
        Column("calibrated_cd_m2", "calibrated", "cd/m²", "From the calibrated camera."),
        Column("error_rel", "error", "%", "Calibrated over simulated, minus 1.", decimals=2),
        Column("transport", "camera", "", "How frames of the simulated camera were transferred."),
    )
    errors_rel = [value / true - 1 for value, true in zip(calibrated, simulated, strict=True)]
    values = (patches, simulated, calibrated, errors_rel, [transport] * len(patches))
    data: dict[str, Any] = {column.name: of_column for column, of_column in zip(columns, values, strict=True)}
    return Table("simulation", "Calibrated and simulated luminance", columns, data, detail=True)


#: Template: what makes its text, and the command that uses the file.
_TEMPLATES = {
    "bench": (example_configuration, "labcdp acquire {file} my-session --simulated"),
    "chain": (lambda: preset_text("manta-g505"), "labcdp simulate {file}"),
    "camera": (example_camera, "labcdp image PICTURE --camera-spec {file}"),
    "chart": (lambda: chart_template("grid-6x6"), 'labcdp image PICTURE --chart {file} --corners "X,Y X,Y X,Y X,Y"'),
    "requirement": (requirement_template, "labcdp compare CHAIN --require {file}"),
    "simulated-bench": (example_simulated_bench, "labcdp acquire PLAN rehearsal --simulated-bench {file}"),
}


def init(
    template: Literal["bench", "chain", "camera", "chart", "requirement", "simulated-bench", "samples"],
    file: Path,
    *,
    preset: str | None = None,
    sensor: Path | None = None,
    force: Force = False,
) -> None:
    """Write a commented template of a plan, a chain, a camera, a chart, a requirement or a simulated bench.

    Or a folder of samples: a picture, a video and their regions, to try labcdp image and labcdp video with.

    Example: labcdp init bench bench.toml

    Parameters
    ----------
    template
        bench: plan of an acquisition; chain: imaging chain; camera: camera specification; chart: patches of a chart
        and their values; requirement: what a camera must detect; simulated-bench: its devices;
        samples: night.png, drive.mp4 and rois.json, a computed street at night.
    file
        New TOML file to write, or folder for the samples.
    preset
        For a chain: preset to start from, see labcdp presets; default: manta-g505. For a chart: step-20, grid-6x6,
        circle-20 or thesis-2x2; default: grid-6x6.
    sensor
        For a chain: EMVA 1288 results for its sensor, from labcdp characterise (results.json or folder) or from a data
        sheet (TOML with a table emva1288); the preset gives the rest.
    """
    if template != "samples":
        output_file(file, force, option="FILE")
    for option, given in (("--preset", preset), ("--sensor", sensor)):
        has_one = template == "chain" or (template == "chart" and option == "--preset")
        if given is not None and not has_one:
            raise InputError(f"{option} is {str(given)!r}, but {template} has none: leave it out")
    if template == "samples":
        try:
            file.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{file} cannot be made ({reason(error)}): give a new folder") from error
        samples = {output_file(file / name, force, option="FILE"): data for name, data in sample_files().items()}
        for path, data in samples.items():
            write_file(path, data, force=force)
        _tell(template, file, f"labcdp image {shell_word(file / 'night.png')} --roi {shell_word(file / 'rois.json')}")
        return
    text, following = _TEMPLATES[template]
    if sensor is not None:
        written = chain_text(preset or "manta-g505", sensor)
    else:
        named = chart_template if template == "chart" else preset_text
        written = text() if preset is None else named(preset)
    write_file(file, written.encode(), force=force)
    _tell(template, file, following.format(file=shell_word(file)))


def _tell(template: str, file: Path, command: str) -> None:
    columns = (Column("template", "template"), Column("next_command", "next command"))
    table = Table("template", "Template", columns, {"template": [template], "next_command": [command]}, detail=True)
    print_result(Result("init", str(file), (table,)), f"Written: {file}", f"Next: {command}")
