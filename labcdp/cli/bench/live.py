"""Command bench: the live bench in the browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from ...core.errors import InputError
from ..options import METER_MODEL_OPTION, METER_OPTION, parse_contrasts
from ..output import output_file
from ..terminal import JSON_OPTION, fraction_of_percent, print_result, say, say_where

if TYPE_CHECKING:
    from ...core.result import Result
    from ...drivers.camera import Camera
    from ...session import SessionConfiguration
    from ...web.bench.live_bench import LiveBench
    from ...web.bench.measured import BenchOfPage, Target
    from ...web.regions.files import DrawingFiles
    from ...web.regions.workspace import Start
    from ...web.server import Address

#: How long the camera streams for a tab that was closed: it may be reloaded.
_LIFETIME_S = 5.0


def bench(
    context: typer.Context,
    plan: Path | None = typer.Argument(
        None,
        help="TOML file with bench, target and plan; see labcdp init bench.",
        show_default="patches drawn on the page",
    ),
    camera: str | None = typer.Option(
        None, help="Serial number, address or model; default: as in the plan, else the only one."
    ),
    meter: str | None = METER_OPTION,
    meter_model: Literal["LS-110", "LS-100"] = METER_MODEL_OPTION,
    simulated: bool = typer.Option(False, "--simulated", help="Use the simulated bench instead of devices."),
    calibration: Path | None = typer.Option(None, help="Calibration file, for values in cd/m²."),
    roi: Path = typer.Option(
        Path("bench.rois.json"), help="Region file to start from and to save to; without it, the patches of the plan."
    ),
    contrast: str | None = typer.Option(None, help="Contrast to detect, for example 100%.", show_default="as measured"),
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast."),
    port: int = typer.Option(0, min=0, max=65535, help="Port of the page; default: any free port."),
    address: str = typer.Option(
        "127.0.0.1", help="Address of the page. The default can be reached from this computer and through ssh."
    ),
    open_page: bool = typer.Option(True, "--open/--no-open", help="Open the page in the browser."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Show camera and meter live in the browser: regions, luminance and CDP of what is seen now.

    The camera streams while the page is open and is released when it is closed. Exposure and gain are changed on the
    page and read back; a lost camera is waited for. Ctrl-C ends the command.

    Example: labcdp bench --simulated
    """
    from ...session import SessionConfiguration, example_configuration
    from ...web.bench.measured import Target
    from ...web.lock import locked

    contrasts = None if contrast is None else parse_contrasts([contrast])
    if contrasts is not None and len(contrasts) != 1:
        raise InputError("--contrast of the live bench is one contrast: give for example 100%")
    target = Target(None if contrasts is None else contrasts[0], fraction_of_percent(epsilon, "--epsilon"))
    if not roi.exists():
        output_file(context, roi, False, "--roi")
    if simulated and (camera is not None or meter is not None):
        raise InputError("--simulated has its own camera and meter: leave out --camera and --meter")
    if plan is not None:
        configuration = SessionConfiguration.load(plan)
    elif simulated:
        configuration = SessionConfiguration.from_toml(example_configuration(), "the demonstration's configuration")
    else:
        configuration = None
    if simulated and configuration is not None:
        opened = _simulated(configuration)
    else:
        opened = _real(configuration, camera, meter, meter_model)
    with locked(roi) as tell_others, opened as (device, devices):
        _serve(device, devices, calibration, roi, target, (address, port, open_page, tell_others), as_json)


@contextmanager
def _simulated(configuration: SessionConfiguration) -> Iterator[tuple[Camera, BenchOfPage]]:
    from ...drivers.simulated.bench import BenchDevices, SimulatedBench
    from ...web.bench.measured import BenchOfPage
    from .devices_of_session import simulated_devices

    with (
        SimulatedBench(configuration, BenchDevices.standard()) as bench,
        simulated_devices(configuration, bench) as opened,
    ):
        yield opened.camera, BenchOfPage(opened.meter, configuration, bench)


@contextmanager
def _real(
    configuration: SessionConfiguration | None,
    camera: str | None,
    meter: str | None,
    model: Literal["LS-110", "LS-100"],
) -> Iterator[tuple[Camera, BenchOfPage]]:
    from ...drivers.aravis.camera import AravisCamera
    from ...drivers.minolta_ls.meter import MinoltaLS100, MinoltaLS110
    from ...web.bench.measured import BenchOfPage
    from .device_options import DeviceChoice
    from .devices_of_session import serial_meter

    wanted = None if configuration is None else configuration.camera
    selector = camera or (None if wanted is None else wanted.serial or wanted.address or wanted.model)
    port = meter or (None if configuration is None else configuration.meter.port)
    with ExitStack() as stack:
        opened = stack.enter_context(AravisCamera(selector))
        if port is None:
            yield opened, BenchOfPage(None, configuration)
        elif configuration is not None and configuration.meter.entry == "serial":
            yield opened, BenchOfPage(serial_meter(stack, configuration.meter, port, DeviceChoice()), configuration)
        else:
            driver = {"LS-110": MinoltaLS110, "LS-100": MinoltaLS100}[model]
            yield opened, BenchOfPage(stack.enter_context(driver(port)), configuration)


def _serve(
    camera: Camera,
    devices: BenchOfPage,
    calibration: Path | None,
    roi: Path,
    target: Target,
    place: tuple[str, int, bool, Callable[[str], None]],
    as_json: bool,
) -> None:
    from ...acquire.before import prepare_camera
    from ...evaluate.picture.light.picture import picture_conversion
    from ...web.bench.live_bench import LiveBench
    from ...web.bench.live_camera import LiveCamera
    from ...web.bench.page import BenchPage
    from ...web.regions.files import DrawingFiles
    from ...web.regions.workspace import Workspace
    from ...web.server import Server, Site

    address, port, open_page, tell_others = place
    conversion = picture_conversion(calibration, None, None)
    settings, plan = _settings(devices.plan), devices.plan

    def prepare(camera: Camera) -> None:
        if plan is not None:
            prepare_camera(camera, plan.camera)

    prepare(camera)
    camera.configure(**settings)
    frame = camera.snap()
    camera.close()
    server = Server(address, port)
    live = LiveBench(LiveCamera(camera, settings, prepare), conversion, devices, server, target)
    files = DrawingFiles(roi, (frame.dn.shape[1], frame.dn.shape[0]))
    workspace = Workspace(live.measurements(live.images.image(frame)), files, _start(files, devices.plan), server.elsewhere)
    tab, begin = lambda document: BenchPage(live, document).tab(), lambda: live.begin(workspace)
    site = Site("labcdp bench", tab, begin, workspace.warn, _LIFETIME_S, lambda: live.results)

    def ready(where: Address) -> None:
        tell_others(where.place)
        say_where(where)
        if open_page:
            typer.launch(where.url)

    try:
        server.run(site, ready)
    finally:
        live.end()
    if as_json:
        print_result(_result(live, roi), as_json)
    else:
        for line in workspace.last_words():
            say(line)


def _settings(configuration: SessionConfiguration | None) -> dict[str, Any]:
    """Return the settings to begin with: those of the plan, with its middle exposure."""
    if configuration is None:
        return {}
    plan = configuration.plan
    settings: dict[str, Any] = {"gain_db": plan.gain_db, "pixel_format": plan.pixel_format}
    if plan.exposures_s is not None:
        settings["exposure_s"] = sorted(plan.exposures_s)[len(plan.exposures_s) // 2]
    return settings


def _start(files: DrawingFiles, configuration: SessionConfiguration | None) -> Start:
    """Return the regions to begin with: drawn and not saved, or the file's, or the plan's patches."""
    from ...regions import PolygonShape, RectangleShape, load_regions
    from ...web.regions.drawing import Drawing, History
    from ...web.regions.workspace import Start

    stored = files.fingerprint(files.output)
    saved = load_regions(files.output, files.size) if stored else ()
    patches = () if configuration is None else configuration.target.patches
    planned = tuple(
        RectangleShape(patch.name, *patch.roi, limits_cd_m2=patch.limits_cd_m2)
        if patch.roi
        else PolygonShape(patch.name, patch.region().corners, limits_cd_m2=patch.limits_cd_m2)
        for patch in patches
    )
    drawing = Drawing.of(files.size, files.kept() or saved or planned)
    names = {roi.name for roi in drawing.rois}
    for pair in () if configuration is None else configuration.contrasts:
        if {pair.bright, pair.dark} <= names:
            drawing = drawing.paired(pair.bright, pair.dark)
            break
    return Start(History(drawing), saved, () if saved else planned, (), stored)


def _result(live: LiveBench, roi: Path) -> Result:
    from ...core.quantity import Quantity, quantity_table
    from ...core.result import Result
    from ...core.table import Column, Table

    state = live.camera.live
    received = [Quantity("frames received", state.n_frames), Quantity("incomplete frames", state.n_incomplete)]
    columns = (
        Column("region", "region"),
        Column("meter_cd_m2", "meter", "cd/m²"),
        Column("camera_cd_m2", "camera", "cd/m²"),
    )
    rows = [
        {"region": one.region, "meter_cd_m2": one.luminance_cd_m2, "camera_cd_m2": one.camera_cd_m2}
        for one in reversed(live.desk.readings)
    ]
    tables = (quantity_table("frames", "Frames", received), Table.of_rows("readings", "Readings", columns, rows))
    return Result("bench", str(roi), tables, configuration={"roi": str(roi)})
