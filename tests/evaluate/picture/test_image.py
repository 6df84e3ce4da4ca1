from dataclasses import replace
from datetime import UTC, datetime
from fractions import Fraction
from functools import partial
from io import BytesIO
from math import sqrt
from pathlib import Path

import cv2
import numpy as np
import openpyxl
import pytest

from labcdp.core.luminance import CommonError
from labcdp.core.result import Finding, info, warning
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.converter import make_converter
from labcdp.evaluate.picture.figures import histogram_edges, pair_distribution
from labcdp.evaluate.picture.image import MeasuredPicture, measure_picture
from labcdp.evaluate.picture.neighbours import evaluate_neighbours
from labcdp.evaluate.picture.page import picture_page
from labcdp.evaluate.picture.result import evaluate_picture, image_result
from labcdp.evaluate.picture.settings import ImageSettings
from labcdp.evaluate.picture.summary import overview_page
from labcdp.files import PictureOptions, read_picture
from labcdp.files.picture import Picture
from labcdp.files.statements import FileStatements
from labcdp.metrics import cdp, cdp_neighbours
from labcdp.metrics.pair import evaluate_pair
from labcdp.metrics.region import rounding_uncertainty
from labcdp.regions import RectangleShape, save_regions
from labcdp.report.files import envelope_json
from labcdp.report.layout import ReportFigure
from labcdp.report.sheets import result_workbook

from ...conftest import valid
from ...metrics.conftest import map_of, neighbours_of

SHAPE = (60, 90)
BRIGHT, DARK = Roi.rectangle("bright", 50, 10, 30, 40), Roi.rectangle("dark", 5, 5, 30, 40)
CORNER = Roi.rectangle("corner", 0, 50, 9, 9)
SCENE = np.random.default_rng(0).normal(100.0, 5.0, SHAPE) + 100 * (np.arange(90) >= 45)


_map = partial(map_of, random_rel=0.0)


def _evaluate(request, luminance=SCENE):
    light = luminance.astype(np.float32)
    picture = Picture(Path("night.exr"), "ab" * 32, FileStatements(), None, light, True)
    return measure_picture(_map(luminance), make_converter().source(picture), request)


def _near(values, contrast):
    return cdp_neighbours(values, contrast)


def test_all_pairs_or_the_chosen_ones_each_once_with_their_numbers():
    found = _evaluate(ImageSettings((1.0, 2.0), 0.5, (BRIGHT, DARK, CORNER)))
    assert [pair.name for pair in found.pairs] == ["bright / dark", "bright / corner", "dark / corner"]
    a, b = BRIGHT.select(SCENE), DARK.select(SCENE)
    assert found.pairs[0].cdp[1].cdp == cdp(a, b, 2.0).cdp
    assert found.findings == (info("region-correlation-unknown", "corner", pixels=81, recommended=200),)
    distribution, contrasts = pair_distribution(found.pairs[0], _map(SCENE)), (a[:, None] / b - 1).ravel()
    middle = len(distribution.edges) // 2
    assert distribution.cumulative[middle] == np.mean(contrasts <= distribution.edges[middle])
    chosen = _evaluate(ImageSettings((1.0,), 0.5, (BRIGHT, DARK, CORNER), (("dark", "bright"), ("bright", "dark"))))
    assert [pair.name for pair in chosen.pairs] == ["bright / dark"]
    assert chosen.findings[0] == Finding("pair-swapped", values={"bright": "bright", "dark": "dark"})
    # A region of no pair has its luminance and SNR all the same.
    assert [region.roi for region in chosen.regions] == [BRIGHT, DARK, CORNER]


def test_without_contrasts_the_measured_one_of_each_pair_is_used():
    found = _evaluate(ImageSettings(None, 0.5, (BRIGHT, DARK, CORNER), neighbours=True))
    for pair in found.pairs[:2]:
        (one,) = pair.cdp
        assert one.contrast == pair.contrast.value
        assert one.cdp == cdp(BRIGHT.select(SCENE), pair.b.roi.select(SCENE), one.contrast).cdp
    assert found.pairs[0].cdp[0].cdp > 0.9
    small, large = np.sum(neighbours_of(SCENE), axis=0)
    measured = large / small - 1
    assert found.neighbours.contrast.value == pytest.approx(measured)
    assert repr(found.neighbours.cdp[0]) == repr(_near(SCENE, found.neighbours.contrast.value))
    for corners in ((3, 4, 40, 30), (40, 30, 3, 4), (3, 30, 40, 4)):
        inside = evaluate_neighbours(_map(SCENE), (0.05,), 0.5, corners)
        assert repr(inside.cdp[0]) == repr(_near(SCENE[4:31, 3:41], 0.05))
        assert inside.rectangle == (3, 4, 40, 30)
    assert {"contrast-is-measured", "neighbour-contrast-is-measured"} < {one.code for one in found.findings}


def test_a_measured_contrast_that_is_not_defined_has_no_cdp():
    half = (np.arange(90) >= 45) * np.ones((60, 1))
    uniform = _evaluate(ImageSettings(None, 0.5, neighbours=True, rectangle=(0, 0, 20, 20)), half + 1)
    assert len(uniform.neighbours.cdp) == 0
    dark = _evaluate(ImageSettings(None, 0.5, (BRIGHT, DARK)), half)
    assert len(dark.pairs[0].cdp) == 0
    assert dark.findings[0] == Finding("contrast-undefined", subject="bright / dark")


def test_a_shared_factor_cancels_between_neighbours_and_an_offset_does_not():
    luminance = SCENE - 80
    scale = evaluate_neighbours(_map(luminance, (CommonError("scale", 0.2),), slow_rel=0.1), (0.2,)).cdp[0]
    assert scale.u_calibration == 0
    assert scale.u == scale.u_pixels
    offset = _map(luminance, (CommonError("offset", 0.7 / luminance),))
    found = evaluate_neighbours(offset, (0.2,)).cdp[0]
    changes = [_near(luminance + s * 0.7, 0.2).cdp - found.cdp for s in (1, -1)]
    assert found.u_calibration == pytest.approx(sqrt(np.mean(np.square(changes))))
    assert found.interval.high > _near(luminance, 0.2).interval.high
    slow = evaluate_neighbours(_map(luminance, slow_cd_m2=0.7), (0.2,)).cdp[0]
    assert slow.u_calibration == pytest.approx(found.u_calibration)


def test_the_contrasts_of_all_neighbours_are_counted():
    luminance = np.rint(SCENE[:, :45] - 90)
    found = pair_distribution(evaluate_neighbours(_map(luminance), (0.5,)), _map(luminance))
    pairs = neighbours_of(luminance)
    undefined = sum(large <= 0 for _, large in pairs)
    unbounded = sum(small <= 0 < large for small, large in pairs)
    contrasts = np.array([large / small - 1 for small, large in pairs if small > 0], np.float32)
    assert (found.undefined, found.unbounded) == (undefined / len(pairs), unbounded / len(pairs))
    assert unbounded > 0
    for k in np.linspace(0, found.edges.size - 1, 4).astype(int):
        expected = (undefined + (contrasts <= np.float32(found.edges[k])).sum()) / len(pairs)
        assert found.cumulative[k] == pytest.approx(expected, abs=1e-12)


# Pages, JSON and sheets hold the numbers of their evaluation, also as command image writes them


HOSTILE = "</script><b>=1+1 $x_{$ [a]:*?/\\{{ 7 }}"
OF_LIGHT, OF_NIGHT = Roi.rectangle("bright", 100, 20, 60, 80), Roi.rectangle(HOSTILE, 10, 10, 60, 80)
SETTINGS = ImageSettings(
    (0.5, 1.0, 2.0, 3.0), 0.5, (OF_LIGHT, OF_NIGHT), neighbours=True, rectangle=(5, 5, 60, 50),
    converter=make_converter(encoding="linear"),
)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two pictures as they are evaluated, the second with its pages; and one that failed."""
    folder, found = tmp_path_factory.mktemp("pictures"), []
    for seed in (1, 2):
        dn = np.random.default_rng(seed).normal(100.0, 10.0, (120, 180)) + 110 * (np.arange(180) > 90)
        cv2.imwrite(str(folder / f"{seed}.png"), np.clip(dn, 0, 255).astype(np.uint8))
        picture, _, files = evaluate_picture(SETTINGS, folder / f"{seed}.png", pages=seed == 2, surface=seed == 2)
        found.append(replace(picture, file=f"{seed}.png", number=seed, folder=f"picture-{seed}"))
    return [*found, MeasuredPicture("bad.png", None, number=3, folder="picture-3", failure="bad.png is empty")], files


@pytest.mark.parametrize(("values", "width"), [(np.uint8([[3, 5], [200, 5]]), 1), (np.uint16([[0, 4095]]), 16)])
def test_bars_of_a_histogram_fit_the_values(values, width):
    edges = histogram_edges(values)
    assert np.diff(edges) == pytest.approx(width)
    assert np.histogram(values, edges)[0].sum() == values.size
    # No value on the border of two bars.
    assert not np.isin(values, edges).any()


def test_pages_escape_all_text_and_name_failures(made):
    pictures, files = made
    hostile = replace(pictures[1], file=HOSTILE, findings=(warning("camera-assumed", camera=HOSTILE),))
    result = image_result([hostile], SETTINGS)
    figures = [ReportFigure(f"{name}.png", b"", HOSTILE, HOSTILE) for name in ("picture", "values")]
    warned = picture_page(hostile, result, figures, 0.9, surface=True)
    overview = overview_page(image_result(pictures, SETTINGS), pictures, "by hand")
    for page in (files["report.html"].decode(), warned, overview):
        assert "<b>" not in page
        assert "<script" not in page
    assert "No result of bad.png: bad.png is empty" in overview


def test_json_and_sheets_hold_the_numbers_of_the_evaluation(made):
    pictures, _ = made
    result = image_result(pictures, SETTINGS)
    values = valid(envelope_json(result))
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    first, found = tables["cdp"][1], pictures[0].pairs[0]
    one = found.cdp[1]
    assert (first["picture"], first["dark"], first["contrast"]) == ("1.png", HOSTILE, 1.0)
    assert (first["cdp"], first["cdp_low"], first["cdp_high"]) == (one.cdp, *one.interval)
    assert (first["measured_contrast"], first["u_csnr"]) == (found.contrast.value, found.csnr.u)
    assert first["expanded_measured_contrast"] == pytest.approx(1.96 * first["u_measured_contrast"], rel=1e-4)
    assert [row["failure"] for row in tables["pictures"]] == [None, None, "bad.png is empty"]
    # As in the program of the 2018 thesis: a column a picture.
    book = openpyxl.load_workbook(BytesIO(result_workbook(result, datetime(2026, 1, 2, tzinfo=UTC))))
    second = pictures[1]
    for number, results in ((4, second.pairs[0].cdp), (5, second.neighbours.cdp)):
        _, *lines = ([cell.value for cell in line] for line in book.worksheets[number].iter_rows())
        expected = [(100 * one.contrast, pytest.approx(one.cdp, rel=1e-14), None) for one in results]
        assert [(line[0], *line[2:]) for line in lines] == expected


_LEFT, _RIGHT = (slice(20, 60), slice(10, 50)), (slice(20, 60), slice(70, 110))


def _pixels(seed, shape=(80, 120)):
    pixels = np.random.default_rng(seed).normal(20.0, 2.0, shape)
    pixels[:, shape[1] // 2 :] += 180
    return np.rint(np.clip(pixels, 0, 255)).astype(np.uint8)


def test_the_rest_of_a_batch_on_all_cores_continues_and_failures_are_reported_at_the_end(labcdp, tmp_path):
    (tmp_path / "small").mkdir()
    for seed, (name, shape) in enumerate([("one.png", (80, 120)), ("two.png", (80, 120)), ("small/one.png", (30, 40))]):
        cv2.imwrite(str(tmp_path / name), _pixels(seed, shape))
    (tmp_path / "broken.png").write_bytes((tmp_path / "one.png").read_bytes()[:2000])
    bright, dark = RectangleShape("bright", 70, 20, 40, 40), RectangleShape("dark, left", 10, 20, 40, 40)
    save_regions(tmp_path / "rois.json", (bright, dark))
    (tmp_path / "link.png").symlink_to(tmp_path / "one.png")
    paths = ("one.png", "broken.png", "small/one.png", "two.png", "link.png", "missing.png")
    asked = ("--roi", "rois.json", "--encoding", "linear", "--contrast", "800%:1000%:3", "--output", "out")
    done = labcdp("image", *paths, *asked)
    assert done.returncode == 1
    told = done.stderr.splitlines()
    assert "Note: link.png is the same file as one.png and is evaluated once" in told
    *_, count, broken, small, missing = told
    assert count == "labcdp: 3 of 5 pictures failed:"
    for line, words in ((broken, "broken.png"), (small, "small/one.png: rois"), (missing, "missing.png cannot be re")):
        assert words in line
    book = openpyxl.load_workbook(tmp_path / "out/results.xlsx")
    head, *_, row = ([cell.value for cell in row] for row in book["cdp bright dark, left"].iter_rows())
    assert head[1:] == ["1 one.png", "2 broken.png", "3 small/one.png", "4 two.png", "5 missing.png"]
    one, two = (cdp(_pixels(seed)[_RIGHT], _pixels(seed)[_LEFT], 10.0).cdp for seed in (0, 1))
    assert row[1:] == [pytest.approx(one), None, None, pytest.approx(two), None]
    assert {path.name for path in (tmp_path / "out").iterdir() if path.is_dir()} == {"picture-1-one", "picture-4-two"}


# Rounding to DN: means between two of them, and contrasts that lie exactly on an end of the interval


#: Few enough values that many pairs of them have the contrasts 1/2, 1 or 3/2, the middle and ends of the intervals.
DN = (21, 28, 42, 49, 63, 70, 98, 105, 147, 245)


def share(pairs, contrast):
    """Share of pairs of integers whose Weber contrast is from half to one and a half times the one asked for."""
    contrasts = [Fraction(int(large), int(small)) - 1 for large, small in pairs]
    return float(Fraction(sum(contrast / 2 <= one <= contrast * Fraction(3, 2) for one in contrasts), len(contrasts)))


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("camera", ["none", "of 12 bits", "of the depth of the file, with a black level"])
def test_cdp_as_by_brute_force_on_the_integers(tmp_path, bits, camera):
    rng = np.random.default_rng(bits)
    dn = np.concatenate([rng.choice(DN[:7], (12, 10)), rng.choice(DN[3:], (12, 10))], axis=1)
    assert cv2.imwrite(str(tmp_path / "a.png"), dn.astype(np.uint8 if bits == 8 else np.uint16))
    black_dn = 7 if "black" in camera else 0
    (tmp_path / "camera.toml").write_text(
        f'name = "any"\nadc_bits = {bits if black_dn else 12}\nblack_dn = {black_dn}\npixel_pitch_m = 3.45e-6\n'
        "quantum_efficiency = 0.55\nk_dn_per_e = 0.23\nf_number = 2.8\nlens_transmittance = 0.9\nspectrum = 'D65'\n"
    )
    converter = make_converter(None, None if camera == "none" else tmp_path / "camera.toml", None)
    picture = read_picture(tmp_path / "a.png", PictureOptions(bit_depth=bits, exposure_s=0.0031))
    contrasts = (Fraction(1, 2), Fraction(1), Fraction(3))
    rois = Roi.rectangle("dark", 0, 0, 10, 12), Roi.rectangle("bright", 10, 0, 10, 12)
    request = ImageSettings(tuple(map(float, contrasts)), 0.5, rois, neighbours=True)
    found = measure_picture(converter.luminance(picture), converter.source(picture), request)
    dn = dn - black_dn
    near = [(large, small) for small, large in neighbours_of(dn)]
    far = [(bright, dark) for bright in dn[:, 10:].flat for dark in dn[:, :10].flat]
    assert found.neighbours.cdp.cdp.tolist() == [share(near, one) for one in contrasts]
    expected = [share(far, one) for one in contrasts]
    assert found.pairs[0].cdp.cdp.tolist() == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("noise_dn", [0.0, 0.1, 0.3, 0.5, 2.0])
def test_the_interval_of_a_mean_has_the_light_in_it(noise_dn):
    """With means anywhere between two DN; 3 sigma below 95 % of 500."""
    rng = np.random.default_rng(int(100 * noise_dn))
    means = rng.uniform(10, 11, 500)
    dn = np.rint(means[:, None] + noise_dn * rng.normal(size=(500, 1000)))
    uncertainty = [np.hypot(rounding_uncertainty(one.std(), 1.0), one.std() / sqrt(1000)) for one in dn]
    covered = np.mean(abs(dn.mean(axis=1) - means) <= 1.96 * np.array(uncertainty))
    assert covered >= 0.95 - 3 * sqrt(0.95 * 0.05 / 500)


def test_flat_regions_state_the_rounding_of_each(tmp_path):
    light = np.where(np.arange(60) < 30, 5.6, 4.4) * np.ones((40, 1))
    assert cv2.imwrite(str(tmp_path / "a.png"), np.rint(light).astype(np.uint8))
    converter = make_converter().given(no_vignetting=True)
    seen = converter.luminance(read_picture(tmp_path / "a.png", PictureOptions()))
    left, right = Roi.rectangle("left", 0, 0, 30, 40), Roi.rectangle("right", 30, 0, 30, 40)
    found = evaluate_pair(seen, left, right, (0.5, 1.0))
    assert found.a.u == pytest.approx(1 / 256 / sqrt(12), rel=1e-6)
    assert found.contrast.value == 0.5
    assert found.contrast.u == pytest.approx(1.5 / sqrt(12) * np.hypot(1 / 6, 1 / 4), rel=1e-6)
    assert abs(5.6 / 4.4 - 1 - found.contrast.value) < 1.96 * found.contrast.u
    # Of a contrast of 100 % the lower end, 50 %, is just met.
    assert found.cdp[1].cdp == 1
    assert found.cdp[1].u_calibration > 0.5
