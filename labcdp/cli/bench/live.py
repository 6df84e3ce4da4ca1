"""Command bench: the live bench in the browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import typer

from ...acquire.plan import prepare_camera
from ...core.errors import InputError
from ...core.result import Quantity, Result, quantity_table
from ...core.table import Column, Table
from ...drivers.aravis.camera import AravisCamera
from ...drivers.camera import Camera
from ...drivers.simulated.bench import SimulatedBench
from ...evaluate.picture.conversion import PictureConversion, picture_conversion
from ...regions import PolygonShape, RectangleShape
from ...session import SessionConfiguration, example_configuration
from ...session.tables import MeterConfiguration
from ...web.bench.desk import BenchOfPage
from ...web.bench.live_bench import LiveBench
from ...web.bench.live_camera import LiveCamera
from ...web.bench.page import BenchPage
from ...web.bench.pair import Target
from ...web.lock import locked
from ...web.regions.files import DrawingFiles, Start
from ...web.regions.workspace import Workspace
from ...web.server import Address, Server, Site
from ..options import (
    ADDRESS_OPTION,
    METER_MODEL_OPTION,
    METER_OPTION,
    PORT_OPTION,
    SIMULATED_BENCH_OPTION,
    parse_contrasts,
)
from ..output import output_file
from ..terminal import JSON_OPTION, fraction_of_percent, print_result, say, say_where
from .device_options import DeviceChoice
from .devices_of_session import note_bench, serial_meter, simulated_bench_file, simulated_devices

#: How long the camera streams for a tab that was closed: it may be reloaded.
_LIFETIME_S = 5.0


@dataclass(frozen=True)
class LiveDevices:
    """Options for camera and meter."""

    camera: str | None = typer.Option(
        None, help="Serial number, address or model; default: as in the plan, else the only one."
    )
    meter: str | None = METER_OPTION
    meter_model: Literal["LS-110", "LS-100"] = METER_MODEL_OPTION
    simulated: bool = typer.Option(False, "--simulated", help="Use the simulated bench instead of devices.")
    simulated_bench: Path | None = SIMULATED_BENCH_OPTION

    @contextmanager
    def opened(self, plan: Path | None) -> Iterator[tuple[Camera, BenchOfPage]]:
        """Open the devices; raises InputError if options contradict each other."""
        simulated = self.simulated or self.simulated_bench is not None
        choice = DeviceChoice(self.camera, self.meter, simulated=simulated, simulated_bench=self.simulated_bench)
        configuration = None if plan is None else SessionConfiguration.load(plan)
        if simulated:
            configuration = configuration or SessionConfiguration.from_toml(
                example_configuration(), "the demonstration's"
            )
            opening = _simulated(configuration, choice)
        else:
            opening = self._real(configuration, choice)
        with opening as opened:
            yield opened

    @contextmanager
    def _real(self, plan: SessionConfiguration | None, choice: DeviceChoice) -> Iterator[tuple[Camera, BenchOfPage]]:
        wanted = None if plan is None else plan.camera
        selector = self.camera or (None if wanted is None else wanted.serial or wanted.address or wanted.model)
        unplanned = {"model": self.meter_model, "serial": "unknown"}
        described = plan.meter if plan else MeterConfiguration.model_validate(unplanned)
        port = self.meter or described.port
        with ExitStack() as stack:
            camera = stack.enter_context(AravisCamera(selector))
            meter = None
            if port is not None and described.entry == "serial":
                meter = serial_meter(stack, described, port, choice)
            yield camera, BenchOfPage(meter, plan)


@dataclass(frozen=True)
class Detection:
    """Options for the contrast to detect."""

    contrast: str | None = typer.Option(None, help="Contrast to detect, for example 100%.", show_default="as measured")
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast.")

    def target(self) -> Target:
        """Return what is to be detected; raises InputError."""
        contrasts = (None,) if self.contrast is None else parse_contrasts([self.contrast])
        if len(contrasts) != 1:
            raise InputError("--contrast of the live bench is one contrast: give for example 100%")
        return Target(contrasts[0], fraction_of_percent(self.epsilon, "--epsilon"))


@dataclass(frozen=True)
class LivePage:
    """Options for the page."""

    port: int = PORT_OPTION
    address: str = ADDRESS_OPTION
    open_page: bool = typer.Option(True, "--open/--no-open", help="Open the page in the browser.")


def bench(
    context: typer.Context,
    chosen: LiveDevices,
    detection: Detection,
    page: LivePage,
    plan: Path | None = typer.Argument(
        None,
        help="TOML file with bench, target and plan; see labcdp init bench.",
        show_default="patches drawn on the page",
    ),
    calibration: Path | None = typer.Option(None, help="Calibration file, for values in cd/m²."),
    roi: Path = typer.Option(
        Path("bench.rois.json"), help="Region file to start from and to save to; without it, the patches of the plan."
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Show camera and meter live in the browser: regions, luminance and CDP of what is seen now.

    The camera streams while the page is open and is released when it is closed. Exposure and gain are changed on the
    page and read back; a lost camera is waited for. Ctrl-C ends the command.

    Example: labcdp bench --simulated
    """
    target, conversion = detection.target(), picture_conversion(calibration, None, None)
    if not roi.exists():
        output_file(context, roi, False, "--roi")
    with locked(roi) as tell_others:
        server = Server(page.address, page.port)

        def ready(where: Address) -> None:
            tell_others(where.place)
            say_where(where)
            if page.open_page:
                typer.launch(where.url)

        with chosen.opened(plan) as (camera, devices):
            live, last_words = _serve(camera, devices, conversion, roi, target, server, ready)
    if as_json:
        print_result(_result(live, roi), as_json)
    else:
        for line in last_words:
            say(line)


@contextmanager
def _simulated(plan: SessionConfiguration, choice: DeviceChoice) -> Iterator[tuple[Camera, BenchOfPage]]:
    described = simulated_bench_file(choice.simulated_bench)
    with (
        SimulatedBench(plan, described.devices(choice.simulated_bench)) as bench,
        simulated_devices(plan, bench) as opened,
    ):
        meter = opened.meter if plan.meter.entry == "serial" else None
        yield opened.camera, BenchOfPage(meter, plan, bench, lambda session: note_bench(session, described))


def _serve(
    camera: Camera,
    devices: BenchOfPage,
    conversion: PictureConversion,
    roi: Path,
    target: Target,
    server: Server,
    ready: Callable[[Address], None],
) -> tuple[LiveBench, list[str]]:
    """Serve the page until it is stopped; return the bench and what to say then."""
    settings, plan = _settings(devices.plan), devices.plan

    def prepare(camera: Camera) -> None:
        if plan is not None:
            prepare_camera(camera, plan.camera)

    stated = (lambda frame: frame) if plan is None else plan.camera.stated
    prepare(camera)
    camera.configure(**settings)
    frame = stated(camera.snap())
    camera.close()
    live = LiveBench(LiveCamera(camera, settings, prepare, stated), conversion, devices, server, target)
    files = DrawingFiles(roi, (frame.dn.shape[1], frame.dn.shape[0]))
    first = live.measurements(live.images.image(frame))
    workspace = Workspace(first, files, _start(files, devices.plan), server.elsewhere)
    tab, begin = lambda document: BenchPage(live, document).tab(), lambda: live.begin(workspace)
    try:
        server.run(Site("labcdp bench", tab, begin, workspace.warn, _LIFETIME_S, lambda: live.results), ready)
    finally:
        live.end()
    return live, workspace.last_words()


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
    patches = () if configuration is None or files.output.exists() else configuration.target.patches
    planned = tuple(
        RectangleShape(patch.name, *patch.roi, limits_cd_m2=patch.limits_cd_m2)
        if patch.roi
        else PolygonShape(patch.name, patch.region().corners, limits_cd_m2=patch.limits_cd_m2)
        for patch in patches
    )
    start = Start.of(files, planned)
    drawing = start.history.present
    names = {roi.name for roi in drawing.rois}
    for pair in () if configuration is None else configuration.contrasts:
        if {pair.bright, pair.dark} <= names:
            drawing = drawing.paired(pair.bright, pair.dark)
            break
    return replace(start, history=replace(start.history, present=drawing))


def _result(live: LiveBench, roi: Path) -> Result:
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
