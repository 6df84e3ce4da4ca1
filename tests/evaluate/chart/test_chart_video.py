"""Charts in videos that plain NumPy renders: of a moving camera, in flickering light, covered, and lost."""

import json

import cv2
import numpy as np
import openpyxl
import pytest
import xarray as xr

import labcdp as package
from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.evaluate.chart.chart_file import load_chart
from labcdp.evaluate.chart_video.evaluate import evaluate_chart_video
from labcdp.evaluate.chart_video.page import chart_video_result
from labcdp.evaluate.chart_video.run import packed, unpacked
from labcdp.evaluate.chart_video.settings import ChartVideoSettings
from labcdp.evaluate.video.evaluate import JOURNAL

#: A chart of 4 x 3 patches of 32 pixels in frames of 160 x 200.
ROWS, COLUMNS, SIDE, LEFT, TOP, SHAPE = 3, 4, 32, 30, 28, (160, 200)
WHITE_E, READ_E, K_DN_PER_E, BLACK_DN, BITS = 12_000.0, 4.0, 0.25, 64, 12
DENSITIES = 0.1 + 0.28 * np.arange(ROWS * COLUMNS)
CORNERS = np.float64([
    (LEFT, TOP), (LEFT + COLUMNS * SIDE, TOP), (LEFT + COLUMNS * SIDE, TOP + ROWS * SIDE), (LEFT, TOP + ROWS * SIDE),
])  # fmt: skip
STATED = {"bit_depth": BITS, "black_level_dn": BLACK_DN, "no_vignetting": True}


def chart_text(values=True, marks=""):
    patches = ""
    for number, density in enumerate(DENSITIES):
        row, column = divmod(number, COLUMNS)
        value = f"value = {density:.4f}\n" if values else ""
        patches += f'[[patches]]\nname = "P{number}"\nx = {column}\ny = {row}\nwidth = 1\nheight = 1\n{value}'
    quantity = 'quantity = "density"\n' if values else ""
    return f'name = "small"\nwidth = {COLUMNS}\nheight = {ROWS}\n{quantity}\n{marks}{patches}'


def scene():
    light = np.full(SHAPE, 0.03)
    for number, density in enumerate(DENSITIES):
        row, column = divmod(number, COLUMNS)
        y, x = TOP + row * SIDE, LEFT + column * SIDE
        light[y : y + SIDE, x : x + SIDE] = 10**-density
    return light


def motion(frame):
    """Perspective of a camera that moves and tilts."""
    angle = 0.006 * frame
    turn = np.array([[np.cos(angle), -np.sin(angle), 1.7 * frame], [np.sin(angle), np.cos(angle), -0.8 * frame]])
    return np.vstack([turn, [4e-6 * frame, 0, 1]])


def write_frames(folder, levels, moving=False, alter=None):
    """Write a frame for each level of the light, as a folder of images of 12 bits."""
    folder.mkdir()
    rng, light = np.random.default_rng(7), scene()
    for number, level in enumerate(levels):
        seen = cv2.warpPerspective(light, motion(number), SHAPE[::-1], borderValue=0.03) if moving else light.copy()
        if alter is not None:
            alter(number, seen)
        electrons = rng.poisson(WHITE_E * level * seen) + rng.normal(0, READ_E, SHAPE)
        dn = np.clip(np.round(electrons * K_DN_PER_E) + BLACK_DN, 0, 2**BITS - 1).astype(np.uint16)
        cv2.imwrite(str(folder / f"frame-{number:03d}.tif"), dn)
    return folder


def settings(chart_path, method="fixed", **more):
    chart, files = load_chart(chart_path)
    located = {"rois": chart.regions(CORNERS.tolist())} | STATED | more
    return ChartVideoSettings(method=method, chart=chart, inputs=tuple(files), **located)


@pytest.fixture(scope="module")
def chart_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("chart") / "chart.toml"
    path.write_text(chart_text())
    return path


LEVELS = (1.0, 0.35, 0.8, 0.5)


@pytest.fixture(scope="module")
def flickering(tmp_path_factory):
    return write_frames(tmp_path_factory.mktemp("flicker") / "frames", LEVELS)


@pytest.fixture(scope="module")
def measured(flickering, chart_path):
    return evaluate_chart_video(flickering, settings(chart_path))


@pytest.fixture(scope="module")
def pictures(flickering, chart_path):
    """Each frame measured as a picture of the chart."""
    images = [package.read_image(path, **STATED) for path in sorted(flickering.iterdir())]
    return [image.chart(chart_path, corners=CORNERS.tolist()) for image in images]


def test_each_frame_is_measured_as_a_picture_to_the_last_bit(measured, pictures):
    for name, region in (("mean", "mean"), ("u_mean", "u")):
        expected = [[getattr(patch, region) for patch in picture.regions] for picture in pictures]
        np.testing.assert_array_equal(measured[name], expected)
    ranges = [[item.range.stops for item in picture.ranges] for picture in pictures]
    np.testing.assert_array_equal(measured["range_stops"], ranges)
    assert measured["range"].values.tolist()[:2] == ["SNR ≥ 1", "SNR ≥ 2"]
    low = [[item.range.low_interval.low for item in picture.ranges] for picture in pictures]
    np.testing.assert_array_equal(measured["range_low_from"], low)
    steps = [[picture.matrix["cdp_high"].values[at, at + 1] for at in range(11)] for picture in pictures]
    np.testing.assert_array_equal(measured["neighbour_cdp_high"], steps)


def test_pairs_have_mean_and_lowest_cdp_of_the_frames(measured, pictures):
    cdp, low = (np.array([picture.matrix[name].values for picture in pictures]) for name in ("cdp", "cdp_low"))
    np.testing.assert_array_equal(measured["n_frames"], np.isfinite(cdp).sum(axis=0))
    apart = ~np.eye(12, dtype=bool)
    cdp, low = cdp[:, apart], low[:, apart]
    assert np.isfinite(cdp).all()
    of_pairs = {name: measured[name].values[apart] for name in measured.data_vars if measured[name].shape == (12, 12)}
    np.testing.assert_allclose(of_pairs["mean_cdp"], cdp.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(of_pairs["std_cdp"], cdp.std(axis=0, ddof=1), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(of_pairs["lowest_cdp"], cdp.min(axis=0))
    at = cdp.argmin(axis=0)
    np.testing.assert_array_equal(of_pairs["lowest_frame"], at)
    np.testing.assert_array_equal(of_pairs["lowest_cdp_low"], np.take_along_axis(low, at[None], 0)[0])
    np.testing.assert_allclose(of_pairs["detected_share"], (cdp >= 0.9).mean(axis=0))
    expected = 10 ** (DENSITIES - DENSITIES[:, None]) - 1
    above = expected > 0
    np.testing.assert_allclose(measured["contrast"].values[above], expected[above], rtol=1e-3)


def test_the_range_follows_the_light(measured):
    """Photon noise and read noise in closed form, within 0.05 stops: the low end is where the light has an SNR of 4."""
    background = READ_E**2 + 1 / 12 / K_DN_PER_E**2
    at = measured["range"].values.tolist().index("SNR ≥ 4")
    for level, low in zip(LEVELS, measured["range_low"].values[:, at], strict=True):
        true = (16 + np.sqrt(16**2 + 64 * background)) / 2 / (WHITE_E * level)
        assert abs(np.log2(low / true)) < 0.05 + 0.1


def test_a_range_that_the_chart_ends_is_a_bound_in_each_column(measured):
    rows = {row["figure"]: row for row in chart_video_result(measured).table("dynamic_range_over_frames").rows()}
    for name, row in rows.items():
        of_range = measured.sel(range=name)
        is_bound = dict(zip(of_range["range_stops"].values.tolist(), of_range["range_is_bound"].values, strict=True))
        for column in ("lowest_stops", "highest_stops"):
            assert row[f"{column}_bound"] == (">" if is_bound[row[column]] else "")
    assert any(row["lowest_stops_bound"] for row in rows.values())


def test_patches_in_another_order_than_stated_are_noticed(tmp_path, flickering, measured):
    path = tmp_path / "swapped.toml"
    third, eighth = (f"value = {DENSITIES[number]:.4f}" for number in (3, 8))
    path.write_text(chart_text().replace(third, "value = x").replace(eighth, third).replace("value = x", eighth))
    wrong = evaluate_chart_video(flickering, settings(path))
    codes = [[f["code"] for f in json.loads(dataset.attrs["findings"])] for dataset in (measured, wrong)]
    assert [each.count("chart-order") for each in codes] == [0, 1]


def test_a_moving_camera_is_followed(tmp_path, chart_path):
    frames = write_frames(tmp_path / "frames", (1.0, 0.6, 1.0, 0.7, 1.0), moving=True)
    dataset = evaluate_chart_video(frames, settings(chart_path, "follow"))
    assert not dataset["lost"].any()
    chart, _ = load_chart(chart_path)
    for number, path in enumerate(sorted(frames.iterdir())):
        corners = cv2.perspectiveTransform(CORNERS[None], motion(number))[0]
        centre = np.mean([roi.centre for roi in chart.regions(corners.tolist())], axis=0)
        seen_at = [float(dataset[name].values[number, 0]) for name in ("centre_x", "centre_y")]
        assert np.hypot(*(seen_at - centre)) < 0.5
        true = package.read_image(path, **STATED).chart(chart_path, corners=corners.tolist())
        cdp = [true.matrix["cdp"].values[at, at + 1] for at in range(11)]
        # Other pixels at the edges of the patches, of 370 each.
        np.testing.assert_allclose(dataset["neighbour_cdp"].values[number], cdp, atol=0.06)


def test_what_is_covered_has_no_value_and_a_chart_that_is_gone_is_lost(tmp_path, chart_path):
    def alter(number, light):
        if number == 2:
            light[TOP + SIDE : TOP + 2 * SIDE, LEFT + SIDE : LEFT + 2 * SIDE] = 0.6
        if number == 3:
            light[:] = np.random.default_rng(5).uniform(0.02, 0.5, light.shape)

    frames = write_frames(tmp_path / "frames", (1.0,) * 5, moving=True, alter=alter)
    dataset = evaluate_chart_video(frames, settings(chart_path, "follow"))
    assert dataset["lost"].values[:, 0].tolist() == [False, False, False, True, False]
    seen = np.isfinite(dataset["mean"].values)
    assert seen[[0, 1, 4]].all()
    assert not seen[3].any()
    assert np.flatnonzero(~seen[2]).tolist() == [5]
    assert int(dataset["n_frames"].sel(bright="P5", dark="P6")) == 3
    assert int(dataset["n_frames"].sel(bright="P1", dark="P2")) == 4
    codes = {finding["code"] for finding in json.loads(dataset.attrs["findings"])}
    assert "frames-lost" in codes
    assert "P5" in dataset["note"].values[2]
    (row,) = chart_video_result(dataset).table("lost").rows()
    assert (row["region"], row["first_frame"], row["n_frames"]) == ("small", 3, 1)


def test_a_chart_without_values_has_the_contrasts_of_its_first_frame(tmp_path, flickering):
    path = tmp_path / "chart.toml"
    path.write_text(chart_text(values=False))
    dataset = evaluate_chart_video(flickering, settings(path))
    first = package.read_image(min(flickering.iterdir()), **STATED).chart(path, corners=CORNERS.tolist())
    expected = first.matrix["contrast"].values
    known = np.isfinite(expected)
    np.testing.assert_allclose(dataset["contrast"].values[known], expected[known], rtol=1e-12)
    np.testing.assert_array_equal(
        dataset["neighbour_cdp"][0], [first.matrix["cdp"].values[i, i + 1] for i in range(11)]
    )
    assert "chart-not-stated" in {finding["code"] for finding in json.loads(dataset.attrs["findings"])}


def test_an_interrupted_evaluation_is_resumed_with_the_same_result(tmp_path, flickering, chart_path, measured):
    evaluate_chart_video(flickering, settings(chart_path), tmp_path / "out")
    (journal,) = (tmp_path / "out").glob(JOURNAL)
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:3]))
    done = []
    again = evaluate_chart_video(
        flickering, settings(chart_path), tmp_path / "out", progress=lambda *at: done.append(at)
    )
    assert done
    assert again.identical(measured)
    changed = tmp_path / "changed.toml"
    changed.write_text(chart_text().replace("value = 0.1000", "value = 0.1100"))
    with pytest.raises(InputError, match="holds the results of another evaluation"):
        evaluate_chart_video(flickering, settings(changed), tmp_path / "out")


def test_given_contrasts_are_a_dimension(flickering, chart_path, measured):
    video = package.open_video(flickering, **STATED)
    several = video.chart(chart_path, ["25%", 1.0], corners=CORNERS.tolist(), method="fixed", stop=2)
    assert several["lowest_cdp"].dims == ("bright", "dark", "contrast")
    single = video.chart(chart_path, 1.0, corners=CORNERS.tolist(), method="fixed", stop=2)
    xr.testing.assert_equal(several["mean_cdp"].sel(contrast=1.0, drop=True), single["mean_cdp"].drop_vars("contrast"))
    named = {name: roi.corners for name, roi in zip(measured["patch"].values, load_chart(chart_path)[0].regions(
        CORNERS.tolist()), strict=True)}  # fmt: skip
    drawn = video.chart(chart_path, regions=named, method="fixed")
    np.testing.assert_array_equal(drawn["mean_cdp"], measured["mean_cdp"])


def test_the_chart_is_sought_by_its_marks_in_the_first_frame(tmp_path):
    tile = 20
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    places = [(4, 4), (SHAPE[1] - tile - 4, 4), (4, SHAPE[0] - tile - 4), (SHAPE[1] - tile - 4, SHAPE[0] - tile - 4)]
    marks = "".join(
        f"[[marks]]\nnumber = {number}\nx = {(x - LEFT) / SIDE}\ny = {(y - TOP) / SIDE}\nside = {tile / SIDE}\n\n"
        for number, (x, y) in enumerate(places)
    )

    def alter(_, light):
        light[light == 0.03] = 0.5
        for number, (x, y) in enumerate(places):
            mark = cv2.aruco.generateImageMarker(dictionary, number, tile)
            light[y : y + tile, x : x + tile] = np.where(mark > 0, 0.5, 0.02)

    path = tmp_path / "chart.toml"
    path.write_text(chart_text(marks=marks))
    frames = write_frames(tmp_path / "frames", (1.0, 0.8), alter=alter)
    dataset = evaluate_chart_video(frames, settings(path, rois=()))
    expected = np.mean([roi.centre for roi in load_chart(path)[0].regions(CORNERS.tolist())], axis=0)
    assert dataset["centre_x"].values[0, 0] == pytest.approx(expected[0], abs=0.5)
    assert dataset["centre_y"].values[0, 0] == pytest.approx(expected[1], abs=0.5)


def test_the_command_writes_page_sheets_and_data(labcdp, tmp_path, flickering, chart_path, measured):
    corners = " ".join(f"{x},{y}" for x, y in CORNERS.tolist())
    options = ["--bit-depth", str(BITS), "--black-level", str(BLACK_DN), "--no-vignetting", "--method", "fixed"]
    given = ["video", str(flickering), "--chart", str(chart_path), *options, "--output", str(tmp_path / "out")]
    done = labcdp(*given, "--corners", corners)
    assert done.returncode == 0, done.stderr
    assert "Dynamic range over the frames" in done.stdout
    stored = xr.load_dataset(tmp_path / "out" / "results.nc")
    np.testing.assert_array_equal(stored["lowest_cdp"], measured["lowest_cdp"])
    tables = json.loads((tmp_path / "out" / "results.json").read_text())["tables"]
    row = tables["dynamic_range_over_frames"]["rows"][2]
    stops = measured["range_stops"].values[:, 2]
    assert (row["figure"], row["lowest_stops"]) == ("SNR ≥ 4", stops.min())
    assert row["mean_stops"] == pytest.approx(stops.mean())
    assert tables["lowest_cdp matrix"]["rows"][0]["patch_3"] == float(measured["lowest_cdp"][0, 2])
    neighbours = tables["neighbouring_patches"]["rows"]
    assert neighbours[3]["pair"] == "P3 / P4"
    assert neighbours[3]["lowest_cdp_low"] == float(measured["lowest_cdp_low"].sel(bright="P3", dark="P4"))
    sheets = openpyxl.load_workbook(tmp_path / "out" / "results.xlsx", read_only=True)
    assert {"mean_cdp matrix", "lowest_cdp matrix", "detected_share matrix", "Frames"} <= set(sheets.sheetnames)
    assert "Dynamic range, SNR ≥ 4" in (tmp_path / "out" / "report.html").read_text()
    refused = labcdp(*given, "--corners", corners, "--pair", "P1:P2")
    assert "--chart compares all patches: leave --pair out" in refused.stderr


def test_regions_that_are_no_patches_are_refused(chart_path):
    with pytest.raises(InputError, match="the regions are not the patches of the chart"):
        settings(chart_path, rois=(Roi.rectangle("P0", 0, 0, 5, 5),))
    with pytest.raises(InputError, match="no chart is given"):
        ChartVideoSettings(method="fixed")


def test_numbers_in_the_journal_keep_their_last_bit():
    values = np.array([[0.1, np.nan, 1.0], [np.nextafter(0.3, 1), 0.0, -0.0]])
    np.testing.assert_array_equal(unpacked(packed(values), values.shape), values)
