"""Charts in pictures that plain NumPy makes: dynamic range, matrix, and where patches are found."""

import json
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import openpyxl
import pytest

import labcdp as package
from labcdp.api.session_result import SessionResult
from labcdp.core.errors import InputError
from labcdp.evaluate.bench.session_page import session_files
from labcdp.evaluate.bench.session_result import session_result
from labcdp.evaluate.chart.chart_file import chart_names, chart_template, load_chart
from labcdp.evaluate.chart.figures import range_cards
from labcdp.regions.chart import perspective

from ...chart_picture import (
    BLACK_DN,
    CORNERS,
    FULL_E,
    K_DN_PER_E,
    LEFT,
    READ_E,
    SIDE,
    TOP,
    WHITE_E,
    make_picture,
    stated_density,
)


def evaluate(run, tmp_path, *options, picture="chart.tif"):
    stated = ("--bit-depth", "12", "--black-level", BLACK_DN, "--no-vignetting")
    args = ["image", tmp_path / picture, *stated, "--output", tmp_path / "out"]
    done = run(*map(str, (*args, *options)))
    assert done.returncode == 0, done.stderr
    return json.loads((tmp_path / "out" / "results.json").read_text())


def corners_text(corners):
    return " ".join(f"{x},{y}" for x, y in corners)


@pytest.fixture
def chart_path(tmp_path):
    (tmp_path / "chart.toml").write_text(chart_template("grid-6x6"))
    return tmp_path / "chart.toml"


def low_end(limit, background_e2):
    """Share of white at which the SNR has a limit, in closed form."""
    return (limit**2 + np.sqrt(limit**4 + 4 * limit**2 * background_e2)) / 2 / WHITE_E


def test_dynamic_range_of_a_simulated_chart_is_that_of_its_closed_form(labcdp, tmp_path, chart_path):
    make_picture(tmp_path / "chart.tif")
    result = evaluate(labcdp, tmp_path, "--chart", chart_path, "--corners", corners_text(CORNERS), "--no-pages")
    ranges = {(row["figure"], row["limit"]): row for row in result["tables"]["dynamic_range"]["rows"]}
    rounding_e2 = 1 / 12 / K_DN_PER_E**2
    for limit in (2, 4, 10):
        row = ranges["SNR", limit]
        true = low_end(limit, READ_E**2 + rounding_e2)
        assert abs(np.log2(row["low"] / true)) < 0.05
        assert abs(row["range_stops"] - np.log2(FULL_E / WHITE_E / true)) < 0.05
        assert row["high_reason"].startswith("saturated")
    assert ranges["SNR", 1]["range_stops_bound"] == ">"


def test_matrix_equals_single_pairs_and_targets_are_those_of_the_chart(labcdp, tmp_path, chart_path):
    dn = make_picture(tmp_path / "chart.tif")
    result = evaluate(labcdp, tmp_path, "--chart", chart_path, "--corners", corners_text(CORNERS), "--no-pages")
    matrix = result["tables"]["cdp matrix"]["rows"]
    inset = round(0.2 * SIDE)

    def pixels(patch):
        row, column = divmod(patch, 6)
        y, x = TOP + row * SIDE, LEFT + column * SIDE
        return dn[y + inset : y + SIDE - inset, x + inset : x + SIDE - inset].astype(float) - BLACK_DN

    for bright, dark in ((8, 20), (10, 11), (3, 30)):
        stated = 10 ** (stated_density(dark) - stated_density(bright)) - 1
        expected = package.cdp(pixels(bright), pixels(dark), stated)
        assert matrix[bright][f"patch_{dark + 1}"] == pytest.approx(expected.cdp, abs=1e-12)
    contrast = result["tables"]["contrast matrix"]["rows"][8]["patch_21"]
    assert contrast == pytest.approx(10**1.2 - 1, rel=1e-9)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_chart_that_is_turned_is_noticed(labcdp, tmp_path, chart_path, turns):
    make_picture(tmp_path / "chart.tif")
    corners = CORNERS[turns:] + CORNERS[:turns]
    result = evaluate(labcdp, tmp_path, "--chart", chart_path, "--corners", corners_text(corners), "--no-pages")
    assert "chart-order" in {finding["code"] for finding in result["findings"]}


def test_saturated_patches_have_no_cdp(labcdp, tmp_path, chart_path):
    make_picture(tmp_path / "chart.tif")
    result = evaluate(labcdp, tmp_path, "--chart", chart_path, "--corners", corners_text(CORNERS), "--no-pages")
    codes = {finding["code"] for finding in result["findings"]}
    assert "chart-clipped" in codes
    assert "chart-order" not in codes
    assert set(list(result["tables"]["cdp matrix"]["rows"][0].values())[1:]) == {None}
    first = result["tables"]["cdp"]["rows"][0]
    assert (first["pair"].split(" / ")[0], first["cdp"], first["verdict"]) == ("A1", None, "saturated")


def test_glare_seen_of_a_black_patch_is_taken_off(labcdp, tmp_path, chart_path):
    chart_path.write_text(chart_path.read_text().replace('name = "F6"', 'name = "F6"\nblack = true'))
    glare_e = 80.0
    make_picture(tmp_path / "chart.tif", glare_e=glare_e, black_e=0.0)
    result = evaluate(labcdp, tmp_path, "--chart", chart_path, "--corners", corners_text(CORNERS), "--no-pages")
    glare = next(finding for finding in result["findings"] if finding["code"] == "chart-glare")
    assert glare["values"]["glare"] == pytest.approx(glare_e / WHITE_E, rel=0.02)
    ranges = {(row["figure"], row["limit"]): row for row in result["tables"]["dynamic_range"]["rows"]}
    true = low_end(4, READ_E**2 + 1 / 12 / K_DN_PER_E**2 + glare_e)
    assert abs(np.log2(ranges["SNR without glare", 4]["low"] / true)) < 0.06
    # Veiling light is no signal: with it a chart seems to be seen farther down.
    assert ranges["SNR", 4]["low"] < 0.7 * true


def test_glare_of_the_surroundings_follows_from_a_picture_with_dark_ones(labcdp, tmp_path, chart_path):
    glare_e = 80.0
    make_picture(tmp_path / "chart.tif", glare_e=glare_e)
    make_picture(tmp_path / "dark.tif", seed=4)
    options = ("--chart", chart_path, "--corners", corners_text(CORNERS), "--no-pages")
    result = evaluate(labcdp, tmp_path, *options, "--dark-surroundings", tmp_path / "dark.tif")
    (glare,) = (finding["values"] for finding in result["findings"] if finding["code"] == "chart-glare-of-surroundings")
    # 4 standard uncertainties of the fit; the scale of the chart is that of its brightest patches.
    assert abs(glare["glare"] - glare_e / WHITE_E) < 4 * glare["U"] / 1.96 + 0.01 * glare_e / WHITE_E
    assert glare["U"] < 0.05 * glare["glare"]
    ranges = {(row["figure"], row["limit"]): row for row in result["tables"]["dynamic_range"]["rows"]}
    true = low_end(4, READ_E**2 + 1 / 12 / K_DN_PER_E**2 + glare_e)
    assert abs(np.log2(ranges["SNR without glare", 4]["low"] / true)) < 0.06
    assert ranges["SNR", 4]["low"] < 0.7 * true
    assert "dark surroundings" in {file["role"] for file in result["inputs"]}
    images = [
        package.read_image(tmp_path / name, bit_depth=12, black_level_dn=BLACK_DN, no_vignetting=True)
        for name in ("chart.tif", "dark.tif")
    ]
    measured = images[0].chart(chart_path, corners=CORNERS, dark_surroundings=images[1])
    assert measured.glare.value == glare["glare"]
    refused = labcdp("image", "chart.tif", "--roi", "none.json", "--dark-surroundings", "dark.tif")
    assert "--dark-surroundings requires --chart" in refused.stderr
    cv2.imwrite(str(tmp_path / "small.tif"), np.zeros((40, 40), np.uint16))
    small = package.read_image(tmp_path / "small.tif", bit_depth=12, black_level_dn=BLACK_DN)
    with pytest.raises(InputError, match="the picture with dark surroundings has 40 x 40 pixels"):
        images[0].chart(chart_path, corners=CORNERS, dark_surroundings=small)


def test_u_of_white_is_part_of_both_ends_and_not_of_their_ratio(tmp_path, chart_path):
    make_picture(tmp_path / "chart.tif")
    image = package.read_image(tmp_path / "chart.tif", bit_depth=12, black_level_dn=BLACK_DN, no_vignetting=True)
    text = chart_path.read_text()
    ranges = []
    for u in ("0.0", "98.0"):
        stated = text.replace(
            'quantity = "density"\n', f'quantity = "density"\nwhite_cd_m2 = 1000.0\nU_white_cd_m2 = {u}\n'
        )
        chart_path.write_text(stated)
        ranges.append(image.chart(chart_path, corners=CORNERS).ranges[2].range)
    known, white = ranges
    assert white.u_stops == pytest.approx(known.u_stops, rel=1e-9)
    half_widths = [np.diff(np.log(item.low_interval))[0] / 2 for item in ranges]
    assert half_widths[1] == pytest.approx(np.hypot(half_widths[0], 0.098), rel=1e-3)
    chart_path.write_text(text.replace("U = 0.0", "U = 0.1").replace("U = 0.02", "U = 0.1"))
    uncertain = image.chart(chart_path, corners=CORNERS).ranges[2].range
    assert uncertain.u_stops > known.u_stops


def test_a_chart_is_found_by_its_marks_in_perspective(labcdp, tmp_path, chart_path):
    marks = "".join(
        f"\n[[marks]]\nnumber = {number}\nx = {x / SIDE}\ny = {y / SIDE}\nside = {36 / SIDE}\n"
        for number, (x, y) in enumerate([(5 - LEFT, 5 - TOP), (6 * SIDE + 5, 5 - TOP), (5 - LEFT, 6 * SIDE - 20)])
    )
    text = chart_path.read_text()
    chart_path.write_text(text[: text.index("[[patches]]")] + marks.lstrip() + "\n" + text[text.index("[[patches]]") :])
    dn = make_picture(tmp_path / "straight.tif", marks=True)
    height, width = dn.shape
    outline = np.float32([(0, 0), (width, 0), (width, height), (0, height)])
    seen = np.float32([(30, 10), (width - 5, 25), (width - 20, height - 8), (12, height - 20)])
    matrix = cv2.getPerspectiveTransform(outline, seen)
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    cv2.imwrite(
        str(tmp_path / "chart.tif"), cv2.warpPerspective(dn, np.linalg.inv(shift) @ matrix @ shift, (width, height))
    )
    chart, _ = load_chart(chart_path)
    grey = cv2.imread(str(tmp_path / "chart.tif"), cv2.IMREAD_UNCHANGED)
    found = chart.found(grey)
    true = chart.regions(cv2.perspectiveTransform(np.float64([CORNERS]), np.float64(matrix))[0])
    for roi, expected in zip(found, true, strict=True):
        assert np.abs(np.array(roi.corners) - expected.corners).max() < 1.5
    result = evaluate(labcdp, tmp_path, "--chart", chart_path, "--no-pages")
    assert result["tables"]["dynamic_range"]["rows"][1]["range_stops"] > 9


def test_several_pictures_overlay_on_one_page(labcdp, tmp_path, chart_path):
    for name, seed in (("a.tif", 1), ("b.tif", 2)):
        make_picture(tmp_path / name, seed=seed)
    result = evaluate(
        labcdp, tmp_path, tmp_path / "b.tif", "--chart", chart_path, "--corners", corners_text(CORNERS), picture="a.tif"
    )
    stops = [row["range_stops"] for row in result["tables"]["dynamic_range"]["rows"] if row["limit"] == 4]
    assert len(stops) == 2
    assert abs(stops[0] - stops[1]) < 0.1
    assert (tmp_path / "out" / "report.html").is_file()


def test_values_from_a_certificate_take_the_place_of_nominal_ones(tmp_path, chart_path):
    chart_path.write_text(chart_path.read_text().replace("# values =", "values ="))
    rows = "\n".join(f"{'ABCDEF'[n // 6]}{n % 6 + 1};{0.07 + 0.1 * n:.2f}".replace(".", ",") for n in range(36))
    (tmp_path / "certificate.csv").write_text("patch;density\n" + rows + "\n")
    chart, files = load_chart(chart_path)
    assert chart.patches[3].value == pytest.approx(0.37)
    assert [file.role for file in files] == ["chart", "chart values"]
    chart_path.write_text(chart_path.read_text().replace("certificate.csv", "certificate.xlsx"))
    book = openpyxl.Workbook()
    for row in (["Certificate"], ["patch", "density"], *(line.split(";") for line in rows.split("\n"))):
        book.active.append([float(cell.replace(",", ".")) if "," in cell else cell for cell in row])
    book.save(tmp_path / "certificate.xlsx")
    assert [one.value for one in load_chart(chart_path)[0].patches] == [one.value for one in chart.patches]
    book.active["B5"] = "0,27"
    book.save(tmp_path / "certificate.xlsx")
    with pytest.raises(InputError, match=r"certificate\.xlsx: Sheet!B5: '0,27' is text, not a number"):
        load_chart(chart_path)


@pytest.mark.parametrize("name", chart_names())
def test_charts_that_ship_can_be_read_and_lie_apart(tmp_path, name):
    (tmp_path / "chart.toml").write_text(chart_template(name))
    chart, _ = load_chart(tmp_path / "chart.toml")
    assert chart.is_stated
    rois = chart.regions([(0, 0), (1000, 0), (1000, 1000), (0, 1000)])
    covered = np.zeros((1000, 1000), dtype=int)
    for roi in rois:
        covered[roi.window((1000, 1000))] += roi.mask((1000, 1000))
    assert covered.max() == 1


def test_perspective_of_many_points_is_that_of_opencv():
    rng = np.random.default_rng(5)
    plane = rng.uniform(0, 10, (12, 2))
    matrix = np.array([[90, 4, 30], [-3, 80, 20], [0.004, -0.002, 1]])
    image = cv2.perspectiveTransform(plane[None], matrix)[0]
    assert perspective(plane, image) == pytest.approx(matrix, rel=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('name = "A2"', 'name = "A1"', "A1"),
        ("x = 1.0", "x = 9.0", "outside"),
        ("margin = 0.2", "margin = 0.6", "margin"),
        ('quantity = "density"', 'quantity = "reflectance"\nwhite_cd_m2 = -1.0', "white_cd_m2"),
        ("value = 0.15", 'value = "0.15"', "value"),
    ],
)
def test_wrong_chart_files_are_refused_by_name(chart_path, old, new, named):
    chart_path.write_text(chart_path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=named):
        load_chart(chart_path)


def test_python_gives_what_the_command_gives(labcdp, tmp_path, chart_path):
    make_picture(tmp_path / "chart.tif")
    result = evaluate(labcdp, tmp_path, "--chart", chart_path, "--corners", corners_text(CORNERS), "--no-pages")
    image = package.read_image(tmp_path / "chart.tif", bit_depth=12, black_level_dn=BLACK_DN, no_vignetting=True)
    measured = image.chart(chart_path, corners=CORNERS)
    rows = result["tables"]["dynamic_range"]["rows"]
    assert [chart_range.range.low for chart_range in measured.ranges] == [row["low"] for row in rows]
    regions = {
        name: roi.corners for name, roi in zip(measured.chart.names, measured.chart.regions(CORNERS), strict=True)
    }
    drawn = image.chart(chart_path, regions=regions)
    assert drawn.matrix.equals(measured.matrix)
    with pytest.raises(InputError, match="regions have no 'B1'"):
        image.chart(chart_path, regions={name: regions[name] for name in measured.chart.names if name != "B1"})
    with pytest.raises(InputError, match="has no marks"):
        image.chart(chart_path)


def test_the_target_of_a_session_is_a_chart_with_the_readings_as_its_values(evaluation, tmp_path):
    names = [row.patch.name for row in evaluation.patches]
    place = "y = 0\nwidth = 1\nheight = 1\n"
    patches = "".join(f'[[patches]]\nname = "{name}"\nx = {x}\n{place}' for x, name in enumerate(names))
    chart_path = tmp_path / "target.toml"
    chart_path.write_text(f'name = "target"\nwidth = {len(names)}\nheight = 1\n{patches}')
    chart = SessionResult(evaluation).chart(chart_path)
    for row, luminance, region in zip(evaluation.patches, chart.luminance, chart.regions, strict=True):
        assert luminance == row.reading.luminance_cd_m2
        # The map has one frame of each exposure, the evaluation all of them.
        assert region.mean == pytest.approx(row.calibrated.luminance_cd_m2, rel=0.01)
    bright, dark = evaluation.patches[0], evaluation.patches[-1]
    contrast = chart.matrix["contrast"].sel(bright=bright.patch.name, dark=dark.patch.name)
    expected = max(bright.reading.luminance_cd_m2, dark.reading.luminance_cd_m2)
    expected /= min(bright.reading.luminance_cd_m2, dark.reading.luminance_cd_m2)
    assert float(contrast) == pytest.approx(expected - 1, rel=1e-9)
    assert {"chart-values-read", "chart-of-bracket"} <= {finding.code for finding in chart.findings}
    whole = replace(evaluation, chart=chart)
    result = session_result(whole)
    written = session_files(whole, result)
    assert {"dynamic_range", "cdp matrix"} <= {table.name for table in result.tables}
    assert b"Dynamic range" in written["report.html"]


def test_a_card_of_a_range_that_the_chart_ends_states_no_more_than_is_known():
    ends = SimpleNamespace(
        stops=3.616, bound=">", low=33.6, high=412.0, decibels=21.8, ratio=12.3, u_stops=0.0, limit=1.0
    )
    (card,) = range_cards(SimpleNamespace(unit="cd/m²", ranges=[SimpleNamespace(name="SNR", range=ends)]))
    assert card.value == "> 3.61 stops"


def test_compare_takes_charts(labcdp, tmp_path, chart_path):
    make_picture(tmp_path / "chart.tif")
    make_picture(tmp_path / "veiled.tif", seed=9, glare_e=60.0)
    ranges = []
    for name in ("chart", "veiled"):
        done = labcdp(
            "image", f"{name}.tif", "--chart", str(chart_path), "--corners", corners_text(CORNERS), "--bit-depth", "12",
            "--black-level", str(BLACK_DN), "--no-vignetting", "--no-pages", "--output", name,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        rows = json.loads((tmp_path / name / "results.json").read_text())["tables"]["dynamic_range"]["rows"]
        ranges.append({(row["figure"], row["limit"]): row["range_stops"] for row in rows})
    compared = package.compare(tmp_path / "chart", tmp_path / "veiled").to_dict()["tables"]["differences"]["rows"]
    rows = {row["quantity"]: row for row in compared}
    expected = ranges[1]["CNR", 1] - ranges[0]["CNR", 1]
    assert rows["dynamic range, CNR ≥ 1"]["difference"] == pytest.approx(expected, rel=1e-9)
    # A range that ends with the chart is a bound.
    assert rows["dynamic range, SNR ≥ 1"]["difference"] is None
