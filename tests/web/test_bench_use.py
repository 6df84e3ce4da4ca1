"""The live bench in Chromium as a person uses it for a day: pairs, fields, messages, readings and their log, phones."""

import json
import re

import openpyxl
import pytest

from ..conftest import CHROMIUM
from .test_bench_page import BENCH, Bench, small_plan

pytestmark = [
    pytest.mark.usefixtures("aravis"),
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed"),
]

#: Notes heading and value of the cards of pair and contrast each time they change.
WATCH = """() => {
  window.seen = []
  const all = (root) => [...root.querySelectorAll("*")]
    .flatMap((one) => [one, ...(one.shadowRoot ? all(one.shadowRoot) : [])])
  window.watching = setInterval(() => {
    const cards = all(document).filter((one) => one.classList?.contains("card"))
    if (cards.length < 3)
      return
    const now = [cards[1].querySelector("h3").innerText, cards[1].querySelector("b").innerText,
      cards[2].querySelector("b").innerText]
    if (now.join() != window.seen.at(-1)?.join())
      window.seen.push(now)
  }, 15)
}"""
PICTURE = "Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('picture'))"
#: Where all that is pressed or typed in is, by its name.
PLACES = """() => {
  const all = (root) => [...root.querySelectorAll("*")]
    .flatMap((one) => [one, ...(one.shadowRoot ? all(one.shadowRoot) : [])])
  return Object.fromEntries(all(document).filter((one) => ["INPUT", "BUTTON", "SELECT"].includes(one.tagName))
    .map((one, at) => [one, at, one.getBoundingClientRect()])
    .filter(([one, at, box]) => box.width > 0 && one.checkVisibility({visibilityProperty: true})
      && !one.classList.contains("delete"))
    .map(([one, at, box]) => [`${at} ${one.tagName} ${one.innerText.slice(0, 20)}`, [box.x, box.y]]))
}"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "plan.toml").write_text(small_plan().to_toml())
    (tmp_path / "bench.toml").write_text("[camera]\nframe_rate_hz = 4\n")
    return tmp_path


@pytest.fixture
def start(folder, serve, browser):
    """Start the bench and open its page."""
    begun = []

    def begin(**options):
        served = serve(*BENCH, folder=folder)
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | options)
        begun.append((served, context))
        return served, Bench(context.new_page(), served)

    yield begin
    for served, context in begun:
        context.close()
        # There is one simulated camera on loopback at a time.
        if served.process.poll() is None:
            assert served.stop()[0] == 0


def notices(bench):
    return bench.page.locator(".notice").all_inner_texts()


def value(bench, label):
    return bench.page.get_by_label(label).first.input_value()


def test_the_page_begins_with_the_plan_and_shows_no_number_of_another_pair(start):
    served, bench = start()
    assert (value(bench, "Target contrast"), value(bench, "Tolerance")) == ("1000", "50")
    bench.expose("2")
    rows = bench.page.locator(".planned tbody tr")
    assert rows.count() == 3
    for row in range(3):
        rows.nth(row).filter(has_text=re.compile(r"\d ± ")).wait_for()
    bench.card_when(2, r"[89]\d\d\.?\d* ±")
    bench.page.evaluate(WATCH)
    rows.filter(has_text="upper left / upper right").click()
    bench.card_when(1, r"target contrast 370 %")
    bench.card_when(2, r"\d\d\d\.?\d* ±")
    bench.page.wait_for_timeout(1000)
    assert value(bench, "Target contrast") == "370"
    assert [value(bench, name) for name in ("Contrast of", "and of")] == ["upper left", "upper right"]
    seen = [one for one in bench.page.evaluate("() => window.seen") if one[0] == "upper left / upper right"]
    # True: 358 / 75.6 - 1; upper left / lower right is 9.6.
    assert seen
    assert all(contrast == "…" or 300 < float(contrast.split()[0]) < 450 for _, _, contrast in seen)

    # What is typed is of this pair; the other has its own again.
    bench.fill("Target contrast", "12,5")
    bench.card_when(1, r"too strong.*target contrast 12\.5 %")
    rows.filter(has_text="upper left / lower right").click()
    bench.card_when(1, r"target contrast 1000 %")
    assert value(bench, "Target contrast") == "1000"
    # A frozen image is measured, too.
    bench.button("Pause").click()
    bench.card_when(0, "paused")
    rows.filter(has_text="upper left / upper right").click()
    bench.card_when(1, r"stale")
    assert served.stop()[0] == 0


def test_saturated_regions_have_no_value_with_an_uncertainty(start):
    _, bench = start()
    bench.expose("32")
    bench.card_when(1, "saturated")
    bench.card_when(2, "> ")
    bench.page.locator(".planned tbody tr").filter(has_text=re.compile("> .* %.*saturated")).first.wait_for()
    bench.tab(3)
    row = bench.page.locator("table:not(.dense) tr[data-region]", has_text="upper left")
    row.filter(has_text=re.compile(r"> \d")).wait_for()
    assert "±" not in row.inner_text()
    # A region that is not of the pair, too.
    other = bench.page.locator("table:not(.dense) tr[data-region]", has_text="lower left")
    other.filter(has_text=re.compile(r"> \d")).wait_for()


def test_a_message_is_of_its_field_has_its_unit_and_goes_and_nothing_moves(start):
    _, bench = start()
    bench.fill("Exposure (ms)", "2,5")
    bench.card_when(0, r"fps\D*2\.5 ms")
    bench.page.wait_for_timeout(1000)
    before = bench.page.evaluate(PLACES)
    assert len(before) > 12
    bench.fill("Exposure (ms)", "99999999")
    bench.page.locator(".notice", has_text="60000 ms").wait_for()
    bench.fill("Reading of another meter", "1e9")
    bench.page.locator(".notice", has_text="1000000000 cd/m²").wait_for()
    bench.fill("Target contrast", "many")
    bench.page.locator(".notice", has_text="many").wait_for()
    assert len(notices(bench)) == 3
    assert bench.page.evaluate(PLACES) == before
    # Each goes when its input is right, and the others stay.
    bench.fill("Target contrast", "1000")
    bench.page.locator(".notice", has_text="many").wait_for(state="detached")
    assert len(notices(bench)) == 2
    bench.fill("Reading of another meter", "1,234")
    bench.card_when(3, r"1\.234 cd/m²")
    bench.fill("Exposure (ms)", "500")
    bench.page.locator(".notice").first.wait_for(state="detached")
    bench.card_when(1, "saturated")
    bench.page.wait_for_timeout(500)
    assert bench.page.evaluate(PLACES) == before

    bench.tab(4)
    for line in ("from 100, 100 to 300, 300", "100,100 300,300", "100, 100, 300, 300"):
        bench.fill("Profile from x, y to x, y", "1, 2, 3")
        bench.page.locator(".notice", has_text="Profile").wait_for()
        bench.fill("Profile from x, y to x, y", line)
        bench.page.locator(".notice").first.wait_for(state="detached")


def test_readings_have_time_and_origin_can_be_deleted_and_stay_in_the_log_of_the_day(start, folder):
    served, bench = start()
    bench.expose("2")
    bench.tab(3)
    bench.page.locator("tr[data-region]", has_text="lower left").first.click()
    bench.tab(1)
    for text in ("400,5", "-3", "414"):
        bench.fill("Reading of another meter", text)
        if text == "-3":
            bench.page.locator(".notice", has_text="negative").wait_for()
        else:
            bench.card_when(3, text.replace(",", r"\."))
    rows = bench.page.locator("table.readings tbody tr")
    texts = rows.all_inner_texts()
    assert len(texts) == 2
    assert all(re.search(r"\d\d:\d\d:\d\d\s+lower left.*typed", text, re.DOTALL) for text in texts)
    rows.nth(1).get_by_role("button").click()
    rows.nth(1).wait_for(state="detached")
    bench.card_when(1, r"\d\.\d{4}")
    bench.button("Note CDP").click()
    bench.page.locator(".notice", has_text="CDP noted").wait_for()
    bench.button("Export log").click()
    bench.page.locator(".notice", has_text="Exported").wait_for()
    status, said = served.stop()

    (log,) = folder.glob("bench-log-*.json")
    assert status == 0
    assert any(line.endswith(log.name) for line in said)
    stored = json.loads(log.read_text())
    assert [(one["luminance_cd_m2"], bool(one["deleted"])) for one in stored["readings"]] == [
        (400.5, True),
        (414, False),
    ]
    assert {(one["first"], one["second"]) for one in stored["snapshots"]} >= {("upper left", "lower right")}
    assert [one["exposure_s"] for one in stored["settings"]][-1] == 0.002
    (sheet,) = folder.glob("bench-log-*.xlsx")
    book = openpyxl.load_workbook(sheet)
    assert [row[2].value for row in book["readings"].iter_rows(min_row=2)][:2] == [400.5, 414]
    assert book["snapshots"].max_row > 1

    # It is there after a new start; a file that is no log is not overwritten.
    again, bench = start()
    bench.card_when(3, "414")
    assert bench.page.locator("table.readings tbody tr").count() == 1
    assert again.stop()[0] == 0


@pytest.mark.parametrize(("width", "height"), [(390, 844), (768, 1024)])
def test_phones_and_tablets_have_one_column_of_their_own_width(start, width, height):
    size = {"width": width, "height": height}
    _, bench = start(viewport=size, is_mobile=True, has_touch=True, device_scale_factor=2)
    assert bench.page.evaluate("[innerWidth, document.documentElement.scrollWidth]") == [width, width]
    picture = bench.page.evaluate(f"() => {PICTURE}.el.getBoundingClientRect().toJSON()")
    tabs = bench.page.get_by_text("Luminance", exact=True).first.bounding_box()
    assert picture["width"] > width - 20
    assert tabs["y"] > picture["bottom"]
    places = bench.page.evaluate(PLACES)
    assert all(0 <= x < width for x, _ in places.values())
    # All lines of the cards are seen.
    bench.expose("2")
    bench.card_when(1, r"target contrast 1000 %, ε 50 %")
    cut = "cards => cards.filter(one => one.scrollHeight > one.clientHeight + 1).map(one => one.innerText)"
    assert bench.page.locator(".card").evaluate_all(cut) == []
    # A message is seen where the field is.
    field = bench.page.get_by_label("Exposure (ms)")
    field.scroll_into_view_if_needed()
    bench.fill("Exposure (ms)", "abc")
    notice = bench.page.locator(".notice", has_text="abc")
    notice.wait_for()
    assert 0 <= notice.bounding_box()["y"] < height
