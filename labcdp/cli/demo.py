"""Command demo: one bench session from the first frame to the report, on the simulated bench."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..errors import InputError
from .terminal import JSON_OPTION, print_json, progress_bars, say

if TYPE_CHECKING:
    from ..evaluate import SessionEvaluation
    from ..session import SessionConfiguration


def demo(
    output: Path | None = typer.Option(
        None, "--output", "-o", help="New folder for session and results.", show_default="labcdp-demo"
    ),
    seed: int = typer.Option(0, help="Of the noise of camera and meter.", min=0),
    as_json: bool = JSON_OPTION,
) -> None:
    """Run the thesis' experiment on the simulated bench: record, calibrate, evaluate, report."""
    from ..session import SessionConfiguration, example_configuration
    from .session import show_evaluation

    started = time.monotonic()
    folder = output or _free_folder(Path("labcdp-demo"))
    configuration = SessionConfiguration.from_toml(example_configuration(), "the demonstration's configuration")
    result, details, written = _run(configuration, folder, seed)
    details["elapsed_s"] = round(time.monotonic() - started, 1)
    if as_json:
        print_json(result.to_dict() | details)
        return
    show_evaluation(result)
    say(
        f"Camera: {details['camera_transport']}; calibrated and simulated luminance differ by up to "
        f"{details['largest_error_rel']:.2%}, of which {details['meter_scale_rel']:.2%} is the simulated meter's scale"
    )
    say(f"Written in {details['elapsed_s']} s: {', '.join(str(path) for path in written)}")


def _run(
    configuration: SessionConfiguration, folder: Path, seed: int
) -> tuple[SessionEvaluation, dict[str, Any], list[Path]]:
    from ..acquire import acquire
    from ..calibration import save
    from ..drivers.simulated.bench import BenchDevices, SimulatedBench
    from ..evaluate import calibrate_session, evaluate_session, observe_session
    from ..report import write_calibration_report, write_results
    from ..session import Session
    from .devices_of_session import simulated_devices

    specimens = BenchDevices.standard(seed)
    bench = SimulatedBench(configuration, specimens)
    with Session.create(folder / "session", configuration) as session:
        session.add_event("simulated bench", {"seed": seed})
        with progress_bars() as bars:
            with simulated_devices(configuration, bench) as devices:
                acquire(session, devices.camera, devices.meter, devices.operator, bars.acquisition)
                transport = devices.transport
            observed = observe_session(session, report=lambda done, total: bars.update("reading", done, total))
            bars.update("evaluating", 0, 3)
            calibration = calibrate_session(observed)
            save(calibration, folder / "calibration.json")
            bars.update("evaluating", 1, 3)
            result = evaluate_session(session, observed, calibration)
            bars.update("evaluating", 2, 3)
            written = [
                *write_calibration_report(calibration, folder, configuration.name),
                *write_results(result, folder),
            ]
            bars.update("evaluating", 3, 3)
    errors = [row.calibrated.luminance_cd_m2 / bench.luminance_cd_m2[row.region.name] - 1 for row in result.patches]
    details = {
        "output": str(folder),
        "seed": seed,
        "camera_transport": transport,
        "simulated_luminance_cd_m2": bench.luminance_cd_m2,
        "largest_error_rel": max(errors, key=abs),
        "meter_scale_rel": specimens.meter.scale_rel,
    }
    return result, details, [session.path, folder / "calibration.json", *written]


def _free_folder(wanted: Path) -> Path:
    """Make the folder, or the same with a number behind it if it is taken: nothing recorded is overwritten."""
    folder, number = wanted, 1
    while True:
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
            folder = wanted.with_name(f"{wanted.name}-{number}")
        except OSError as error:
            raise InputError(f"{folder} cannot be made ({error.strerror}): give another --output") from error
        else:
            return folder
