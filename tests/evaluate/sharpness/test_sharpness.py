"""Sharpness of pictures by command and in Python, and measured cameras that are simulated as sharp as they are."""

import json
from dataclasses import replace

import cv2
import numpy as np
import openpyxl
import pytest
import xarray as xr

import labcdp as package
from labcdp.chain import Chain
from labcdp.evaluate.sharpness.measure import measure_sharpness
from labcdp.evaluate.sharpness.result import chain_with_mtf

from ...metrics.slanted_edges import edge_image, frequency_at

#: Regions by name: x, y, sigma of the blur in pixels, and whether the edge is along the columns.
PLACES = {"centre": (160, 110, 0.6, True), "corner": (10, 10, 0.9, True), "side": (250, 15, 0.8, False)}
DARK_DN, BRIGHT_DN, NOISE_DN = 20.0, 150.0, 1.2
OPTIONS = ("--encoding", "linear", "--no-vignetting", "--black-level", "0")


def make_picture(path, curve=lambda dn: dn, noise_dn=NOISE_DN):
    image = np.full((300, 400), DARK_DN)
    for x, y, sigma, upright in PLACES.values():
        edge = edge_image(90, 60, 6, sigma, DARK_DN, BRIGHT_DN)
        edge = edge if upright else edge.T
        image[y : y + edge.shape[0], x : x + edge.shape[1]] = edge
    image += np.random.default_rng(1).normal(0, noise_dn, image.shape)
    cv2.imwrite(str(path), curve(image.clip(0, 255)).round().astype(np.uint8))
    boxes = {name: (x, y, *((60, 90) if upright else (90, 60))) for name, (x, y, _, upright) in PLACES.items()}
    regions = [
        {"name": name, "kind": "rectangle", "x": x, "y": y, "width": width, "height": height}
        for name, (x, y, width, height) in boxes.items()
    ]
    document = {"format": "labcdp regions", "version": 1, "regions": regions}
    path.with_name("edges.json").write_text(json.dumps(document))
    return boxes


@pytest.fixture
def chart(tmp_path):
    make_picture(tmp_path / "chart.png")
    return tmp_path / "chart.png"


def evaluate(run, picture, *options, code=0):
    out = picture.with_name("out")
    done = run(
        *map(str, ("sfr", picture, "--roi", picture.with_name("edges.json"), *OPTIONS, "--output", out, *options))
    )
    assert done.returncode == code, done.stderr
    return json.loads((out / "results.json").read_text())


def test_command_gives_each_edge_its_place_and_response(labcdp, chart):
    result = evaluate(labcdp, chart, "--pixel-pitch", "3um")
    rows = {row["edge"]: row for row in result["tables"]["edges"]["rows"]}
    for name, (x, y, sigma, upright) in PLACES.items():
        row, truth = rows[name], frequency_at(0.5, 6, sigma)
        assert abs(row["mtf50"] - truth) < 1.5 * row["expanded_mtf50"]
        assert 0 < row["expanded_mtf50"] < 0.1 * truth
        assert row["mtf50_lp_mm"] == pytest.approx(row["mtf50"] / 3e-3)
        assert row["direction"] == ("horizontal" if upright else "vertical")
        middle = (x + 30, y + 45) if upright else (x + 45, y + 30)
        assert (row["x_px"], row["y_px"]) == pytest.approx(middle, abs=0.6)
        assert row["field"] == pytest.approx(np.hypot(middle[0] - 200, middle[1] - 150) / 250, abs=0.01)
    all_edges, along_rows, along_columns = result["tables"]["sharpness"]["rows"]
    assert (all_edges["n_edges"], along_rows["n_edges"], along_columns["n_edges"]) == (3, 2, 1)
    assert all_edges["mtf50"] == pytest.approx(np.mean([row["mtf50"] for row in rows.values()]))
    assert along_columns["expanded_mtf50"] == rows["side"]["expanded_mtf50"]
    assert result["kind"] == "sfr"
    assert [finding["code"] for finding in result["findings"]] == ["relative-luminance-as-given"]


def test_all_files_have_the_numbers(labcdp, chart):
    result, out = evaluate(labcdp, chart, "--pixel-pitch", "3um"), chart.with_name("out")
    dataset = xr.load_dataset(out / "results.nc")
    row = result["tables"]["edges"]["rows"][1]
    assert float(dataset["mtf50"].sel(edge="corner")) == row["mtf50"]
    assert dataset["response"].dims == ("edge", "frequency")
    assert dataset["mtf50"].attrs["units"] == "cycles/pixel"
    sheets = openpyxl.load_workbook(out / "results.xlsx").sheetnames
    assert {"sharpness", "edges", "response", "mtf"} <= set(sheets)
    assert "mtf = [[0, 1]" in (out / "report.html").read_text()
    assert sorted(path.name for path in (out / "figures").iterdir()) == [
        "field.png", "picture.png", "profile.png", "response.png",
    ]  # fmt: skip


def test_gamma_is_undone(labcdp, tmp_path):
    """A picture in sRGB has the response of its light; taken as light, its edges would be others."""

    def srgb(dn):
        light = dn / 255
        return 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)

    boxes = make_picture(tmp_path / "chart.png", srgb, noise_dn=0.0)
    image = package.read_image(tmp_path / "chart.png", encoding="srgb", no_vignetting=True)
    assert image.sfr(boxes)["mtf50"].sel(edge="centre") == pytest.approx(frequency_at(0.5, 6, 0.6), rel=0.02)
    as_it_is = package.read_image(tmp_path / "chart.png", encoding="linear", black_level_dn=0, no_vignetting=True)
    assert abs(float(as_it_is.sfr(boxes)["mtf50"].sel(edge="centre")) / frequency_at(0.5, 6, 0.6) - 1) > 0.03


def test_green_pixels_of_a_mosaic_have_the_response_of_their_lens(labcdp, tmp_path):
    image = edge_image(200, 160, 6, 0.8, 400, 3000) + np.random.default_rng(2).normal(0, 4, (200, 160))
    cv2.imwrite(str(tmp_path / "chart.png"), image.round().astype(np.uint16))
    region = {"name": "middle", "kind": "rectangle", "x": 10, "y": 0, "width": 140, "height": 200}
    document = {"format": "labcdp regions", "version": 1, "regions": [region]}
    (tmp_path / "edges.json").write_text(json.dumps(document))
    options = ("--bayer", "RGGB", "--bit-depth", "12", "--pixel-pitch", "3um")
    result = evaluate(labcdp, tmp_path / "chart.png", *options)
    assert "sfr-of-cells" in {finding["code"] for finding in result["findings"]}
    assert result["tables"]["response"]["rows"][-1]["frequency"] == 0.5
    for row in result["tables"]["mtf"]["rows"]:
        expected = np.exp(-2 * (np.pi * 0.8 * 3e-3 * row["lp_per_mm"]) ** 2)
        assert row["modulation"] == pytest.approx(expected, abs=0.02)


def test_python_has_the_numbers_of_the_command(labcdp, chart):
    rows = evaluate(labcdp, chart)["tables"]["edges"]["rows"]
    image = package.read_image(chart, encoding="linear", black_level_dn=0, no_vignetting=True)
    assert image.sfr(chart.with_name("edges.json"))["mtf50"].values.tolist() == [row["mtf50"] for row in rows]


def test_an_edge_that_cannot_be_measured_costs_the_others_nothing(labcdp, chart):
    edges = json.loads(chart.with_name("edges.json").read_text())
    edges["regions"].append({"name": "plain", "kind": "rectangle", "x": 20, "y": 200, "width": 60, "height": 60})
    chart.with_name("edges.json").write_text(json.dumps(edges))
    result = evaluate(labcdp, chart, code=1)
    (failure,) = (finding for finding in result["findings"] if finding["severity"] == "error")
    assert failure["text"].startswith("no sharpness at region 'plain': ")
    assert len(result["tables"]["edges"]["rows"]) == 3
    edges["regions"] = edges["regions"][-1:]
    chart.with_name("edges.json").write_text(json.dumps(edges))
    done = labcdp("sfr", str(chart), "--roi", str(chart.with_name("edges.json")), "--output", str(chart) + "-out")
    assert done.returncode == 1
    assert "labcdp: no edge can be measured: region 'plain': " in done.stderr


def test_repeats_in_several_pictures_are_averaged_at_each_edge(labcdp, chart):
    again = chart.with_name("again.png")
    image = cv2.imread(str(chart), cv2.IMREAD_UNCHANGED).astype(float)
    noise = np.random.default_rng(4).normal(0, 1.5, image.shape)
    cv2.imwrite(str(again), np.clip(image + noise, 0, 255).round().astype(np.uint8))
    result = evaluate(labcdp, chart, again)
    rows = {(row["edge"], row["picture"]): row for row in result["tables"]["edges"]["rows"]}
    assert list(rows) == [(name, picture) for picture in ("chart.png", "again.png") for name in PLACES]
    means = [np.mean([rows[name, picture]["mtf50"] for picture in ("chart.png", "again.png")]) for name in PLACES]
    whole = result["tables"]["sharpness"]["rows"][0]
    assert (whole["n_edges"], whole["mtf50"]) == (3, pytest.approx(np.mean(means)))
    # Repeats are no other places in the field.
    assert whole["u_mtf50"] == pytest.approx(np.std(means, ddof=1) / np.sqrt(3))
    # One edge along the columns: two repeats that agree by chance do not know it exactly.
    (upright,) = (row for row in result["tables"]["sharpness"]["rows"] if row["edges"] == "vertical")
    by_rows = np.hypot(*(rows["side", picture]["u_mtf50"] for picture in ("chart.png", "again.png"))) / 2
    assert upright["u_mtf50"] == pytest.approx(max(by_rows, upright["u_mtf50"]))
    by_picture = {row["picture"]: row["mtf50"] for row in result["tables"]["pictures"]["rows"]}
    assert by_picture["again.png"] == pytest.approx(np.mean([rows[name, "again.png"]["mtf50"] for name in PLACES]))
    assert (chart.with_name("out") / "figures" / "picture-2.png").exists()
    dataset = xr.load_dataset(chart.with_name("out") / "results.nc")
    assert float(dataset["mtf50"].sel(edge="side, again.png")) == rows["side", "again.png"]["mtf50"]


def test_a_picture_without_edges_costs_the_others_nothing(labcdp, chart):
    plain = chart.with_name("plain.png")
    cv2.imwrite(str(plain), np.full((300, 400), 90, np.uint8))
    result = evaluate(labcdp, plain, chart, code=1)
    (failure,) = (finding for finding in result["findings"] if finding["severity"] == "error")
    assert failure["text"].startswith("no sharpness in plain.png: ")
    assert len(result["tables"]["edges"]["rows"]) == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "no regions: add --roi with a region about each edge"),
        (("--roi", "edges.json", "--chain", "no-such-chain"), "no-such-chain"),
    ],
)
def test_refusals(labcdp, chart, options, message):
    given = (str(chart.with_name(option)) if option.endswith(".json") else option for option in options)
    done = labcdp("sfr", str(chart), *given, "--output", str(chart.with_name("out")))
    assert done.returncode == 1
    assert message in done.stderr
    assert not chart.with_name("out").exists()


#: A chain with a slanted edge in front of it, drawn four times as fine as its pixels are.
OVERSAMPLING, SHAPE = 4, (120, 100)


@pytest.fixture
def camera(tmp_path):
    height, width = (OVERSAMPLING * size for size in SHAPE)
    edge = edge_image(height, width, 5, 0.0, 20.0, 100.0)
    np.save(tmp_path / "edge.npy", edge.astype(np.float32))
    chain = Chain.load("manta-g505")
    scene = f'[scene]\ntype = "image"\npath = "{tmp_path / "edge.npy"}"\noversampling = {OVERSAMPLING}\n'
    text = scene + chain.to_toml().partition("[optics]")[2].join(["[optics]", ""])
    return Chain.from_toml(text, "edge.toml").with_(optics__focal_length_m=None, exposure__exposure_s=0.004)


def measured_camera(chain, seed):
    signal = chain.run(seed).stages["sensor"]
    light = np.asarray(signal.values, dtype=float)
    luminance = package.LuminanceMap(light, np.zeros_like(light), 0.0, np.zeros(light.shape, np.uint8))
    return measure_sharpness(luminance, [package.Roi.rectangle("edge", 0, 0, *SHAPE[::-1])], 3.45e-6)


@pytest.mark.parametrize("lens", ["table", "blurred", "sharpened"])
def test_a_measured_camera_is_simulated_as_sharp_as_it_is(camera, lens):
    table = [[0.0, 1.0], [40.0, 0.83], [80.0, 0.5], [130.0, 0.22], [200.0, 0.06], [290.0, 0.0]]
    # A blur of 0.5 pixels, and 1.6 times the differences from neighbours.
    cycles = np.arange(0, 290, 10) * 3.45e-3
    modulations = (1.6 - 0.6 * np.cos(2 * np.pi * cycles)) * np.exp(-2 * (0.5 * np.pi * cycles) ** 2)
    sharpened = np.column_stack([cycles / 3.45e-3, modulations]).tolist()
    known = {
        "table": {"optics__mtf": table}, "sharpened": {"optics__mtf": sharpened},
        "blurred": {"optics__blur_sigma_m": 2e-6, "optics__diffraction_nm": 550},
    }  # fmt: skip
    original = measured_camera(camera.with_(**known[lens]), 1)
    again = measured_camera(chain_with_mtf(camera, original.mtf), 2)
    (first,), (second,) = ([edge.sfr for edge in measured.edges] for measured in (original, again))
    for name in ("mtf50", "mtf10"):
        a, b = getattr(first, name), getattr(second, name)
        assert abs(a.value - b.value) < 1.5 * np.hypot(a.U, b.U)
        assert 0.1 * a.value > a.U
    if lens != "blurred":
        lp_per_mm, modulation = np.transpose(table[:4] if lens == "table" else sharpened[:9])
        at, found = np.transpose(original.mtf)
        assert np.abs(np.interp(lp_per_mm, at, found) - modulation).max() < 0.03
    if lens == "sharpened":
        a, b = first.overshoot, second.overshoot
        assert min(a.value, b.value) > 0.05
        assert abs(a.value - b.value) < 3 * np.hypot(a.u, b.u)


def test_a_chain_gets_the_measured_lens(labcdp, chart):
    evaluate(labcdp, chart, "--chain", "manta-g505")
    chain = Chain.load(str(chart.with_name("out") / "chain.toml"))
    mtf = dict(chain.before)["optics"].mtf
    assert replace(dict(chain.before)["optics"], mtf=()) == dict(Chain.load("manta-g505").before)["optics"]
    lp_per_mm, modulation = np.transpose(mtf)
    cycles = 1e3 * lp_per_mm * 3.45e-6
    expected = np.mean([np.exp(-2 * (np.pi * sigma * cycles) ** 2) for *_, sigma, _ in PLACES.values()], axis=0)
    assert np.abs(modulation - expected).max() < 0.05


def test_sharpening_is_said(labcdp, tmp_path):
    make_picture(tmp_path / "chart.png", lambda dn: cv2.filter2D(dn, -1, np.array([[-0.5, 2.0, -0.5]])).clip(0, 255))
    result = evaluate(labcdp, tmp_path / "chart.png", "--pixel-pitch", "3um")
    (found,) = (finding for finding in result["findings"] if finding["code"] == "sfr-sharpened")
    assert "centre" in found["values"]["edges"]
    assert "side" not in found["values"]["edges"]
    # The mean of two edges that are sharpened and one that is not.
    assert max(row["modulation"] for row in result["tables"]["mtf"]["rows"]) > 1
