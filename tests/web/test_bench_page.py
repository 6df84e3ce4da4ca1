"""The live bench in Chromium, on the simulated bench."""

import re
import shutil
import signal
import time
from contextlib import suppress

import pytest

from labcdp.session import Session, SessionConfiguration, example_session

from ..conftest import CHROMIUM, valid

pytestmark = [
    pytest.mark.usefixtures("aravis"),
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed"),
]
BENCH = ("bench", "plan.toml", "--simulated-bench", "bench.toml")


def small_plan():
    """Four patches and two exposures of the demonstration's target."""
    plan = SessionConfiguration.load(example_session() / "session.toml")
    names = ("upper left", "upper right", "lower left", "lower right")
    patches = tuple(patch for patch in plan.target.patches if patch.name in names)
    pairs = tuple(pair for pair in plan.contrasts if {pair.bright, pair.dark} <= set(names))
    changes = {"exposures_s": (0.002, 0.032), "frames_per_exposure": 2, "readings_per_patch": 1}
    return plan.model_copy(
        update={
            "camera": plan.camera.model_copy(update={"region": (0, 0, 480, 400)}),
            "target": plan.target.model_copy(update={"patches": patches}),
            "plan": plan.plan.model_copy(update=changes),
            "contrasts": pairs,
        }
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the bench runs."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "plan.toml").write_text(small_plan().to_toml())
    # Each frame is drawn by the browser without a graphics card: at 15 frames/s that is most of the work.
    (folder / "bench.toml").write_text("[camera]\nframe_rate_hz = 2\n")
    return folder


@pytest.fixture(scope="module")
def served(folder, serve):
    """A live bench that ends cleanly."""
    served = serve(*BENCH, "--json", folder=folder)
    yield served
    assert served.stop()[0] == 0
    assert valid(served.process.stdout.read())["simulated"]


class Bench:
    """The page in a tab, and a person at it."""

    def __init__(self, page, served):
        self.page = page
        page.set_default_timeout(120_000)
        answer = page.goto(served.url)
        assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
        self.card_when(0, "fps")

    def card_when(self, index, pattern):
        """Text of a card without its title, once it is as it should become."""
        found = self.page.locator(".card").nth(index).filter(has_text=re.compile(pattern, re.DOTALL))
        found.wait_for()
        return str(found.inner_text()).split("\n", 1)[1]

    def fill(self, label, text):
        field = self.page.get_by_label(label)
        field.fill(text)
        field.press("Enter")

    def button(self, name):
        return self.page.get_by_role("button", name=name, exact=True)

    def tab(self, number):
        """Show a tab by its key, which is no text in a field."""
        self.page.evaluate("document.activeElement?.blur()")
        self.page.keyboard.press(str(number))

    def expose(self, exposure):
        self.fill("Exposure (ms)", exposure)
        self.card_when(0, rf"fps\D*{exposure} ms")

    def record(self, name, until):
        """Record the plan into a folder by Enter alone; return what was asked."""
        self.tab(5)
        self.fill("Folder of the session", name)
        self.button("Record the plan").click()
        asked, until_s = [], time.monotonic() + 300
        while not until():
            assert time.monotonic() < until_s, self.page.locator(".card").all_inner_texts()
            # A question may change while the hand is on its way.
            with suppress(Exception):
                focused = self.button("Done").evaluate("button => button.matches(':focus')", timeout=100)
                question = self.page.get_by_role("alert").inner_text(timeout=2000)
                if focused:
                    asked += [question] if question not in asked[-1:] else []
                    self.page.keyboard.press("Enter")
                    # A second Enter would answer the next one, but one that the page missed is given again.
                    self.page.get_by_role("alert").filter(has_text=question).wait_for(state="hidden", timeout=20_000)
            self.page.wait_for_timeout(100)
        return asked

    def shows(self, text):
        return bool(self.page.get_by_text(text).first.is_visible())


@pytest.fixture(scope="module")
def bench(browser, served):
    """A page for all tests: to open one takes longer than most of them."""
    bench = Bench(browser.new_page(viewport={"width": 1280, "height": 800}), served)
    yield bench
    bench.page.close()


# The element that holds the shadow tree of another; nothing where the other was replaced meanwhile.
HOST = "element => element.getRootNode().host ?? null"


def number(text):
    return float(re.findall(r"-?\d+\.?\d*", text)[0])


@pytest.mark.long
def test_a_recording_goes_on_after_its_server_was_killed(browser, tmp_path, folder, serve):
    # The first test: there is one simulated camera on loopback at a time.
    for name in ("plan.toml", "bench.toml"):
        shutil.copy(folder / name, tmp_path)
    page = browser.new_page()
    first = serve(*BENCH, folder=tmp_path)
    bench = Bench(page, first)
    before = bench.record("mine", lambda: bench.shows("patch upper right"))
    first.stop(signal.SIGKILL)
    page.get_by_text("labcdp cannot be reached").wait_for()
    second = serve(*BENCH, folder=tmp_path)
    again = Bench(page, second)
    (tmp_path / "mine-evaluate").mkdir()
    after = again.record("mine", lambda: again.shows("Open the report"))
    page.get_by_text("mine-evaluate-2/report.html").wait_for()
    # An earlier report stays.
    assert not any((tmp_path / "mine-evaluate").iterdir())
    assert second.stop()[0] == 0
    page.close()
    # What was read before is not asked again; the lens is.
    assert not (set(before) - {before[0]}) & set(after)
    with Session.open(tmp_path / "mine") as session:
        session.verify()
        assert (len(session.frames("light")), len(session.readings())) == (4, 4)


def test_saturation_contrast_and_verdict_follow_the_exposure(bench):
    bench.tab(1)
    # At 32 ms the brightest patches of the target are saturated, and the page does not call that detected.
    for exposure, verdict in (("32", "saturated"), ("500", "saturated.*both regions"), ("2", "detected")):
        bench.expose(exposure)
        bench.card_when(1, verdict)
    # The true contrast of upper left and lower right is 358 / 33.8 - 1; the vignetting of the plan's lens is corrected.
    assert number(bench.card_when(2, r"[89]\d\d")) == pytest.approx(959, rel=0.02)
    # A list has a row for each contrast, also a range; a comma in a single number is that of decimals.
    bench.fill("Target contrast", "88%,850%:950%:3")
    bench.card_when(1, r"3 of 4\s*detected")
    assert bench.page.locator(".contrasts tbody tr").first.inner_text().endswith("too strong")
    # A long list keeps its place while frames come.
    bench.fill("Target contrast", "700%:1100%:20")
    bench.card_when(1, "of 20")
    # The table is replaced with each frame; its pane stays.
    pane = next(filter(None, (bench.page.locator(".contrasts").evaluate_handle(HOST).as_element() for _ in range(100))))
    pane.evaluate("pane => pane.scrollTop = 99")
    bench.page.wait_for_timeout(2000)
    assert pane.evaluate("pane => pane.scrollTop") == 99
    bench.fill("Target contrast", "880,5")
    bench.card_when(1, r"detected.*target contrast 880\.5 %")
    bench.fill("Target contrast", "88%,100")
    bench.page.locator(".notice", has_text="the target contrast is '100'").wait_for()


# Notes value and lines of the card of the pair each time it changes.
WATCH = """() => {
  window.noted = []
  const all = (root) => [...root.querySelectorAll("*")]
    .flatMap((one) => [one, ...(one.shadowRoot ? all(one.shadowRoot) : [])])
  const look = () => {
    const card = all(document).filter((one) => one.classList?.contains("card"))[1]
    if (card && card.innerText != window.noted.at(-1))
      window.noted.push(card.innerText)
    if (window.noting)
      requestAnimationFrame(look)
  }
  window.noting = true
  look()
}"""


def test_a_card_has_the_numbers_of_the_contrast_and_the_tolerance_that_it_names(bench):
    """Nearly all pairs of pixels have the contrast within 50 %, few within 0.5 %, and none has a third of it."""
    bench.tab(1)
    bench.expose("2")
    bench.fill("Target contrast", "880")
    bench.fill("Tolerance", "50")
    bench.card_when(1, r"target contrast 880 %, ε 50 %")
    bench.page.evaluate(WATCH)
    for label, typed, named in (
        ("Tolerance", "0,5", "target contrast 880 %, ε 0.5 %"),
        ("Tolerance", "50", "target contrast 880 %, ε 50 %"),
        ("Target contrast", "300", "target contrast 300 %, ε 50 %"),
        ("Target contrast", "880", "target contrast 880 %, ε 50 %"),
    ):
        bench.fill(label, typed)
        bench.card_when(1, re.escape(named))
    noted = bench.page.evaluate("() => { window.noting = false; return window.noted }")
    seen = {}
    for text in noted:
        if found := re.search(r"target contrast (\S+) %, ε (\S+) %", text):
            seen.setdefault(found.groups(), []).append(float(text.split("\n")[1].split()[0]))
    assert set(seen) == {("880", "50"), ("880", "0.5"), ("300", "50")}
    assert min(seen["880", "50"]) > 0.9
    assert max(seen["880", "0.5"]) < 0.5
    assert max(seen["300", "50"]) < 0.1


def test_the_pair_is_chosen_on_the_first_screen_of_live(bench):
    bench.tab(1)
    for label in ("Contrast of", "and of", "Target contrast", "Tolerance"):
        box = bench.page.get_by_label(label).first.bounding_box()
        assert box["y"] + box["height"] < 800, label


def test_fields_of_the_camera_take_decimal_commas_and_refuse_binning_with_regions(bench):
    for typed, shown in (("1,5", r"1\.5"), ("0", "0")):
        bench.tab(1)
        bench.fill("Gain (dB)", typed)
        bench.tab(2)
        bench.page.get_by_text(re.compile(rf"In effect: .*, {shown} dB,")).first.wait_for()
    bench.fill("Set a feature", "BinningHorizontal = 2")
    bench.page.locator(".notice", has_text="Binning").wait_for()
    bench.fill("Set a feature", "")
    bench.page.locator(".notice", has_text="Binning").wait_for(state="detached")


def test_the_meter_reads_the_patch_that_is_selected(bench):
    bench.tab(3)
    bench.page.locator("tr[data-region]", has_text="lower left").first.click()
    bench.tab(1)
    bench.button("Read meter").click()
    assert number(bench.card_when(3, "lower left")) == pytest.approx(414, rel=0.02)
    before = bench.page.locator("table.readings tbody tr").count()
    bench.fill("Reading of another meter", "400,5")
    assert number(bench.card_when(3, r"400\.5")) == 400.5
    # The second one is refused, so that the first one has been counted however often it was sent.
    bench.fill("Reading of another meter", "no number")
    bench.page.locator(".notice", has_text="no number").wait_for()
    assert bench.page.locator("table.readings tbody tr").count() == before + 1


def test_a_second_browser_looks_on_until_it_takes_control(bench, browser, served):
    other = Bench(browser.new_page(), served)
    other.button("Take control").wait_for()
    assert other.page.get_by_label("Exposure (ms)").is_disabled()
    other.button("Take control").click()
    bench.button("Take control").wait_for()
    assert bench.page.get_by_label("Exposure (ms)").is_disabled()
    other.page.close()
    bench.button("Take control").click()
    bench.button("Take control").wait_for(state="hidden")
