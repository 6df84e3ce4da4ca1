"""Emissions as tables and files, in Python and chain files, and spectra of pictures as scenes."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import labcdp
from labcdp.chain import ImageScene, RegionSpectrum
from labcdp.core.errors import InputError
from labcdp.core.photometry import electron_radiance_per_cd_m2, spectral_weights
from labcdp.evaluate.sweep.plan import Axis, Sweep

from .test_colour import PLANES, coloured

#: A narrow band around 630 nm, and one of two bands; relative power.
BAND = ((610, 0.0), (630, 1.0), (650, 0.0))
TWO = ((440, 0.0), (460, 3.0), (480, 0.0), (560, 0.0), (600, 1.0), (640, 0.0))


def electrons_by_hand(table, efficiency):
    """Electrons for 1 cd/m2 by integrals in steps of 0.01 nm."""
    h, c, nm = 6.62607015e-34, 299792458.0, np.arange(380, 780, 0.01)
    power = np.interp(nm, *np.transpose(table), left=0, right=0)
    known_nm, _, visibility = spectral_weights("E")
    luminance = 683.0 * float(power @ np.interp(nm, known_nm, visibility))
    seen = np.interp(nm, *np.transpose(efficiency), left=0, right=0)
    return float(power * nm * 1e-9 / (h * c) @ seen) / luminance


@pytest.mark.parametrize("table", [BAND, TWO])
def test_tables_are_integrated(table):
    for efficiency in PLANES.values():
        seen = electron_radiance_per_cd_m2(RegionSpectrum("a", emission=table).light, efficiency)
        # Steps of 1 nm: corners of the tables lie on them, V is curved between.
        assert seen == pytest.approx(electrons_by_hand(table, efficiency), rel=1e-3, abs=1e10)
    # A shipped illuminant as a table of its own.
    wavelength_nm, power, _ = spectral_weights("LED-B3")
    lamp = RegionSpectrum("a", emission=np.column_stack([wavelength_nm, power]))
    for plane in "RGB":
        expected = electron_radiance_per_cd_m2("LED-B3", PLANES[plane])
        assert electron_radiance_per_cd_m2(lamp.light, PLANES[plane]) == pytest.approx(expected, rel=1e-12)


def test_a_band_is_seen_as_its_middle():
    line, band = (
        coloured("RGGB", "R", [{"region": "bright", "emission": emission}])
        for emission in ("monochromatic 630 nm", [list(pair) for pair in BAND])
    )
    exact = [
        chain.sweep(exact=True, scene__luminance_cd_m2=[0.2, 1.0])["mean_contrast"].values for chain in (line, band)
    ]
    np.testing.assert_allclose(*exact, rtol=0.05)
    simulated = band.sweep(scene__luminance_cd_m2=[0.2, 1.0])
    z = (simulated["cdp"] - band.sweep(exact=True, scene__luminance_cd_m2=[0.2, 1.0])["cdp"]) / np.maximum(
        simulated["standard_error"], 1e-3
    )
    assert np.abs(z).max() < 3.5
    again = labcdp.Chain.from_toml(band.to_toml())
    np.testing.assert_array_equal(again.run(2)["sensor"].values, band.run(2)["sensor"].values)


def test_files_are_those_of_measured_spectra(tmp_path):
    rows = "\n".join(f"{nm};{value:g}".replace(".", ",") for nm, value in TWO)
    (tmp_path / "lamp.csv").write_text(f"Wavelength (nm);power\n{rows}\n")
    stated = coloured("RCCB", "B", [{"region": "bright", "emission": [list(pair) for pair in TWO]}])
    chain = coloured("RCCB", "B").with_(scene__spectra=[{"region": "bright", "emission_path": "lamp.csv"}])
    from_file = labcdp.Chain.from_document(chain.document, folder=tmp_path)
    np.testing.assert_array_equal(from_file.run(2)["sensor"].values, stated.run(2)["sensor"].values)
    from_file.save(tmp_path / "chain.toml")
    assert 'emission_path = "lamp.csv"' in (tmp_path / "chain.toml").read_text()
    loaded = labcdp.Chain.load(tmp_path / "chain.toml")
    np.testing.assert_array_equal(loaded.run(2)["sensor"].values, stated.run(2)["sensor"].values)
    # Also of a region that had no spectrum, and of captures by their names.
    changed = labcdp.Chain.from_document(coloured("RCCB", "B").document, folder=tmp_path).with_(
        scene__spectra__bright__emission_path="lamp.csv"
    )
    np.testing.assert_array_equal(changed.run(2)["sensor"].values, stated.run(2)["sensor"].values)
    again = changed.with_(**{"scene.spectra.bright.emission_path": None, "scene.spectra.bright.emission": BAND})
    assert again.scene.spectra[0].emission == BAND
    assert again.with_(sensor__planes__B__luminance_weight=0.5).sensors[0][1].planes[2].luminance_weight == 0.5
    with pytest.raises(InputError, match="there is no 'X' in planes, give one of R, C, B"):
        again.with_(sensor__planes__X__luminance_weight=0.5)


def test_results_state_the_file_and_sweeps_know_its_content(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write = (tmp_path / "lamp.csv").write_text
    write("wavelength_nm,power\n600,0\n625,1\n650,0\n")
    chain = coloured("RGGB", "R").with_(scene__spectra__bright__emission_path="lamp.csv")
    sweep = Sweep(chain, (Axis("scene.luminance_cd_m2", (1.0, 2.0)),), exact=True)
    first = sweep.identity()
    write("wavelength_nm,power\n500,0\n525,1\n550,0.0\n")
    assert sweep.identity() != first
    chain.with_(scene__width=32, scene__height=32).save("chain.toml")
    command = [str(Path(sys.executable).with_name("labcdp")), "simulate", "chain.toml"]
    subprocess.run(command, check=True, capture_output=True)
    inputs = json.loads((tmp_path / "chain-simulate" / "results.json").read_text())["inputs"]
    assert "lamp.csv" in [Path(item["path"]).name for item in inputs]


def test_a_picture_with_spectra(tmp_path):
    picture = np.full((64, 128), 8.0)
    picture[:, 64:] = 20.0
    np.save(tmp_path / "night.npy", np.kron(picture, np.ones((2, 2))))
    regions = {"left": [0, 0, 60, 64], "right": [68, 0, 60, 64]}
    scene = {"type": "image", "path": str(tmp_path / "night.npy"), "regions_xywh": regions, "oversampling": 2}
    spectra = [{"region": "image", "emission": "A"}, {"region": "right", "emission": [list(pair) for pair in BAND]}]
    chain = labcdp.Chain.from_document(coloured("RGGB", "R").document | {"scene": scene | {"spectra": spectra}})
    light = chain.run(1)["sensor"].luminance_cd_m2
    for name, level, emission in (("left", 8.0, "A"), ("right", 20.0, BAND)):
        seen = light[chain.scene.regions()[name]]
        per_white = electron_radiance_per_cd_m2("D65", PLANES["R"])
        expected = level * electron_radiance_per_cd_m2(emission, PLANES["R"]) / per_white
        assert seen.mean() == pytest.approx(expected, abs=4 * seen.std() / np.sqrt(seen.size) + 2e-3 * expected)
    assert labcdp.Chain.from_toml(chain.to_toml()).scene.spectra == chain.scene.spectra


@pytest.mark.parametrize(
    ("emission", "message"),
    [
        ("D66", "spectrum is 'D66', which is not known"),
        (5, "emission is 5: give the name of a spectrum in quotes, or pairs"),
        ([[400, 1.0], [500, True]], "emission is .*: give the name"),
        ([[400, 1.0, 2.0]], "emission is .*: give the name"),
        ([[500, 1.0], [400, 0.0]], "emission: wavelengths do not rise at 400 nm"),
        (
            [[0.6, 0.0], [0.63, 1.0], [0.65, 0.0]],
            "emission: nothing from 0.6 to 0.65 nm is seen: give wavelengths in nm",
        ),
        ([[400, 0.0], [500, -1.0], [600, 1.0], [700, 0.0]], "emission: a spectrum of light has -1"),
        ([[450, 1.0], [780, 1.0]], "emission: the spectrum begins at 450 nm with 100% of its maximum"),
    ],
)
def test_what_is_no_spectrum_of_light_is_refused(emission, message):
    with pytest.raises(InputError, match=message):
        RegionSpectrum("lamp", emission=emission)


def test_files_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(InputError, match="emission_path is given beside emission"):
        RegionSpectrum("lamp", emission="A", emission_path="lamp.csv")
    with pytest.raises(InputError, match="emission_path is 5: give the path of a table"):
        RegionSpectrum("lamp", emission_path=5)
    with pytest.raises(InputError, match=r"emission_path: .*lamp\.csv"):
        assert RegionSpectrum("lamp", emission_path=tmp_path / "lamp.csv").light
    with pytest.raises(InputError, match="spectra names the region 'lamp': give each once, of image, road"):
        ImageScene("night.npy", regions_xywh={"road": (0, 0, 4, 4)}, spectra=(RegionSpectrum("lamp"),))
