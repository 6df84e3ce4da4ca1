"""The live bench: camera thread, verdict and exposure, and the page in a browser on the simulated bench."""

import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread
from typing import Any

import cv2
import numpy as np
import pytest

from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.luminance import LuminanceMap
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.evaluate.picture.light.picture import picture_conversion
from labcdp.regions import RectangleShape
from labcdp.session import Session, SessionConfiguration, example_session
from labcdp.web.bench.desk import MeterDesk
from labcdp.web.bench.exposure import better_exposure_s
from labcdp.web.bench.images import sharpness
from labcdp.web.bench.live_camera import Live, LiveCamera
from labcdp.web.bench.pair import LiveMeasurements, verdict
from labcdp.web.bench.recording import PageOperator, Question
from labcdp.web.regions.display import DisplayScale
from labcdp.web.regions.drawing import Drawing, History
from labcdp.web.regions.files import DrawingFiles, Start
from labcdp.web.regions.measurements import Measurements
from labcdp.web.regions.page import Page
from labcdp.web.regions.page_image import PageImage
from labcdp.web.regions.workspace import Workspace


def wait_for(camera: LiveCamera, condition: Callable[[Live], bool]) -> Live:
    """The state once it is as it should become."""
    until_s = time.monotonic() + 120
    while not condition(camera.live):
        assert time.monotonic() < until_s, camera.live
        camera.wait_for_news(camera.live, 1.0)
    return camera.live


@pytest.fixture
def bench(small_configuration: Any) -> Iterator[SimulatedBench]:
    with SimulatedBench(small_configuration, BenchDevices.standard(), (400, 480)) as bench:
        yield bench


def test_a_camera_streams_while_somebody_looks_and_keeps_its_settings_through_a_loss(bench: SimulatedBench) -> None:
    device = bench.in_process_camera()
    camera = LiveCamera(device, {"exposure_s": 0.002})
    camera.start()
    try:
        assert camera.live.frame is None
        leave = camera.look()
        wait_for(camera, lambda live: live.n_frames >= 3 and live.frame.exposure_s == 0.002)
        camera.request(exposure_s=0.004)
        wait_for(camera, lambda live: live.frame.exposure_s == 0.004)
        # A rejected setting is reported, and the others stay.
        camera.request(exposure_s=1e6)
        wait_for(camera, lambda live: "exposure" in live.error)
        before = camera.live.n_frames
        wait_for(camera, lambda live: live.n_frames > before + 2 and live.frame.exposure_s == 0.004)

        bench.run_command("vanish for 1 s")
        wait_for(camera, lambda live: not live.streaming and live.error != "")
        lost = camera.live.n_frames
        live = wait_for(camera, lambda live: live.n_frames > lost and live.streaming)
        assert live.frame.exposure_s == live.settings.exposure_s == 0.004

        leave()
        wait_for(camera, lambda live: not live.streaming)
        with device:  # released, so that another program may have it
            assert device.snap().exposure_s > 0
    finally:
        camera.stop()


def test_a_late_answer_does_not_count_for_the_next_question() -> None:
    operator = PageOperator(lambda: None, None)

    def steps() -> None:
        operator.cover_lens()
        operator.uncover_lens()

    def question_after(before: object) -> Question:
        until_s = time.monotonic() + 60
        while (asked := operator.question) is None or asked is before:
            assert time.monotonic() < until_s
            time.sleep(0.005)
        return asked

    person = Thread(target=steps)
    person.start()
    first = question_after(None)
    operator.answer(first, "Done")
    second = question_after(first)
    operator.answer(first, "Done")
    person.join(0.2)
    assert operator.question is second
    operator.answer(second, "Done")
    person.join(60)
    assert not person.is_alive()


@pytest.mark.parametrize(
    ("below", "above", "interval", "expected"),
    [
        (0.01, 0.02, (0.95, 0.99), "detected"),
        (0.9, 0.0, (0.05, 0.15), "too weak"),
        (0.0, 0.9, (0.05, 0.15), "too strong"),
        (0.05, 0.05, (0.85, 0.95), "undecided"),
        (0.0, 0.0, (float("nan"), float("nan")), "undecided"),
    ],
)
def test_the_verdict_follows_the_interval(
    below: float, above: float, interval: tuple[float, float], expected: str
) -> None:
    assert verdict(below, above, interval, 0.9) == expected


@pytest.mark.parametrize("start_s", [20e-6, 1e-3, 0.1, 10.0])
def test_the_exposure_of_a_linear_camera_is_found(start_s: float) -> None:
    exposure_s, highest, rng = start_s, 4095, np.random.default_rng(4)
    for _ in range(10):
        mean = 64 + 2e5 * exposure_s
        values = np.clip(rng.normal(mean, np.sqrt(mean), 10_000), 0, highest).astype(np.uint16)
        better_s = better_exposure_s(values, exposure_s, 12, (20e-6, 60.0))
        if better_s is None:
            break
        exposure_s = better_s
    mean = 64 + 2e5 * exposure_s
    assert 0.69 < (mean + 2.33 * np.sqrt(mean)) / highest < 0.91


def test_no_exposure_is_better_where_the_camera_has_none() -> None:
    dark = np.full(100, 70, np.uint16)
    assert better_exposure_s(dark, 60.0, 12, (20e-6, 60.0)) is None


@pytest.mark.parametrize(("pixel_format", "bits", "pattern"), [("Mono8", 8, None), ("BayerGB12", 12, "GB")])
def test_frames_of_8_bit_and_colour_cameras_are_shown_and_measured(
    pixel_format: str, bits: int, pattern: str | None
) -> None:
    dn = np.random.default_rng(9).integers(20, 200, (60, 80)).astype(np.uint8 if bits == 8 else np.uint16)
    dn[10:20, 10:30] = highest = 2**bits - 1
    frame = Frame(
        dn=dn,
        exposure_s=1e-3,
        gain_db=0.0,
        bit_depth=bits,
        saturation_dn=highest,
        black_level_dn=0.0,
        pixel_format=pixel_format,
        colour_filter=pattern,
        temperature_c=None,
        timestamp=datetime.now(UTC),
        camera_timestamp_ns=0,
        frame_id=1,
        camera=CameraIdentity("a", "b", "c"),
    )
    image = PageImage.of_frame("live", frame, picture_conversion(None, None, None))
    drawing = Drawing.of(image.size, [RectangleShape("lit", 10, 10, 20, 10), RectangleShape("dark", 40, 20, 20, 20)])
    (means,) = LiveMeasurements(image, None).means(drawing)
    lit, dark = (means[roi] for roi in drawing.rois)
    assert (lit.value, lit.saturated, dark.saturated) == (highest, 1.0, 0.0)
    assert dark.value == pytest.approx(dn[20:40, 40:60].mean())
    # Light is that of the green pixels: of a GB pattern those of even rows and columns, and of odd ones.
    part = dn[20:40, 40:60].astype(float)
    green = part if pattern is None else (part[::2, ::2] + part[1::2, 1::2]) / 2
    assert dark.light / lit.light == pytest.approx(green.mean() / highest, rel=1e-5)
    assert dark.light_std / lit.light == pytest.approx(green.std(ddof=1) / highest, rel=1e-5)
    assert image.readout(15.5, 12.5).endswith("saturated")
    # The register of the black level counts DN of 12 bits.
    of_register = replace(frame, black_level_dn=None, black_level_register=64.0)
    assert of_register.nominal_black_dn == (4.0 if bits == 8 else 64.0)
    # One displayed pixel for four of a pattern, with their mean.
    shown = image.display
    blocks = dn.astype(float).reshape(30, 2, 40, 2).mean(axis=(1, 3))
    assert np.abs(shown - (dn if pattern is None else blocks)).max() <= 0.5
    assert DisplayScale.of_range(highest).to_8_bit(shown).max() == 255


def test_a_meter_that_is_unplugged_in_a_series_is_waited_for(bench: SimulatedBench) -> None:
    from labcdp.drivers.minolta_ls.meter import MinoltaLS110

    nothing = LuminanceMap(np.zeros((4, 4)), np.zeros((4, 4)), (), np.zeros((4, 4), np.uint8))
    image = PageImage("live", np.zeros((4, 4), np.uint16), True, None, nothing, "relative")
    with MinoltaLS110(bench.in_process_port()) as meter:
        desk = MeterDesk(meter, bench, lambda: (image, ()), lambda: False)
        said = []
        for text in desk.take(meter, "", 3):
            said.append(text)
        assert said == [""]
        bench.run_command("meter unplug for 1 s")
        said = list(desk.take(meter, "", 2))
        assert "lost and waited for" in said[0]
        assert said[-1] == ""
    assert [one.n_readings for one in desk.readings] == [2, 3]


@pytest.mark.filterwarnings("ignore:.*will be removed in version 2.0:PendingDeprecationWarning")
def test_no_refreshes_pile_up_for_a_browser_that_sleeps(tmp_path: Path) -> None:
    from bokeh.document import Document

    values = np.zeros((40, 40), np.uint16)
    nothing = LuminanceMap(np.zeros((40, 40)), np.zeros((40, 40)), (), np.zeros((40, 40), np.uint8))
    image = PageImage("live", values, True, None, nothing, "relative")
    start = Start(History(Drawing.of(image.size, ())))
    space = Workspace(Measurements(image, None), DrawingFiles(tmp_path / "r.json", image.size), start, lambda *_: None)
    page = Page(space, Document())

    def refreshed() -> int:
        before = page.picture.link.told
        for _ in range(100):
            space.changed()
            for waiting in list(page.document.session_callbacks):
                page.document.remove_timeout_callback(waiting)
                waiting.callback()
        return page.picture.link.told - before

    assert refreshed() < 10
    assert refreshed() == 0
    page.picture.link.heard = page.picture.link.told
    assert 0 < refreshed() < 10


def small_plan() -> SessionConfiguration:
    """Six patches and two exposures of the demonstration's target."""
    plan = SessionConfiguration.load(example_session() / "session.toml")
    names = ("P01", "P07", "upper left", "upper right", "lower left", "lower right")
    patches = [patch for patch in plan.target.patches if patch.name in names]
    pairs = tuple(pair for pair in plan.contrasts if {pair.bright, pair.dark} <= set(names))
    short = plan.plan.model_copy(
        update={"exposures_s": (0.002, 0.032), "frames_per_exposure": 2, "readings_per_patch": 1}
    )
    target = plan.target.model_copy(update={"patches": tuple(patches)})
    camera = plan.camera.model_copy(update={"region": (0, 0, 480, 400)})
    return plan.model_copy(update={"camera": camera, "target": target, "plan": short, "contrasts": pairs})


@pytest.fixture
def live_page(tmp_path: Path) -> Iterator[tuple[Any, str]]:
    """The page of the simulated bench, in a browser, and its address."""
    from playwright.sync_api import sync_playwright

    (tmp_path / "plan.toml").write_text(small_plan().to_toml())
    # Each frame is drawn by the browser without a graphics card: at 15 frames/s that is most of the work.
    (tmp_path / "bench.toml").write_text("[camera]\nframe_rate_hz = 5\n")
    labcdp = Path(sys.executable).with_name("labcdp")
    command = [labcdp, "bench", "plan.toml", "--simulated-bench", "bench.toml", "--no-open"]
    with (
        subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process,
        sync_playwright() as playwright,
    ):
        assert process.stderr is not None
        url = next(line.split()[1] for line in process.stderr if line.startswith("Open: "))
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(300_000)
        answer = page.goto(url)
        assert answer is not None
        assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
        yield page, url
        browser.close()
        process.send_signal(signal.SIGINT)
        assert "Traceback" not in process.stderr.read()
        assert process.wait(300) == 0


def test_the_sharpest_image_of_a_scene_has_the_largest_value() -> None:
    rng = np.random.default_rng(5)
    scene = np.kron(rng.integers(1, 5, (20, 20)) * 400.0, np.ones((10, 10)))
    values = [sharpness(cv2.GaussianBlur(scene, (0, 0), width)) for width in (0.5, 1, 2, 4, 8)]
    assert values == sorted(values, reverse=True)
    assert sharpness(3 * scene) == pytest.approx(sharpness(scene))
    assert sharpness(np.zeros((50, 50))) == sharpness(np.ones((4, 4))) == 0


def number(text: str) -> float:
    return float(re.findall(r"-?\d+\.?\d*", text)[0])


@pytest.mark.usefixtures("aravis")
@pytest.mark.skipif(shutil.which("chromium") is None, reason="Chromium is not installed")
def test_the_page_shows_what_camera_and_meter_see_and_records_the_plan(
    live_page: tuple[Any, str], tmp_path: Path
) -> None:
    live_page, address = live_page

    def card_when(index: int, pattern: str) -> str:
        """Text of a card without its title, once it is as it should become."""
        found = live_page.locator(".card").nth(index).filter(has_text=re.compile(pattern, re.DOTALL))
        found.wait_for()
        return str(found.inner_text()).split("\n", 1)[1]

    card_when(0, r"fps.*32 ms")
    # At 32 ms the brightest patches of the target are saturated, and the page does not call that detected.
    card_when(1, "saturated")
    exposure = live_page.get_by_label("Exposure (ms)")
    exposure.fill("2")
    exposure.press("Enter")
    card_when(0, r"fps.*2 ms")
    card_when(1, "detected")
    # The true contrast of upper left and lower right is 358 / 33.8 - 1, less the vignetting of the lens.
    assert number(card_when(2, r"[89]\d\d")) == pytest.approx(880, rel=0.1)
    # Most pairs show more than 100 %.
    asked = live_page.get_by_label("Contrast to detect (%)")
    asked.fill("100")
    asked.press("Enter")
    assert number(card_when(1, "too strong")) == 0.0

    # The meter reads the patch that is selected.
    live_page.get_by_text("Regions", exact=True).first.click()
    live_page.locator("tr[data-region]", has_text="lower left").first.click()
    live_page.get_by_text("Live", exact=True).first.click()
    live_page.get_by_role("button", name="Read meter").click()
    assert number(card_when(3, "lower left")) == pytest.approx(414, rel=0.02)
    typed = live_page.get_by_label("Reading of another meter")
    typed.fill("400,5")
    typed.press("Enter")
    assert number(card_when(3, r"400\.5")) == 400.5
    live_page.get_by_role("button", name="Pause", exact=True).click()
    card_when(0, "paused")
    live_page.get_by_role("button", name="Pause", exact=True).click()

    # A second browser looks on until it takes control, and then the first one does.
    other = live_page.context.browser.new_page()
    other.set_default_timeout(300_000)
    other.goto(address)
    control = "Take control"
    other.get_by_role("button", name=control).wait_for()
    assert other.get_by_label("Exposure (ms)").is_disabled()
    other.get_by_role("button", name=control).click()
    live_page.get_by_role("button", name=control).wait_for()
    assert exposure.is_disabled()
    other.close()
    live_page.get_by_role("button", name=control).click()
    live_page.get_by_role("button", name=control).wait_for(state="hidden")

    # A smaller part of the sensor: regions outside it have no values, and come back with it.
    live_page.get_by_text("Camera", exact=True).last.click()
    live_page.get_by_text("ExposureTimeAbs", exact=True).wait_for()
    area = live_page.get_by_label("Region: x, y, width, height")
    area.fill("0, 0, 480, 200")
    area.press("Enter")
    live_page.get_by_text(re.compile("480 x 200 pixels")).first.wait_for()
    live_page.get_by_text("Luminance", exact=True).first.click()
    live_page.locator("table.dense tr", has_text=re.compile("lower left.*image", re.DOTALL)).wait_for()
    live_page.get_by_text("Camera", exact=True).last.click()
    area.fill("0, 0, 480, 400")
    area.press("Enter")
    live_page.get_by_text(re.compile("480 x 400 pixels")).first.wait_for()

    # The plan is recorded as on the terminal, with each manual step confirmed.
    live_page.get_by_text("Record", exact=True).first.click()
    folder = live_page.get_by_label("Folder of the session")
    folder.fill("mine")
    folder.press("Enter")
    live_page.get_by_role("button", name="Record the plan").click()
    from playwright.sync_api import TimeoutError  # noqa: A004

    report, done = live_page.get_by_text("Open the report"), live_page.get_by_role("button", name="Done", exact=True)
    asked = []
    until_s = time.monotonic() + 600
    while not report.is_visible():
        assert time.monotonic() < until_s, live_page.locator(".card").all_inner_texts()
        # A question may change while the hand is on its way.
        with suppress(TimeoutError):
            if done.is_visible():
                asked.append(live_page.get_by_role("alert").inner_text(timeout=2000))
                done.click(timeout=2000)
        live_page.wait_for_timeout(100)
    with live_page.expect_popup() as opened:
        report.click()
    opened.value.get_by_text("detected", exact=False).first.wait_for()
    assert any("Cover the lens" in one for one in asked)
    # Earlier results stay.
    (earlier,) = tmp_path.glob("mine-evaluate/report.html")
    live_page.get_by_role("button", name="Record the plan").click()
    live_page.get_by_text("mine-evaluate-2/report.html").wait_for()
    assert earlier.exists()
    with Session.open(tmp_path / "mine") as session:
        session.verify()
        assert (len(session.frames("light")), len(session.readings())) == (4, 6)
