"""Pages, surfaces, sheets and files of pictures."""

import csv
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import openpyxl
import pytest

from labcdp.errors import InputError
from labcdp.evaluate.image import ImageRequest, evaluate_image
from labcdp.luminance import Invalid, LuminanceMap
from labcdp.report.image_figures import image_figures
from labcdp.report.image_folder import ResultFolder
from labcdp.report.image_page import ReportedPicture, overview_page, picture_page, shared_warnings
from labcdp.report.image_results import picture_files, picture_folder, summary_files
from labcdp.report.image_surface import MOST_POINTS, block_max, brightest, surface_page
from labcdp.report.image_tables import pair_table, region_table
from labcdp.roi import Roi
from labcdp.sources.picture import Picture

CHROMIUM, SOFFICE = shutil.which("chromium"), shutil.which("soffice")
HOSTILE = "</script><b>=1+1 $x_{$ [a]:*?/\\{{ 7 }}"
SHAPE = (120, 180)
BRIGHT, DARK = Roi.rectangle("bright", 100, 20, 60, 80), Roi.rectangle(HOSTILE, 10, 10, 60, 80)
REQUEST = ImageRequest((0.5, 1.0, 2.0, 3.0), 0.5, (BRIGHT, DARK), neighbours=True, rectangle=(5, 5, 60, 50))


def _luminance(seed=0):
    luminance = np.random.default_rng(seed).normal(100.0, 10.0, SHAPE)
    luminance[:, 90:] += 110
    return luminance


def _map(luminance, **more):
    invalid = np.zeros(luminance.shape, dtype=np.uint8)
    invalid[:4, :4] = Invalid.SATURATED
    return LuminanceMap(luminance, np.zeros(luminance.shape), (), invalid, **more)


def _picture(luminance, name="night.exr"):
    light = luminance.astype(np.float32)
    return Picture(Path(name), "ab" * 32, None, light, True, "linear", ("a note",), None, None, False, False)


@pytest.fixture(scope="module")
def figures():
    luminance = _luminance()
    return image_figures(_evaluation(), _picture(luminance), _map(luminance))


def _evaluation(seed=0, request=REQUEST, name="night.exr", warnings=()):
    luminance = _luminance(seed)
    return evaluate_image(_picture(luminance, name), _map(luminance), "cd/m^2", request, warnings)


def _reported(n=2, failed=True):
    good = [ReportedPicture(k, f"{k}.exr", f"picture-{k}", _evaluation(k, name=f"{k}.exr")) for k in range(1, n + 1)]
    return [*good, ReportedPicture(n + 1, "bad.png", f"picture-{n + 1}", None, "bad.png is empty")] if failed else good


class _Text(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text = [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)


def _parsed(page):
    parser = _Text()
    parser.feed(page)
    parser.close()
    return parser


def test_tables_tell_numbers_with_their_uncertainty():
    evaluation = _evaluation()
    head, row = region_table(evaluation).columns, region_table(evaluation).rows[0]
    assert head[2] == "mean (cd/m²)"
    assert row[:2] == ("bright", "4800")
    assert re.fullmatch(r"2\d\d\.\d+ ± 0\.\d\d", row[2])
    rows = pair_table(evaluation).rows
    assert [row[2] for row in rows] == ["50", "100", "200", "300"]
    assert re.fullmatch(r"0\.\d+ \(0\.\d+ to 0\.\d+\)", rows[1][4])


def test_values_without_an_uncertainty_are_told():
    luminance = np.full(SHAPE, 10.0)
    luminance[:, 90:] = 20.0
    found = evaluate_image(_picture(luminance), _map(luminance), "relative", ImageRequest((1.0,), 0.5, (BRIGHT, DARK)))
    assert region_table(found).rows[0][4] == "∞"
    assert pair_table(found).rows[0][-1] == "∞"
    assert region_table(found).columns[2] == "mean (relative)"


def test_figures_show_picture_contrasts_and_values(figures):
    assert [figure.file_name for figure in figures] == [
        "picture.png",
        "contrasts-pair-1-1.png",
        "cdp-pair-1.png",
        "contrasts-neighbours-1.png",
        "cdp-neighbours.png",
        "values-0.png",
        "values-1.png",
        "values-2.png",
    ]
    for figure in figures:
        assert cv2.imdecode(np.frombuffer(figure.png, np.uint8), cv2.IMREAD_COLOR).shape[1] > 700
    # Of four contrasts, the one closest to what was measured (about 110 %).
    assert "CDP of 100 % is" in figures[1].alternative


def test_up_to_three_contrasts_have_a_figure_each():
    request = ImageRequest((0.5, 1.0), 0.5, (DARK,), neighbours=True)
    luminance = _luminance()
    figures = image_figures(_evaluation(request=request), _picture(luminance), _map(luminance))
    assert [figure.file_name for figure in figures] == [
        "picture.png",
        "contrasts-neighbours-1.png",
        "contrasts-neighbours-2.png",
        "cdp-neighbours.png",
        "values-0.png",
    ]


def test_pixels_that_are_no_numbers_are_left_out_of_figures_and_surface():
    luminance = _luminance()
    luminance[100:, :60] = np.nan
    luminance[110, 100] = np.inf
    request = ImageRequest((1.0,), 0.5, (BRIGHT,), pairs=(), neighbours=True, rectangle=(0, 0, 50, 50))
    evaluation = evaluate_image(_picture(luminance), _map(luminance), "relative", request)
    assert len(image_figures(evaluation, _picture(luminance), _map(luminance))) == 3
    assert "Pixels that are not numbers are left out" in surface_page(_map(luminance), "x", "relative")


def test_a_page_has_all_parts_and_no_foreign_code(figures):
    evaluation = _evaluation(warnings=(HOSTILE,))
    page = _parsed(picture_page(evaluation, figures, "by hand", True, 0.5))
    text = " ".join("".join(page.text).split())
    for part in (
        "night.exr",
        HOSTILE,
        "of 4 contrasts, 100 % is detected most probably, with a probability of 0.",
        "From pixel to pixel, (5, 5) to (60, 50)",
        "beside this page",
        "tolerance of 50 %",
        "a note",
        "by hand",
        "ab" * 32,
        "180 x 120 pixels",
    ):
        assert part in text
    assert len([tag for tag, _ in page.tags if tag == "img"]) == 8
    assert not {"b", "script"} & {tag for tag, _ in page.tags}


def test_the_overview_tells_failures_and_leads_to_the_pages():
    page = _parsed(overview_page(_reported(), "by hand", 0.5))
    text = " ".join("".join(page.text).split())
    assert "1 of 3 pictures failed." in text
    assert "bad.png: bad.png is empty" in text
    assert [attributes["href"] for tag, attributes in page.tags if tag == "a"] == [
        "picture-1/report.html",
        "picture-2/report.html",
    ]
    assert [attributes["value"] for tag, attributes in page.tags if tag == "li" and "value" in attributes] == ["1", "2"]


def test_a_warning_of_several_pictures_is_told_once():
    both = [_evaluation(k, name=f"{k}.exr", warnings=("dark",) if k == 1 else ("dark", "old")) for k in (1, 2)]
    assert shared_warnings(both) == ["dark (2 pictures)", "old (2.exr)"]
    assert shared_warnings(both[:1]) == ["dark"]


def test_blocks_keep_their_largest_value_and_the_brightest_pixel_is_found():
    values = np.random.default_rng(0).normal(0, 1, (17, 23))
    values[4, 4] = np.nan
    values[16] = np.nan
    found = block_max(values, 5)
    assert found.shape == (4, 5)
    assert found[0, 0] == np.nanmax(values[:5, :5])
    assert found[3, 4] == np.nanmax(values[15:, 20:])
    values[9, 20] = 50.0
    values[3, 3] = np.inf
    assert brightest(values) == (9, 20)


def _surface_data(page):
    """Traces and layout that the page hands to plotly."""
    call = page[page.rindex("Plotly.newPlot(") :]
    decoder, start = json.JSONDecoder(), call.index("[")
    traces, end = decoder.raw_decode(call[start:])
    rest = call[start + end :]
    layout, _ = decoder.raw_decode(rest[rest.index("{") :])
    return traces, layout


def _array(value):
    import base64

    found = np.frombuffer(base64.b64decode(value["bdata"]), dtype={"f4": np.float32}[value["dtype"]])
    return found.reshape([int(n) for n in value["shape"].split(",")]) if "shape" in value else found


def test_a_large_picture_becomes_a_surface_of_block_means_and_maxima_with_its_peak():
    luminance = np.random.default_rng(1).normal(50, 1, (1034, 2000)).astype(np.float32)
    luminance[700, 1203] = 900.0
    page = surface_page(LuminanceMap(luminance, luminance, (), np.zeros(luminance.shape, np.uint8)), HOSTILE, "cd/m^2")
    assert len(page) < 7e6
    assert "each point stands for a block of 10 x 10 pixels" in page
    assert "900.0 cd/m² at x = 1203.5, y = 700.5" in page
    assert "<b>" not in page.replace("plotly", "")[: page.index("<script")]
    (means, maxima, mark), layout = _surface_data(page)
    z = _array(means["z"])
    assert z.shape == (104, 200)
    assert max(z.shape) <= MOST_POINTS
    np.testing.assert_allclose(z[10, 20], luminance[100:110, 200:210].mean(), rtol=1e-6)
    # The last row of blocks is lower than the others.
    np.testing.assert_allclose(z[103, 0], luminance[1030:, :10].mean(), rtol=1e-6)
    assert _array(maxima["z"])[70, 120] == 900
    assert (means["visible"], maxima["visible"]) == (True, False)
    assert mark["z"][1] == 900
    assert (mark["x"][1], mark["y"][1]) == (1203.5, 700.5)
    assert layout["scene"]["zaxis"]["range"][1] > 900
    assert _array(means["y"])[-1] == 1032
    buttons = layout["updatemenus"][0]["buttons"]
    assert [button["args"][0]["visible"] for button in buttons] == [[True, False], [False, True]]


def test_a_small_picture_keeps_its_pixels():
    page = surface_page(_map(_luminance(), step=2), "small", "relative")
    (surface, mark), layout = _surface_data(page)
    assert _array(surface["z"]).shape == SHAPE
    assert "stands for a block" not in page
    assert "360 x 240 pixels" in page
    # In pixels of the picture, of which each of the map stands for two.
    assert _array(surface["x"])[:2].tolist() == [1.0, 3.0]
    assert "updatemenus" not in layout
    assert "relative luminance" in json.dumps(layout, ensure_ascii=False)
    assert mark["z"][1] == pytest.approx(_luminance().max())


@pytest.mark.parametrize("value", [0.0, 5.0])
def test_an_even_picture_is_a_surface_too(value):
    (surface, _), layout = _surface_data(surface_page(_map(np.full((20, 30), value)), "even", "relative"))
    assert surface["cmax"] > surface["cmin"]
    assert layout["scene"]["zaxis"]["range"][1] > layout["scene"]["zaxis"]["range"][0]


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_surface_is_drawn_in_a_browser(tmp_path):
    luminance = np.full((60, 80), 20.0)
    luminance[20:40, 20:60] = 90.0
    (tmp_path / "surface.html").write_text(surface_page(_map(luminance), "step", "cd/m^2"))
    subprocess.run(
        [
            *(CHROMIUM, "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
            *("--disable-background-networking", "--window-size=600,900", "--virtual-time-budget=2000"),
            *(f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={tmp_path / 'shot.png'}"),
            (tmp_path / "surface.html").as_uri(),
        ],
        check=True,
        capture_output=True,
        timeout=240,
    )
    shot = cv2.imread(str(tmp_path / "shot.png"))[..., ::-1].astype(int)
    # Dark and bright of the Viridis scale, and the mark of the brightest pixel.
    blue = (shot[..., 2] > shot[..., 1] + 20) & (shot[..., 2] > 50) & (shot.sum(-1) < 400)
    yellow = (shot[..., 0] > 170) & (shot[..., 1] > 170) & (shot[..., 2] < 110)
    assert blue.sum() > 2000
    assert yellow.sum() > 2000


def _books(request=REQUEST, pictures=None):
    pictures = _reported() if pictures is None else pictures
    files = summary_files(pictures, request, "by hand", {}, ())
    return files, openpyxl.load_workbook(BytesIO(files["results.xlsx"]))


def test_the_sheet_is_that_of_the_thesis_with_file_names_below():
    _, book = _books()
    assert book.sheetnames == ["CDP", "CDP pixel to pixel", "Results", "Pictures", "Failures", "Provenance"]
    rows = [[cell.value for cell in row] for row in book["CDP"].iter_rows()]
    assert rows[0] == ["Contrasts in %", "Picture number 1", "Picture number 2", "Picture number 3"]
    assert [row[0] for row in rows[1:]] == [50, 100, 200, 300, "File"]
    expected = [one.result.cdp for one in _reported()[1].evaluation.pairs[0].result.results]
    assert [row[2] for row in rows[1:5]] == pytest.approx(expected, rel=1e-14)
    assert [row[3] for row in rows[1:5]] == [None] * 4
    assert rows[-1] == ["File", "1.exr", "2.exr", "bad.png"]


def test_each_picture_pair_and_contrast_has_a_row_with_all_numbers():
    _, book = _books()
    head, *rows = [[cell.value for cell in row] for row in book["Results"].iter_rows()]
    assert len(rows) == 2 * (4 + 4)
    row = dict(zip(head, rows[1], strict=True))
    found = _reported()[0].evaluation.pairs[0].result
    one = found.results[1]
    assert (row["Picture number"], row["File"], row["Pixels"]) == (1, "1.exr", "region to region")
    assert (row["Contrast asked for in %"], row["Tolerance in %"]) == (100, 50)
    assert row["CDP"] == pytest.approx(one.result.cdp, rel=1e-14)
    assert (row["CDP, 95 % from"], row["CDP, 95 % to"]) == pytest.approx(one.confidence_interval, rel=1e-14)
    assert row["Measured contrast in %"] == pytest.approx(100 * found.contrast.value)
    assert (row["Bright: region"], row["Dark: region"]) == ("bright", HOSTILE)
    assert row["Dark: SNR"] == pytest.approx(found.b.snr.value)
    assert row["CSNR, standard uncertainty"] == pytest.approx(found.csnr.standard_error)
    near = dict(zip(head, rows[4], strict=True))
    assert near["Pixels"] == "pixel to pixel, (5, 5) to (60, 50)"
    assert near["CSNR"] is None
    failures = [[cell.value for cell in row] for row in book["Failures"].iter_rows()]
    assert failures == [["Picture number", "File", "Why"], [3, "bad.png", "bad.png is empty"]]


def test_pairs_have_sheets_of_their_own_with_names_that_can_be():
    names = [*(HOSTILE + str(n) for n in range(3)), "a"]
    rois = tuple(Roi.rectangle(name, 40 * n, 5, 30, 100) for n, name in enumerate(names))
    request = ImageRequest((1.0,), 0.5, rois)
    luminance = _luminance()
    evaluation = evaluate_image(_picture(luminance), _map(luminance), "cd/m^2", request)
    _, book = _books(request, [ReportedPicture(1, "1.exr", "", evaluation)])
    assert len(book.sheetnames) == 6 + 3
    assert len({name.lower() for name in book.sheetnames}) == 9
    assert all(len(name) <= 31 for name in book.sheetnames)


@pytest.mark.skipif(SOFFICE is None, reason="LibreOffice is not installed")
def test_libreoffice_reads_numbers_as_numbers(tmp_path):
    files, _ = _books()
    (tmp_path / "results.xlsx").write_bytes(files["results.xlsx"])
    # All sheets, with text in quotes, so that a number in none is one.
    filters = "csv:Text - txt - csv (StarCalc):44,34,76,1,,0,true,true,false,false,false,-1"
    subprocess.run(
        [
            *(SOFFICE, f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}", "--headless"),
            *("--convert-to", filters, "--outdir", tmp_path, tmp_path / "results.xlsx"),
        ],
        check=True,
        capture_output=True,
        timeout=240,
    )
    thesis = (tmp_path / "results-CDP.csv").read_text().splitlines()
    assert thesis[0] == '"Contrasts in %","Picture number 1","Picture number 2","Picture number 3"'
    assert re.fullmatch(r"100,0\.\d{10,},0\.\d{10,},", thesis[2])
    assert thesis[-1] == '"File","1.exr","2.exr","bad.png"'
    with (tmp_path / "results-Results.csv").open() as file:
        # A field without quotes becomes a float, and one that is no number is an error.
        head, row, *_ = csv.reader(file, quoting=csv.QUOTE_NONNUMERIC)
    assert isinstance(row[head.index("CDP")], float)
    assert isinstance(row[head.index("Bright: mean")], float)
    assert row[head.index("Dark: region")] == HOSTILE


def test_too_many_pictures_for_a_sheet_are_refused():
    many = [ReportedPicture(n, "x", "x", None, "bad") for n in range(2**14)]
    with pytest.raises(InputError, match=r"16384 pictures are more than the 16383 columns of a sheet: give fewer"):
        summary_files(many, REQUEST, "by hand", {}, ())


def test_the_files_of_one_picture_and_of_several():
    luminance = _luminance()
    evaluation = _evaluation(request=ImageRequest((1.0,), 0.5, (DARK,), neighbours=True))
    files = picture_files(evaluation, _picture(luminance), _map(luminance), "by hand", 0.5, surface=True)
    assert {"report.html", "surface.html", "figures/picture.png"} < set(files)
    one, _ = _books(pictures=_reported(1, failed=False))
    assert set(one) == {"results.json", "results.xlsx"}
    several, _ = _books()
    assert set(several) == {"results.json", "results.xlsx", "report.html"}
    values = json.loads(several["results.json"])
    assert values["written"] == ["report.html", "results.json", "results.xlsx"]
    assert values["failures"] == [{"number": 3, "file": "bad.png", "reason": "bad.png is empty"}]
    assert [picture["number"] for picture in values["pictures"]] == [1, 2]


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("a/night 1.png", "picture-7-night-1"),
        ("../..", "picture-7"),
        ("nächtlich.tif", "picture-7-nächtlich"),
        ("x" * 300 + ".png", "picture-7-" + "x" * 60),
        ("$(rm).png", "picture-7-rm"),
    ],
)
def test_folders_of_pictures_have_harmless_names(path, expected):
    assert picture_folder(7, Path(path)) == expected


def test_results_appear_when_all_are_made_and_replace_those_before(tmp_path):
    folder = tmp_path / "out"
    with ResultFolder(folder) as results:
        results.add({"picture-1/report.html": b"old", "picture-2/figures/a.png": b"old"})
        assert [path.name for path in folder.iterdir()] == [".labcdp-unfinished"]
        results.add({"results.json": json.dumps({"written": [*results.names, "../keep.txt", "results.json"]}).encode()})
        results.finish()
    (tmp_path / "keep.txt").write_text("mine")
    (folder / "picture-2/mine.txt").write_text("mine")
    with ResultFolder(folder) as results:
        results.add({"picture-1/report.html": b"new", "results.json": b'{"written": []}'})
        results.finish()
    found = {str(path.relative_to(tmp_path)): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {
        "keep.txt": b"mine",
        "out/picture-1/report.html": b"new",
        "out/picture-2/mine.txt": b"mine",
        "out/results.json": b'{"written": []}',
    }
    assert not (folder / "picture-2/figures").exists()


def _gather_and_fail(folder):
    with ResultFolder(folder) as results:
        results.add({"picture-1/report.html": b"x"})
        raise KeyboardInterrupt


def test_an_end_before_all_are_made_leaves_everything_as_it_was(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        _gather_and_fail(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old").mkdir()
    (tmp_path / "old/results.json").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        _gather_and_fail(tmp_path / "old")
    assert [path.name for path in (tmp_path / "old").iterdir()] == ["results.json"]


def test_what_a_killed_run_left_is_removed(tmp_path):
    (tmp_path / ".labcdp-unfinished/picture-1").mkdir(parents=True)
    with ResultFolder(tmp_path) as results:
        results.add({"a": b"x"})
        results.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_place_that_is_taken_is_refused(tmp_path):
    (tmp_path / "report.html").mkdir()

    def gather():
        with ResultFolder(tmp_path) as results:
            results.add({"report.html": b"x"})
            results.finish()

    with pytest.raises(InputError, match=r"report.html is a folder: give another folder for the results"):
        gather()
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match=r"file cannot be made \(File exists\): give a folder you can write to"):
        ResultFolder(tmp_path / "file").__enter__()
