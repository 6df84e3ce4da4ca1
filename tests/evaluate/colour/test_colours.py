"""Colours of regions in pictures that plain NumPy makes: command, Python, and what each file format keeps."""

import json

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

import labcdp as package
from labcdp.evaluate.colour.figures import ELLIPSE_95, ellipse
from labcdp.regions import RectangleShape, save_regions

#: Electrons of red, green and blue at the sign and at its surroundings, which have nearly the same luminance.
SIGN, WALL = np.array((900.0, 500.0, 300.0)), np.array((500.0, 560.0, 520.0))
SIZE, K_DN_PER_E, BLACK_DN = (160, 240), 0.5, 64


def electrons(rng):
    """Electrons of all three colours at each pixel: a sign on the left, a wall on the right."""
    image = np.empty((*SIZE, 3))
    image[:, : SIZE[1] // 2], image[:, SIZE[1] // 2 :] = SIGN, WALL
    return rng.poisson(image) + rng.normal(0, 5, image.shape)


def truth(cells):
    """Distance of sign and wall whose planes are means of `cells` pixels; photons, read noise and rounding."""
    variance = (SIGN + WALL) / 2 + 25 + 1 / 12 / K_DN_PER_E**2
    return np.sqrt(np.sum((SIGN - WALL) ** 2 * cells / variance))


def mosaic(image, pattern):
    raw = np.empty(SIZE)
    for at, colour in enumerate(pattern):
        row, column = divmod(at, 2)
        raw[row::2, column::2] = image[row::2, column::2, "RGB".index(colour)]
    return raw


@pytest.fixture
def pictures(tmp_path):
    rng = np.random.default_rng(21)
    regions = [RectangleShape("sign", 10, 20, 80, 100), RectangleShape("wall", 140, 20, 80, 100)]
    save_regions(tmp_path / "regions.json", regions, SIZE[::-1])
    for name, pattern in (("rggb", "RGGB"), ("gbrg", "GBRG")):
        raw = np.rint(mosaic(electrons(rng), pattern) * K_DN_PER_E + BLACK_DN).astype(np.uint16)
        assert cv2.imwrite(str(tmp_path / f"{name}.tif"), raw)
    colours = np.rint(electrons(rng) * K_DN_PER_E).astype(np.uint16)
    assert cv2.imwrite(str(tmp_path / "colours.png"), colours[..., ::-1])
    full = np.minimum(colours, 430)
    assert cv2.imwrite(str(tmp_path / "full.png"), (full[..., ::-1] * (65535 / 430)).round().astype(np.uint16))
    assert cv2.imwrite(str(tmp_path / "grey.png"), colours[..., 1])
    return tmp_path


@pytest.mark.parametrize(
    ("name", "stated", "cells"),
    [
        ("rggb.tif", {"bayer": "RGGB", "bit_depth": 12, "black_level_dn": BLACK_DN}, (1, 2, 1)),
        ("gbrg.tif", {"bayer": "GBRG", "bit_depth": 12, "black_level_dn": BLACK_DN}, (1, 2, 1)),
        ("colours.png", {"encoding": "linear"}, (1, 1, 1)),
    ],
)
def test_distance_is_that_of_photons_and_read_noise(pictures, name, stated, cells):
    image = package.read_image(pictures / name, no_vignetting=True, **stated)
    pair = image.regions(pictures / "regions.json").colour_separation().isel(pair=0)
    assert pair["colour_distance_low"] < truth(np.array(cells)) < pair["colour_distance_high"]
    assert pair["u_colour_distance"] / pair["colour_distance"] < 0.03
    # Chromaticities of both regions are apart by 0.2, and scatter by 0.02 or less.
    assert pair["colours_detected"] > 0.99


def test_command_page_sheet_and_json(pictures, labcdp):
    stated = ("--bayer", "RGGB", "--bit-depth", "12", "--black-level", str(BLACK_DN), "--no-vignetting")
    regions = ("--roi", str(pictures / "regions.json"))
    done = labcdp(
        "image", str(pictures / "rggb.tif"), "--colours", *stated, *regions, "--output", str(pictures / "out")
    )
    assert done.returncode == 0, done.stderr
    result = json.loads((pictures / "out" / "results.json").read_text())
    (row,) = result["tables"]["colour_separation"]["rows"]
    image = package.read_image(
        pictures / "rggb.tif", bayer="RGGB", bit_depth=12, black_level_dn=BLACK_DN, no_vignetting=True
    )
    pair = image.regions(pictures / "regions.json").colour_separation().isel(pair=0)
    assert row["pair"] == "sign / wall"
    assert (row["distance"], row["csp"], row["detected"]) == (
        pair["colour_distance"], pair["csp"], pair["colours_detected"]
    )  # fmt: skip
    assert (pictures / "out" / "figures" / "colours.png").is_file()
    assert "Colour separation" in (pictures / "out" / "report.html").read_text()


def test_saturated_plane_and_grey_picture(pictures, labcdp):
    image = package.read_image(pictures / "full.png", encoding="linear", no_vignetting=True)
    measured = image.regions(pictures / "regions.json").colour_separation()
    assert np.isnan(measured["colour_distance"].item())
    assert "are saturated in a plane" in str(measured.attrs)
    done = labcdp("image", str(pictures / "grey.png"), "--colours", "--roi", str(pictures / "regions.json"))
    assert done.returncode == 1
    assert "grey.png is grey: the colours of regions need" in done.stderr


def test_what_cannot_be_compared_costs_nothing_else(tmp_path):
    """Flat colours without noise, and a region of four pixels: their contrasts stay."""
    flat = np.full((40, 60, 3), (30, 90, 60), np.uint8)
    flat[:, 30:] = 200, 40, 40
    assert cv2.imwrite(str(tmp_path / "flat.png"), flat)
    regions = package.read_image(tmp_path / "flat.png", encoding="linear", no_vignetting=True).regions(
        {"left": (2, 2, 20, 20), "right": (35, 2, 20, 20), "small": (35, 30, 2, 2)}
    )
    colours = regions.colour_separation()
    assert np.isnan(colours["colour_distance"]).all()
    assert "no noise of their own" in str(colours.attrs)
    assert "region 'small' has 4 pixels of 3 planes" in str(colours.attrs)
    assert np.isfinite(regions.cdp(0.5)["cdp"]).all()


def test_ellipse_holds_95_percent_of_a_million_draws():
    mean, covariance = np.array((0.4, 0.3)), np.array([[4e-4, 1.5e-4], [1.5e-4, 1e-4]])
    assert pytest.approx(chi2.ppf(0.95, 2), rel=1e-12) == ELLIPSE_95**2
    draws = np.random.default_rng(4).multivariate_normal(mean, covariance, 1_000_000)
    outline = ellipse(mean, covariance).astype(np.float32)[:, None]
    # The outline is a polygon of 180 sides: its area is 0.02 % smaller.
    inside = np.mean([cv2.pointPolygonTest(outline, (float(x), float(y)), False) >= 0 for x, y in draws[:100_000]])
    assert inside == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 100_000))
    level = draws - mean
    within = np.einsum("ni,ij,nj->n", level, np.linalg.inv(covariance), level) <= ELLIPSE_95**2
    assert within.mean() == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 1e6))
