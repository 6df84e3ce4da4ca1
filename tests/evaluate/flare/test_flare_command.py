"""Flare of a simulated lens with a known spread function, by the command, from pictures at several exposures."""

import json

import numpy as np
import pytest
import tifffile
import xarray as xr
from scipy.signal import fftconvolve

from labcdp.core.luminance import CommonError, LuminanceMap
from labcdp.evaluate.flare.light import scene_light, scene_paths
from labcdp.evaluate.picture.converter import make_converter
from labcdp.files.luminance_file import save_luminance

SHAPE, MIDDLE, SOURCE, BLACK_DN, K_DN_PER_E, READ_E = (192, 256), (112.0, 96.0), 80_000.0, 64, 0.3, 3.0
OPTIONS = ("--bit-depth", "12", "--black-level", str(BLACK_DN), "--encoding", "linear", "--no-vignetting")
#: Electrons per unit of light and second, exposures, and side of the blocks.
E_PER_S, EXPOSURES_S, BLOCK_PX = 100.0, (1e-3, 1e-2, 1e-1), 16


def distance():
    y, x = (np.arange(size) + 0.5 for size in SHAPE)
    return np.hypot(x - MIDDLE[0], y[:, None] - MIDDLE[1])


def seen_light():
    """A disc, less the 5 % that the lens spreads as (1 + (r / 12)²)^-1.5, with the light that it spreads."""
    scene = SOURCE * np.clip(8.5 - distance(), 0, 1)
    v, u = np.mgrid[-SHAPE[0] + 1 : SHAPE[0], -SHAPE[1] + 1 : SHAPE[1]]
    kernel = 0.05 / (2 * np.pi * 12**2) * (1 + (u**2 + v**2) / 12**2) ** -1.5
    return 0.95 * scene, fftconvolve(scene, kernel, mode="same")


SCENE, STRAY = seen_light()


def write_picture(path, light, exposure_s, seed):
    random = np.random.default_rng(seed)
    electrons = random.poisson(light * E_PER_S * exposure_s) + random.normal(0, READ_E, SHAPE)
    dn = np.clip(np.round(electrons * K_DN_PER_E + BLACK_DN), 0, 4095).astype(np.uint16)
    # Exposure time in seconds as a fraction.
    tifffile.imwrite(path, dn, extratags=[(33434, 5, 1, (round(1e6 * exposure_s), 10**6), True)])
    return dn


@pytest.fixture
def lamp(tmp_path):
    for number, exposure_s in enumerate(EXPOSURES_S):
        for frame in range(4):
            write_picture(tmp_path / f"lamp-{number}-{frame}.tif", SCENE + STRAY, exposure_s, 10 * number + frame)
    # Through a filter of optical density 2.
    for frame in range(2):
        write_picture(tmp_path / f"direct-{frame}.tif", (SCENE + STRAY) / 100, 2e-2, 90 + frame)
    region = {"name": "lamp", "kind": "ellipse", "x": 92, "y": 76, "width": 40, "height": 40}
    document = {"format": "labcdp regions", "version": 1, "regions": [region]}
    (tmp_path / "lamp.json").write_text(json.dumps(document))
    return tmp_path


def evaluate(run, folder, *arguments, options=OPTIONS):
    given = [*arguments, "--source", folder / "lamp.json", *options, "--output", folder / "out"]
    done = run(*map(str, ("flare", *given, "--block-size", BLOCK_PX)))
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "out" / "results.json").read_text())


def block_means(values, mask):
    """Mean of each block beside the source; nan where it is source for the most part."""
    rows, columns = (size // BLOCK_PX for size in SHAPE)
    weighted, n = (part.reshape(rows, BLOCK_PX, columns, BLOCK_PX).sum(axis=(1, 3)) for part in (values * mask, mask))
    return np.where(n >= BLOCK_PX**2 / 2, weighted / np.maximum(n, 1), np.nan)


def test_exposures_are_merged_and_flare_is_that_of_the_lens(labcdp, lamp):
    pictures = sorted(lamp.glob("lamp-*.tif"))
    direct = [word for path in sorted(lamp.glob("direct-*.tif")) for word in ("--direct", path)]
    result = evaluate(labcdp, lamp, *pictures, *direct, "--filter-density", 2, "--filter-uncertainty", 0.01)
    source = np.median((SCENE + STRAY)[SCENE > 0.5 * SOURCE])
    expected = block_means(STRAY, distance() > 20) / source
    dataset = xr.load_dataset(lamp / "out" / "results.nc")
    found, u = dataset["normalised"].values, dataset["u_normalised"].values
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
    bright = np.isfinite(expected) & (expected > 2e-5)
    assert bright.sum() > 60
    assert np.abs(found[bright] / expected[bright] - 1).mean() < 0.01
    assert (np.abs(found - expected)[bright] < 4 * u[bright]).all()
    mean, worst = result["tables"]["flare"]["rows"]
    assert mean["normalised_ppm"] == pytest.approx(
        1e6 * (STRAY * (distance() > 20)).sum() / (distance() > 20).sum() / source, rel=0.01
    )
    assert worst["normalised_ppm"] == pytest.approx(1e6 * np.nanmax(expected), rel=0.01)
    # ln(10) of the density's U, and noise.
    assert worst["expanded_normalised_ppm"] / worst["normalised_ppm"] == pytest.approx(0.023, rel=0.3)
    assert worst["attenuation_db"] == pytest.approx(-10 * np.log10(worst["normalised_ppm"] / 1e6), abs=1e-3)
    assert "ghosts" not in result["tables"]
    assert [file["role"] for file in result["inputs"]] == 12 * ["picture"] + 2 * ["direct"] + ["source"]
    radius, profile = dataset["radius"].values, dataset["normalised_profile"].values
    assert (np.diff(profile[radius < 90]) < 0).all()
    # None of the pixels beside the lamp is saturated at the shortest exposure.
    assert "flare-saturated" not in {finding["code"] for finding in result["findings"]}


def test_what_saturates_beside_the_source_is_a_bound(labcdp, lamp):
    write_picture(lamp / "bright.tif", 30 * (SCENE + STRAY), EXPOSURES_S[2], 1)
    result = evaluate(labcdp, lamp, lamp / "bright.tif")
    found = {finding["code"]: finding["values"] for finding in result["findings"]}
    full_light = (4095 - BLACK_DN) / K_DN_PER_E / E_PER_S / EXPOSURES_S[2] / 30
    share = (full_light < STRAY)[distance() > 20].mean()
    assert found["flare-saturated"]["share"] == pytest.approx(share, rel=0.1)
    assert "flare-without-reference" in found


def test_ghosts_exceed_their_ring(labcdp, lamp):
    ghost = (
        0.02 * SOURCE * 0.05 * np.exp(-((np.hypot(*np.meshgrid(np.arange(256) - 200, np.arange(192) - 40)) / 6) ** 2))
    )
    for frame in range(4):
        write_picture(lamp / f"ghost-{frame}.tif", SCENE + STRAY + ghost, 1e-2, frame)
    result = evaluate(labcdp, lamp, *sorted(lamp.glob("ghost-*.tif")))
    place = result["tables"]["ghosts"]["rows"][0]
    assert (place["x_px"], place["y_px"]) == (200, 40)
    assert place["over_ring"] > 3


def test_background_is_subtracted(labcdp, lamp):
    for frame in range(2):
        write_picture(lamp / f"room-{frame}.tif", SCENE + STRAY + 100.0, 1e-3, frame)
        write_picture(lamp / f"dark-{frame}.tif", np.full(SHAPE, 100.0), 1e-2, 50 + frame)
    dark = [word for path in sorted(lamp.glob("dark-*.tif")) for word in ("--background", path)]
    mean, _ = evaluate(labcdp, lamp, *sorted(lamp.glob("room-*.tif")), *dark)["tables"]["flare"]["rows"]
    # Relative light is a share of the saturation, of pictures that are compared for each second.
    expected = STRAY[distance() > 20].mean() * E_PER_S * K_DN_PER_E / (4095 - BLACK_DN)
    assert abs(mean["stray_light"] - expected) < 2 * mean["expanded_stray_light"]
    assert mean["expanded_stray_light"] < 0.05 * expected


def test_intensity_of_calibrated_light_has_the_uncertainty_of_both(labcdp, lamp):
    light = (SCENE + STRAY) / 100
    invalid = np.zeros(SHAPE, np.uint8)
    calibrated = LuminanceMap(light, np.full(SHAPE, 1e-3), (CommonError("meter scale", 0.01),), invalid)
    save_luminance(calibrated, lamp / "lamp.npz", {})
    reference = ("--illuminance", "1.2klx", "--illuminance-uncertainty", "3%")
    result = evaluate(labcdp, lamp, lamp / "lamp.npz", *reference, options=())
    mean, worst = result["tables"]["flare"]["rows"]
    expected = np.nanmax(block_means(STRAY / 100, distance() > 20))
    assert worst["stray_light"] == pytest.approx(expected, rel=1e-3)
    assert worst["intensity_ppm"] == pytest.approx(1e6 * np.pi * expected / 1200, rel=1e-3)
    assert mean["u_stray_light"] / mean["stray_light"] == pytest.approx(0.01, rel=0.05)
    assert mean["u_intensity_ppm"] / mean["intensity_ppm"] == pytest.approx(np.hypot(0.01, 0.03 / 1.96), rel=0.05)
    units = {column["name"]: column["unit"] for column in result["tables"]["flare"]["columns"]}
    assert (units["stray_light"], units["intensity_ppm"]) == ("cd/m²", "ppm")
    page = (lamp / "out" / "report.html").read_text()
    assert "Worst place, over illuminance" in page


def test_pictures_of_one_exposure_are_averaged(lamp):
    converter = make_converter(bit_depth=12, black_level_dn=BLACK_DN, no_vignetting=True)
    paths = scene_paths(sorted(lamp.glob("lamp-1-*.tif")))
    light = scene_light(paths, converter)
    assert light.exposures_s == pytest.approx([EXPOSURES_S[1]])
    dn = np.mean([tifffile.imread(path) for path in paths], axis=0, dtype=float) - BLACK_DN
    unsaturated = (light.map.invalid == 0) & (dn > 20)
    ratio = np.asarray(light.map.luminance_cd_m2)[unsaturated] / dn[unsaturated]
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("lamp-0-0.tif",), "the source is not known: add --source"),
        (("lamp-0-0.tif", "--source", "lamp.json", "--filter-density", "2"), "--filter-density requires --direct"),
        (
            ("lamp-0-0.tif", "--source", "lamp.json", "--illuminance", "5"),
            "give a number above 0 with lx or klx",
        ),
        (("lamp-0-0.tif", "--source", "lamp.json", "--illuminance", "5lx"), "the light has no scale"),
        (
            ("lamp-0-0.tif", "--source", "lamp.json", "--direct", "lamp-2-0.tif"),
            "the direct picture of the source",
        ),
    ],
)
def test_refusals(labcdp, lamp, arguments, message):
    done = labcdp("flare", *(str(lamp / word) if "." in word else word for word in arguments), *OPTIONS,
                  "--output", str(lamp / "out"))  # fmt: skip
    assert done.returncode == 1
    assert message in done.stderr
    assert not (lamp / "out").exists()


def test_one_exposure_for_several_pictures_is_warned_of(labcdp, lamp):
    done = labcdp(
        "flare", "lamp-0-0.tif", "lamp-2-0.tif", "--source", "lamp.json", "--exposure", "5ms", "--bit-depth", "12",
        "--black-level", str(BLACK_DN), "--no-vignetting", "--output", "one",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "all 2 pictures count as taken at 5 ms, as given" in done.stderr
