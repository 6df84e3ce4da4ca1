"""Command bench: the live bench in the browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from ...acquire.plan import prepare_camera
from ...core.result import NamedValue, Result, quantity_table
from ...drivers.aravis.camera import AravisCamera
from ...drivers.camera import Camera, take_again
from ...drivers.simulated.bench import SimulatedBench
from ...evaluate.picture.converter import Converter, make_converter
from ...regions import PolygonShape, RectangleShape
from ...session import SessionConfiguration, example_configuration
from ...session.tables import MeterConfiguration
from ...web.bench.day_log import DayLog, log_tables
from ...web.bench.desk import BenchOfPage
from ...web.bench.live_bench import LiveBench
from ...web.bench.live_camera import LiveCamera
from ...web.bench.page import BenchPage
from ...web.bench.pair import EPSILON, Target, planned_pairs
from ...web.regions.files import DrawingFiles, Start, locked
from ...web.regions.workspace import Workspace
from ...web.server import Address, Server, Site
from ..commands import As
from ..options import Contrasts, MeterModel, PageOptions, output_file
from ..terminal import print_result
from ..values import parse_tolerance
from .connected import note_bench, serial_meter, simulated_bench_file, simulated_devices, with_own_camera
from .options import BenchDevices, DeviceOptions

#: How long the camera streams for a tab that was closed: it may be reloaded.
_LIFETIME_S = 5.0


@dataclass(frozen=True)
class LiveDevices(BenchDevices):
    """Options for camera and meter of the page."""

    meter_model: MeterModel = "LS-110"

    @contextmanager
    def opened(self, plan: SessionConfiguration | None) -> Iterator[tuple[Camera, BenchOfPage]]:
        """Open the devices."""
        if self.simulating:
            plan = plan or SessionConfiguration.from_toml(example_configuration(), "the demonstration's")
            described = with_own_camera(simulated_bench_file(self.simulated_bench), self.simulated_bench)
            devices = described.devices(self.simulated_bench)
            with SimulatedBench(plan, devices) as bench, simulated_devices(plan, bench) as opened:
                meter = opened.meter if plan.meter.is_connected else None
                yield opened.camera, BenchOfPage(meter, plan, bench, lambda session: note_bench(session, described))
            return
        wanted = None if plan is None else plan.camera
        selector = self.camera or (None if wanted is None else wanted.serial or wanted.address or wanted.model)
        unplanned = {"model": self.meter_model, "serial": "unknown"}
        entry = plan.meter if plan else MeterConfiguration.model_validate(unplanned)
        port = self.meter or entry.port
        with ExitStack() as stack:
            camera = stack.enter_context(AravisCamera(selector))
            meter = None
            if port is not None and entry.is_connected:
                meter = serial_meter(stack, entry, port, DeviceOptions(patience=0.0))
            yield camera, BenchOfPage(meter, plan)


@dataclass(frozen=True)
class Detection:
    """Options for what is to be detected, which the page can change."""

    contrast: Contrasts = None
    epsilon: Annotated[
        float | None, As("Relative tolerance; default: from the plan, otherwise 50%.", parse=parse_tolerance)
    ] = None


def bench(
    chosen: LiveDevices,
    detection: Detection,
    page: PageOptions,
    plan: Path | None = None,
    *,
    calibration: Path | None = None,
    roi: Path = Path("bench.rois.json"),
    flicker: bool = False,
) -> None:
    """Show camera and meter live in the browser: regions, luminance and CDP of the current image.

    The camera streams while the page is open and is released when it is closed. Exposure and gain are changed on the
    page and read back; labcdp waits for a lost camera. Ctrl-C ends the command.

    Example: labcdp bench --simulated

    Parameters
    ----------
    plan
        TOML file with bench, target and plan; see labcdp init bench; default: patches drawn on the page.
    calibration
        Calibration file, for values in cd/m².
    roi
        Region file to start from and save to; if it does not exist, start with the patches of the plan.
    flicker
        Show the flicker of the chosen regions over the last 1200 frames: MMP, FMI, phases and beat.
    """
    converter = make_converter(calibration)
    configuration = None if plan is None else SessionConfiguration.load(plan)
    if not roi.exists():
        output_file(roi, False, "--roi")
    with locked(roi) as tell_others, ExitStack() as end:
        server = Server(page.address, page.port)

        def ready(where: Address) -> None:
            tell_others(where.url_without_token)
            page.served(end, where)

        with chosen.opened(configuration) as (camera, devices):
            live, workspace = _bench(camera, devices, converter, roi, detection, server, flicker)
            try:
                server.run(
                    Site(
                        "labcdp bench",
                        lambda document: BenchPage(live, document).tab(),
                        lambda: live.begin(workspace),
                        workspace.warn,
                        _LIFETIME_S,
                        lambda: live.results,
                    ),
                    ready,
                )
            finally:
                live.end()
    kept = [f"Log of the day: {live.log.path}"] if live.log.path.exists() else []
    print_result(_result(live, roi, bool(chosen.simulating)), *workspace.last_words("No region was changed"), *kept)


def _bench(
    camera: Camera,
    devices: BenchOfPage,
    converter: Converter,
    roi: Path,
    detection: Detection,
    server: Server,
    flicker: bool,
) -> tuple[LiveBench, Workspace]:
    """Return the bench, with the settings of the plan and its middle exposure, and the regions to begin with."""
    plan = devices.plan
    settings: dict[str, Any] = {}
    if plan is not None:
        settings |= {"gain_db": plan.plan.gain_db, "pixel_format": plan.plan.pixel_format}
        exposures_s = sorted(plan.plan.exposures_s or ())
        settings |= {"exposure_s": exposures_s[len(exposures_s) // 2]} if exposures_s else {}

    def prepare(camera: Camera) -> None:
        if plan is not None:
            prepare_camera(camera, plan.camera)

    stated = (lambda frame: frame) if plan is None else plan.camera.stated
    prepare(camera)
    camera.configure(**settings)
    frame = stated(camera.snap(on_refused=take_again))
    camera.close()
    target = Target(detection.contrast, EPSILON if detection.epsilon is None else detection.epsilon)
    planned = planned_pairs(plan, detection.contrast, detection.epsilon)
    streaming = LiveCamera(camera, settings, prepare, stated)
    live = LiveBench(streaming, converter, devices, server, target, planned, DayLog(roi), flicker)
    files = DrawingFiles(roi, (frame.dn.shape[1], frame.dn.shape[0]))
    first = live.measurements(live.images.image(frame))
    return live, Workspace(first, files, _start(files, plan), server.elsewhere)


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


def _result(live: LiveBench, roi: Path, simulated: bool) -> Result:
    state = live.camera.live
    simulated |= state.frame is not None and state.frame.camera.simulated
    received = [
        NamedValue("frames received", state.n_frames),
        NamedValue("incomplete frames", state.n_incomplete),
    ]
    tables = (quantity_table("frames", "Frames", received, detail=True), *log_tables(live.log.day))
    return Result("bench", str(roi), tables, configuration={"roi": str(roi)}, simulated=simulated)
