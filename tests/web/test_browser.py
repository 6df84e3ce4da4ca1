"""The page in a browser, with a real mouse."""

import re
import signal

import pytest

from labcdp.evaluate.picture.converter import make_converter
from labcdp.files.read import read_picture
from labcdp.metrics import cdp
from labcdp.metrics.pair import evaluate_pair
from labcdp.regions import EllipseShape, PolygonShape, load_regions, rois_of
from labcdp.web.regions.display import DisplayScale

from ..conftest import CHROMIUM, wait_until
from .conftest import HEIGHT, WIDTH, known_dn

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

#: Where a place (x, y) of the image is on the screen.
ON_SCREEN = """([x, y]) => {
  const figure = Bokeh.documents[0].get_model_by_name("picture")
  const view = Bokeh.index.find_one(figure)
  const box = view.canvas_view.events_el.getBoundingClientRect()
  return [box.left + view.frame.x_scale.compute(x), box.top + view.frame.y_scale.compute(y)]
}"""
_DETAIL = """() => {
  const figure = Bokeh.documents[0].get_model_by_name("picture")
  const source = figure.renderers[1].data_source
  const [image] = source.get_column("image")
  const [x, y, dw, dh] = ["x", "y", "dw", "dh"].map(name => source.get_column(name)[0])
  return {shape: Array.from(image.shape), place: [x, y, dw, dh], values: Array.from(image)}
}"""


class Tab:
    """The page in a tab, and a person at it."""

    def __init__(self, page, served):
        self.page = page
        self.complaints = []
        self.asked = []
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", self._console)
        page.goto(served.url)
        page.get_by_text("Drag beside it moves the picture").wait_for()

    def _console(self, message):
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)

    def at(self, x, y):
        sx, sy = self.page.evaluate(ON_SCREEN, [x, y])
        return sx, sy

    def click(self, x, y):
        self.page.mouse.click(*self.at(x, y))

    def drag(self, start, end, hold_ms=0):
        self.page.mouse.move(*self.at(*start))
        self.page.mouse.down()
        # A hand may stay still for a moment, and moves in steps.
        self.page.wait_for_timeout(hold_ms)
        self.page.mouse.move(*self.at(*end), steps=4)
        self.page.mouse.up()

    def button(self, name):
        self.page.get_by_role("button", name=name, exact=True).click()

    def rows(self):
        """Cells of the table of regions."""
        cells = "rows => rows.map(row => Array.from(row.children, cell => cell.innerText.trim()))"
        return list(self.page.locator("table:not(.dense) tr[data-region]").evaluate_all(cells))

    def rows_when(self, condition, what):
        """Cells of the table, once all is measured and it is as it should become."""
        seen = []

        def met():
            seen[:] = self.rows()
            # Cells that are not drawn yet have no text.
            return not any("…" in row or not row[0] for row in seen) and condition(seen)

        wait_until(met, f"{what}; {self.notice()}")
        return seen

    def wait_for_rows(self, n):
        return self.rows_when(lambda rows: len(rows) == n, f"there are {n} regions")

    def notice(self):
        return " ".join(self.page.locator(".notice").all_inner_texts())

    def wait_for_notice(self, pattern):
        self.page.locator(".notice", has_text=re.compile(pattern)).wait_for(timeout=120_000)


@pytest.fixture
def open_tab(browser):
    contexts = []

    def new(served):
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.set_default_timeout(120_000)
        contexts.append(context)
        return Tab(context.new_page(), served)

    yield new
    for context in contexts:
        context.close()


def test_regions_are_drawn_measured_saved_and_read_again(picture, tmp_path, serve, open_tab):
    output = tmp_path / "regions.json"
    served = serve("rois", picture, "--output", output, "--contrast", "900%")
    tab = open_tab(served)

    # A polygon, corner by corner, closed on the first one; and a box.
    tab.page.get_by_role("button", name="Polygon").click()
    for corner in ((40, 60), (200, 60), (200, 300), (40, 300), (40, 60)):
        tab.click(*corner)
    tab.wait_for_rows(1)
    tab.page.get_by_role("button", name="Rectangle").click()
    tab.drag((400, 60), (560, 300))
    tab.wait_for_rows(2)

    # The corner of the box that was just drawn, then back, then forth.
    tab.drag((560, 300), (600, 340), hold_ms=400)
    small, large = str(160 * 240), str(200 * 280)
    for act, size in ((None, large), ("Undo", small), ("Redo", large)):
        if act is not None:
            tab.button(act)
        tab.rows_when(lambda rows, size=size: rows[1][1] == size, f"the box has {size} pixels")

    # What the table says is what labcdp says of the saved regions.
    tab.page.keyboard.press("Escape")
    tab.button("Save")
    tab.wait_for_notice("Saved: 2 regions in .*regions.json")
    first, second = rois_of(load_regions(output, (WIDTH, HEIGHT)))
    converter = make_converter()
    luminance = converter.luminance(read_picture(picture, converter.options))
    result = evaluate_pair(luminance, first, second, [9.0])
    rows = tab.wait_for_rows(2)
    for row, roi in zip(rows, (first, second), strict=True):
        values = roi.select(known_dn()).astype(float)
        assert row[1:4] == [str(values.size), f"{values.mean():.5g}", f"{values.std(ddof=1):.3g}"]
    shown = float(tab.page.locator("td.cdp").inner_text())
    # With the digits that its interval, which has the vignetting of an unknown lens, lets mean something.
    assert shown == pytest.approx(result.cdp.cdp[0], abs=5e-4)
    assert shown == pytest.approx(cdp(first.select(known_dn()), second.select(known_dn()), 9.0).cdp, abs=5e-4)

    # Ctrl-C ends it cleanly.
    assert tab.complaints == []
    assert served.stop() == (0, [f"Saved: {output}"])

    # What was saved is there again.
    again = serve("rois", picture, "--output", output)
    other = open_tab(again)
    assert [row[:4] for row in other.wait_for_rows(2)] == [row[:4] for row in rows]
    assert again.stop() == (0, ["Nothing was changed"])


def test_what_is_seen_of_a_picture_and_its_luminance(picture, tmp_path, serve, open_tab):
    tab = open_tab(serve("rois", picture, "--output", tmp_path / "regions.json"))
    readout = tab.page.locator(".readout")
    tab.page.mouse.move(*tab.at(50.5, 100.5))
    readout.get_by_text(re.compile(r"x 50, y 100 · DN 12340 · light")).wait_for()
    for _ in range(12):
        tab.page.mouse.wheel(0, -200)
    wait_until(lambda: tab.page.evaluate(_DETAIL)["place"][2] < 20, "single pixels are seen")
    tab.page.mouse.move(*tab.at(51.5, 100.5))
    readout.get_by_text(f"x 51, y 100 · DN {known_dn()[100, 51]} ").wait_for()
    detail = tab.page.evaluate(_DETAIL)
    x, y, width, height = map(int, detail["place"])
    assert detail["shape"] == [height, width]
    tones = DisplayScale.of(known_dn()).to_8_bit(known_dn()[y : y + height, x : x + width])
    assert detail["values"] == tones.ravel().tolist()
    tab.page.keyboard.press("f")
    wait_until(lambda: tab.page.evaluate(_DETAIL)["place"][2] >= WIDTH, "the whole picture is seen")


def test_two_tabs_show_one_drawing_which_a_killed_labcdp_keeps(picture, tmp_path, serve, open_tab):
    output = tmp_path / "regions.json"
    served = serve("rois", picture, "--output", output)
    tab, other = open_tab(served), open_tab(served)
    tab.page.keyboard.press("p")
    for corner in ((150, 150), (250, 250), (150, 250), (150, 150)):
        tab.click(*corner)
    tab.wait_for_rows(1)
    tab.page.keyboard.press("e")
    tab.drag((400, 50), (500, 150))
    other.wait_for_rows(2)
    other.click(450, 100)
    other.page.get_by_label("Name of the selected region").fill("lamp")
    other.page.keyboard.press("Enter")
    tab.rows_when(lambda rows: rows[1][0] == "lamp", "the other tab has the new name")

    # Nothing came from elsewhere, and a labcdp that is killed has lost nothing.
    strangers = [url for url in tab.asked if not url.startswith((f"http://127.0.0.1:{served.port}/", "blob:", "data:"))]
    assert strangers == []
    assert [text for text in tab.complaints + other.complaints if "WebSocket" not in text] == []
    served.stop(signal.SIGKILL)
    tab.page.get_by_role("alert").get_by_text("labcdp cannot be reached").wait_for()
    again = serve("rois", picture, "--output", output)
    assert any("Resuming with 2 regions unsaved" in line for line in again.lines)
    tab = open_tab(again)
    tab.wait_for_rows(2)
    tab.page.keyboard.press("Control+s")
    tab.wait_for_notice("Saved: 2 regions")
    first, second = load_regions(output, (WIDTH, HEIGHT))
    assert isinstance(first, PolygonShape)
    assert second == EllipseShape("lamp", 400, 50, 100, 100)
    assert {path.name for path in tmp_path.iterdir()} == {"regions.json", ".regions.json.lock"}
