"""A map as picture, page, spreadsheet and files."""

import json
import re
import shutil
import subprocess
from datetime import UTC, datetime
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import openpyxl
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import norm

from labcdp.errors import InputError
from labcdp.evaluate.map_axes import map_axis
from labcdp.evaluate.maps import analyse_map
from labcdp.json_text import results_json
from labcdp.report.map_figure import map_figure
from labcdp.report.map_files import write_map
from labcdp.report.map_page import map_page
from labcdp.report.map_parts import axes_of
from labcdp.report.map_scales import cell_edges
from labcdp.report.map_sheets import map_spreadsheet
from labcdp.report.map_tables import map_values, usable_table
from labcdp.report.map_wording import axis_label, conditions, notes, plain, value_text
from labcdp.report.netcdf import load_netcdf, save_netcdf

CHROMIUM = shutil.which("chromium")

LUMINANCE, CONTRAST = "scene.luminance_cd_m2", "scene.contrast"
HOSTILE = "</script><b>bold</b> =1+1 $x_{$ {{ 7 }}"
VERMILLION, MISSING, BLUE = (213, 94, 0), (217, 217, 217), (0, 114, 178)
TIME = datetime(2026, 3, 2, tzinfo=UTC)


def shot_noise_map(n_luminance: int = 24, n_contrast: int = 8) -> xr.Dataset:
    """CDP of two patches with shot noise alone, in closed form, with a change of exposure at 500 cd/m^2."""
    luminance, contrast = np.geomspace(0.1, 1e4, n_luminance), np.geomspace(0.02, 1, n_contrast)
    light, k = np.meshgrid(luminance, contrast, indexing="ij")
    dark = np.where(light > 500, 1.0, 10.0) * light
    bright = (1 + k) * dark

    def share_below(ratio: NDArray[np.float64]) -> NDArray[np.float64]:
        return norm.cdf((ratio * dark - bright) / np.sqrt(ratio**2 * dark + bright))

    below, above = share_below(1 + k / 2), 1 - share_below(1 + 1.5 * k)
    axes = (LUMINANCE, CONTRAST)
    dataset = xr.Dataset(
        {
            "cdp": (axes, 1 - below - above),
            "standard_error": (axes, np.full(light.shape, 0.0123)),
            "below": (axes, below),
            "above": (axes, above),
            "snr_dark": (axes, np.sqrt(dark)),
        },
        coords={LUMINANCE: luminance, CONTRAST: contrast},
        attrs={
            "title": "Shot noise",
            "contrast": np.nan,
            "epsilon": 0.5,
            "method": "simulated",
            "seed": 3,
            "labcdp_version": "0.1.0",
            "chain": "[scene]\nluminance_cd_m2 = 1.0\n",
        },
    )
    dataset[LUMINANCE].attrs.update(unit="cd/m^2", long_name="scene luminance")
    dataset[CONTRAST].attrs.update(unit="1", long_name="Weber contrast")
    return dataset


@pytest.fixture
def dataset() -> xr.Dataset:
    return shot_noise_map()


@pytest.fixture
def staged(dataset: xr.Dataset) -> xr.Dataset:
    """The map after two stages, one of a hostile name."""
    return dataset.expand_dims({"stage": ["sensor", HOSTILE]})


def one_contrast(dataset: xr.Dataset, index: int = 5) -> xr.Dataset:
    return dataset.isel({CONTRAST: [index]})


def picture(dataset: xr.Dataset) -> NDArray[np.uint8]:
    """Picture of a map as RGB, shape (height, width, 3)."""
    png = np.frombuffer(map_figure(dataset, analyse_map(dataset)), np.uint8)
    decoded = cv2.imdecode(png, cv2.IMREAD_COLOR)
    assert decoded is not None
    return decoded[..., ::-1]


def area(image: NDArray[np.uint8], colour: tuple[int, int, int]) -> int:
    """Pixels of exactly a colour."""
    return int(np.all(image == colour, axis=-1).sum())


def page(dataset: xr.Dataset) -> str:
    return map_page(dataset, analyse_map(dataset))


def book(dataset: xr.Dataset) -> openpyxl.Workbook:
    return openpyxl.load_workbook(BytesIO(map_spreadsheet(dataset, analyse_map(dataset), TIME)))


def test_edges_of_cells_lie_half_way_on_the_axis(dataset: xr.Dataset) -> None:
    edges = cell_edges(map_axis(dataset, LUMINANCE))
    values = dataset[LUMINANCE].values
    np.testing.assert_allclose(edges[1:-1], np.sqrt(values[1:] * values[:-1]), rtol=1e-12)
    np.testing.assert_allclose(edges[1:] * edges[:-1], values**2, rtol=1e-12)


@pytest.mark.parametrize(("value", "text"), [(10000.0, "10000"), (0.0, "0"), (0.1234, "0.123"), (1.5e7, "1.5e+07")])
def test_plain_numbers(value: float, text: str) -> None:
    assert plain(value) == text


def test_the_contrast_and_the_largest_standard_error_are_stated(dataset: xr.Dataset) -> None:
    assert conditions(dataset) == "tolerance ε 0.5, method: simulated, largest standard error of CDP 0.012"
    exact = dataset.drop_vars("standard_error").assign_attrs(method="exact", contrast=0.07)
    assert conditions(exact) == "contrast 7 %, tolerance ε 0.5, method: exact"


@pytest.mark.parametrize("values", [[0.01, 0.5, 1.0], [0.0, 0.5, 2.0], [0.0], [0.3]])
def test_no_cell_reaches_below_a_contrast_of_0(values: list[float]) -> None:
    edges = cell_edges(map_axis(xr.Dataset({"cdp": (CONTRAST, values)}, coords={CONTRAST: values}), CONTRAST))
    assert edges[0] >= 0
    assert (np.diff(edges) > 0).all()


def test_cells_of_temperatures_reach_below_0() -> None:
    values = [0.0, 20.0, 40.0]
    dataset = xr.Dataset({"cdp": ("temperature_c", values)}, coords={"temperature_c": values})
    dataset["temperature_c"].attrs["unit"] = "degC"
    axis = map_axis(dataset, "temperature_c")
    assert cell_edges(axis).tolist() == [-10.0, 10.0, 30.0, 50.0]
    assert (axis_label(axis), value_text(axis, 20.0)) == ("temperature c in °C", "20 °C")


def range_of(name: str, unit: str, values: list[float], cdp: list[float]) -> str:
    dataset = xr.Dataset({"cdp": (name, cdp)}, coords={name: values})
    dataset[name].attrs["unit"] = unit
    return notes(analyse_map(dataset), axes_of(dataset))[0].partition(": ")[2]


def test_an_end_that_the_grid_does_not_resolve_is_told_as_a_bracket() -> None:
    light = [0.1, 1.0, 10.0, 100.0, 1000.0]
    least = "at least 2.00 decades, 40.0 dB"
    assert range_of(LUMINANCE, "cd/m^2", light, [0.0, 1, 1, 1, 0]) == (
        f"from between 0.1 and 1 to between 100 and 1000 cd/m² ({least})"
    )
    assert range_of(LUMINANCE, "cd/m^2", light, [0.85, 0.95, 1, 1, 0]) == (
        "0.316 to between 100 and 1000 cd/m² (at least 2.50 decades, 50.0 dB)"
    )


def test_temperatures_and_bits_have_ends_alone() -> None:
    assert range_of("t", "degC", [0.0, 20.0, 40.0], [1.0, 0.95, 0.85]) == "≤ 0 to 30 °C"
    assert range_of("bits", "1", [8.0, 10.0, 12.0], [0.85, 0.93, 0.99]) == "10 to ≥ 12"


def test_notes_tell_the_range_and_the_dip(dataset: xr.Dataset) -> None:
    dataset = one_contrast(dataset)
    usable, dip = notes(analyse_map(dataset, expected=[500.0]), axes_of(dataset))
    assert re.fullmatch(
        r"usable range \(CDP ≥ 0\.9\): [\d.]+ to ≥ 10000 cd/m² \(at least [\d.]+ decades, [\d.]+ dB\)", usable
    )
    # The luminances of the grid beside 500 are 494 and 819: a ratio of sqrt(494 / 81.9).
    assert re.fullmatch(
        r"dip of SNR, dark region at 819 cd/m²: 7\.8 dB, recovered at 4\d\d0 cd/m², lowest CDP 0\.9\d+; "
        r"change of exposure at 500 cd/m²",
        dip,
    )


def test_heat_map_shows_the_widest_range_and_missing_values(dataset: xr.Dataset) -> None:
    image = picture(dataset)
    assert area(image, VERMILLION) > 500
    assert area(image, MISSING) < 1000
    dataset["cdp"][4:12, 1:4] = np.nan
    assert area(picture(dataset), MISSING) > 5000


def test_heat_map_of_a_map_without_usable_range_marks_none(dataset: xr.Dataset) -> None:
    dataset["cdp"] *= 0.8
    assert area(picture(dataset), VERMILLION) == 0


def test_each_section_has_a_panel(staged: xr.Dataset) -> None:
    assert area(picture(staged), MISSING) < 1000
    without = staged.assign(cdp=staged["cdp"].where(staged["stage"] == "sensor"))
    assert area(picture(without), MISSING) > 100_000


def test_curves_have_their_colours_and_a_band(dataset: xr.Dataset) -> None:
    image = picture(one_contrast(dataset))
    assert area(image, BLUE) > 500
    assert area(image, VERMILLION) == 0
    two = dataset.isel({CONTRAST: [5]}).expand_dims({"stage": ["a", "b"]})
    assert area(picture(two), VERMILLION) > 300


@pytest.mark.parametrize("draw", [picture, page])
def test_a_map_of_stages_alone_is_drawn(dataset: xr.Dataset, draw: object) -> None:
    stages = xr.Dataset({"cdp": ("stage", [0.9, np.nan, 0.8])}, coords={"stage": ["sensor", HOSTILE, "isp"]})
    assert len(draw(stages)) > 100  # type: ignore[operator]


@pytest.mark.parametrize("draw", [picture, page])
def test_what_is_too_much_to_draw_is_refused(dataset: xr.Dataset, draw: object) -> None:
    many = dataset.expand_dims({"seed": [str(i) for i in range(13)]})
    with pytest.raises(InputError, match=r"needs 13 panels over seed, at most 12 can be drawn: fix a value of seed"):
        draw(many)  # type: ignore[operator]
    with pytest.raises(InputError, match=r"needs 9 curves over seed, at most 8 can be drawn: fix a value of seed"):
        draw(one_contrast(many.isel(seed=slice(0, 9))))  # type: ignore[operator]


class _Links(HTMLParser):
    """Everything a page would load, and its security policy."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.policy = ""
        self.bold = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.loaded += [str(values[name]) for name in ("src", "href") if name in values]
        self.bold += tag == "b"
        if values.get("http-equiv") == "Content-Security-Policy":
            self.policy = str(values["content"])


@pytest.mark.parametrize("curves", [False, True])
def test_page_loads_nothing_and_may_not(staged: xr.Dataset, curves: bool) -> None:
    links = _Links()
    links.feed(page((one_contrast(staged) if curves else staged).assign_attrs(title=HOSTILE)))
    assert (links.loaded, links.bold) == ([], 0)
    assert links.policy.startswith("default-src 'none'; script-src 'unsafe-inline';")
    assert "http" not in links.policy


def test_page_has_no_button_that_sends_the_map_away(dataset: xr.Dataset) -> None:
    settings = page(dataset).rpartition("Plotly.newPlot(")[2]
    assert '"showSendToCloud": false' in settings


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_browser_draws_isolines_and_hostile_names(staged: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "map.html"
    path.write_text(page(staged), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--virtual-time-budget=5000"]
    run = subprocess.run(
        [str(CHROMIUM), *options, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert not [line for line in run.stderr.splitlines() if "CONSOLE" in line and path.name in line]
    drawn = run.stdout.partition('<div id="map"')[2]
    for text in ("CDP 0.5", "CDP 0.9", "CDP 0.95", "scene luminance in cd/m²", "stage sensor"):
        assert f">{text}<" in drawn
    assert drawn.count('class="heatmaplayer') >= 1
    assert "<b>bold" not in drawn


def traces(dataset: xr.Dataset) -> list[dict[str, object]]:
    """Traces of the page's drawing."""
    call = page(dataset).rpartition("Plotly.newPlot(")[2]
    found: list[dict[str, object]] = json.JSONDecoder().raw_decode(call[call.index("[") :])[0]
    return found


def test_entries_of_the_legend_of_a_page_look_different(dataset: xr.Dataset) -> None:
    dataset = dataset.assign(snr_bright=dataset["snr_dark"] * 1.2, csnr=dataset["snr_dark"] / 2)
    legend = [trace for trace in traces(one_contrast(dataset)) if trace.get("showlegend") is not False]
    assert [trace["name"] for trace in legend] == [
        "usable range",
        "95 % band",
        "CDP",
        "SNR, dark region",
        "dip",
        "SNR, bright region",
        "CSNR",
        "CDP 0.9",
    ]
    curves = [trace["line"]["color"] for trace in legend if trace.get("hovertemplate")]  # type: ignore[index]
    assert len(set(curves)) == 4


def test_snr_of_saturated_pixels_is_not_drawn(dataset: xr.Dataset) -> None:
    clipped = dataset.assign(snr_dark=dataset["snr_dark"].where(dataset[LUMINANCE] < 3000, 1e42))
    assert "1e+42" not in page(clipped)
    missing = dataset.assign(snr_dark=dataset["snr_dark"].where(dataset[LUMINANCE] < 3000))
    assert page(clipped) == page(missing)
    np.testing.assert_array_equal(picture(one_contrast(clipped)), picture(one_contrast(missing)))


def test_sheets_hold_each_cell_as_numbers(staged: xr.Dataset) -> None:
    found = book(staged)
    assert found.sheetnames == ["Map", "CDP 1", "CDP 2", "Usable ranges", "Dips", "Provenance"]
    head, *rows = found["Map"].iter_rows(values_only=True)
    assert head[:5] == ("stage", "scene luminance in cd/m²", "Weber contrast", "CDP", "standard error of CDP")
    expected = staged["cdp"].stack(row=("stage", LUMINANCE, CONTRAST))
    assert [row[0] for row in rows] == expected["stage"].values.tolist()
    np.testing.assert_allclose([row[2] for row in rows], expected[CONTRAST].values, rtol=1e-14)
    np.testing.assert_allclose([row[3] for row in rows], expected.values, rtol=1e-14)
    assert {cell.number_format for cell in found["Map"]["C"][1:]} == {"0.00%"}


def test_matrix_has_its_axes_as_numbers_and_a_colour_scale(dataset: xr.Dataset) -> None:
    found = book(dataset)["CDP"]
    np.testing.assert_allclose([cell.value for cell in found[1][1:]], dataset[LUMINANCE].values, rtol=1e-14)
    np.testing.assert_allclose([row[0].value for row in found.iter_rows(min_row=2)], dataset[CONTRAST].values)
    values = [[cell.value for cell in row[1:]] for row in found.iter_rows(min_row=2)]
    np.testing.assert_allclose(values, dataset["cdp"].values.T, rtol=1e-14)
    assert {row[0].number_format for row in found.iter_rows(min_row=2)} == {"0.00%"}
    (scale,) = found.conditional_formatting
    assert str(scale.sqref) == "B2:Y9"
    assert [rule.type for rule in scale.rules] == ["colorScale"]


def test_sheets_of_ranges_and_dips_are_the_analysis(dataset: xr.Dataset) -> None:
    found, analysis = book(dataset), analyse_map(dataset)
    ranges = list(found["Usable ranges"].iter_rows(min_row=2, values_only=True))
    expected = [
        (one.at[CONTRAST], i.low, i.high, *i.low_bracket, *i.high_bracket)
        for one in analysis.usable_ranges
        for i in one.intervals
    ]
    assert [(row[0], row[2], row[3], *row[8:]) for row in ranges if row[2]] == [
        pytest.approx(e, rel=1e-14) for e in expected
    ]
    dips = list(found["Dips"].iter_rows(min_row=2, values_only=True))
    assert [row[1] for row in dips] == [dip.variable for dip in analysis.dips]
    assert [row[3] for row in dips] == pytest.approx([dip.position for dip in analysis.dips], rel=1e-14)


def test_workbook_keeps_text_and_repeats_its_bytes(staged: xr.Dataset) -> None:
    staged = staged.assign_attrs(title="=1+1")
    one, two = (map_spreadsheet(staged, analyse_map(staged), TIME) for _ in range(2))
    assert one == two
    title = openpyxl.load_workbook(BytesIO(one))["Provenance"]["B2"]
    assert (title.value, title.data_type) == ("=1+1", "s")


def test_table_of_usable_ranges(staged: xr.Dataset) -> None:
    staged = staged.isel({CONTRAST: [0, 7]})
    table = usable_table(staged, analyse_map(staged))
    assert list(table.columns) == ["stage", "Weber contrast", "scene luminance of CDP ≥ 0.9"]
    assert [list(row[:2]) for row in table.rows] == [[s, c] for s in ("sensor", HOSTILE) for c in ("2 %", "100 %")]
    assert table.rows[0][2] == "nowhere"
    assert re.fullmatch(r"[\d.]+ to ≥ 10000 cd/m² \(at least [\d.]+ decades, [\d.]+ dB\)", table.rows[1][2])


def test_values_of_a_map_from_a_file_are_json(dataset: xr.Dataset, tmp_path: Path) -> None:
    save_netcdf(dataset, tmp_path / "map.nc")
    read = load_netcdf(tmp_path / "map.nc")
    values = json.loads(results_json(map_values(read, analyse_map(read))))
    assert (values["seed"], values["epsilon"], "chain" in values) == (3, 0.5, False)


def test_files_of_a_map(staged: xr.Dataset, tmp_path: Path) -> None:
    paths = write_map(staged, tmp_path / "new" / "folder", expected=[500.0])
    assert [path.name for path in paths] == ["map.nc", "map.png", "map.html", "map.xlsx", "map.json"]
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == sorted(p.name for p in paths)
    xr.testing.assert_identical(load_netcdf(paths[0]), staged)
    analysis = json.loads(paths[-1].read_text(encoding="utf-8"))
    assert {dip["expected"] for dip in analysis["dips"]} == {500.0}
    assert (analysis["method"], analysis["contrast"], analysis["x"]) == ("simulated", None, LUMINANCE)
    assert analysis["axes"]["stage"] == {"unit": "", "values": ["sensor", HOSTILE]}


def test_nothing_is_written_of_a_map_that_cannot_be_drawn(dataset: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"needs 13 panels"):
        write_map(dataset.expand_dims({"seed": [str(i) for i in range(13)]}), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_a_file_is_named(dataset: xr.Dataset, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file cannot be written \(File exists\): give a folder"):
        write_map(one_contrast(dataset), tmp_path / "file")
