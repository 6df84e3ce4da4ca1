"""Colour filters and scenes of several spectra: by hand with single wavelengths, and prediction against simulation."""

import numpy as np
import pytest

from labcdp import Chain
from labcdp.chain import ColourPlane, RegionSpectrum, Sensor
from labcdp.core.errors import InputError

#: V of the CIE 1924 photopic observer at these wavelengths in nm.
V = {450: 0.038, 550: 0.995, 630: 0.265}
SENSOR = {"type": "emva1288", "pixel_pitch_m": 3e-6, "quantum_efficiency": 0.6, "full_well_e": 10000, "bits": 12}
SENSOR |= {"k_dn_per_e": 0.38, "read_noise_e": 2.0, "dark_current_e_s": 10.0, "black_level_dn": 64, "prnu_rel": 0.01}
PLANES = {
    "R": [[560, 0.0], [600, 0.5], [700, 0.4]],
    "G": [[480, 0.0], [530, 0.5], [600, 0.05], [700, 0.02]],
    "B": [[400, 0.3], [450, 0.45], [520, 0.02], [700, 0.01]],
    "C": [[400, 0.45], [500, 0.65], [600, 0.6], [700, 0.45]],
    "IR": [[690, 0.02], [720, 0.3], [780, 0.25]],
}
PATTERNS = {"RGGB": "RGB", "RCCB": "RCB", "RCCC": "RC"}


def coloured(pattern, plane="", spectra=(), **changes):
    """A board of 5 cd/m2 and 10 cd/m2 before a sensor with a colour filter."""
    names = ("R", "G", "B", "IR") if pattern == "RGB-IR" else PATTERNS.get(pattern, "")
    planes = [{"name": name, "quantum_efficiency": PLANES[name]} for name in names]
    scene = {"type": "checkerboard", "width": 256, "height": 256, "square_px": 16, "luminance_cd_m2": 5.0}
    document = {
        "spectrum": "D65",
        "scene": scene | {"contrast": 1.0, "spectra": list(spectra)},
        "windscreen": {"transmittance": 1.0},
        "optics": {"f_number": 2.0, "transmittance": 0.9},
        "exposure": {"exposure_s": 0.01},
        "sensor": SENSOR | {"colour_filter": pattern, "planes": planes, "plane": plane},
    }
    return Chain.from_document(document | changes)


@pytest.mark.parametrize("emission", [450, 630])
def test_luminance_of_another_wavelength_by_hand(emission):
    """Equal luminance is 1 / V times the power, and lambda / V times the photons."""
    lamp = RegionSpectrum("bright", emission=f"monochromatic {emission} nm")
    efficiency = [[440, 0.3], [460, 0.3], [545, 0.6], [555, 0.6], [620, 0.5], [640, 0.5]]
    chain = coloured("", spectra=[{"region": lamp.region, "emission": lamp.emission}]).with_(
        spectrum="monochromatic 550 nm", sensor__quantum_efficiency=efficiency
    )
    quiet = chain.with_(sensor__read_noise_e=0.0, sensor__prnu_rel=0.0, sensor__full_well_e=1e6, sensor__bits=16)
    run = quiet.run(seed=1)
    seen = run["sensor"].luminance_cd_m2[run.chain.scene.regions()["bright"]]
    at_lamp, at_white = {450: 0.3, 630: 0.5}[emission], 0.6
    by_hand = 10.0 * (emission * at_lamp / V[emission]) / (550 * at_white / V[550])
    # The tables round V in the third digit.
    assert seen.mean() == pytest.approx(by_hand, rel=2e-3)
    np.testing.assert_array_equal(np.unique(run["scene"].values), [5.0, 10.0])


@pytest.mark.parametrize(
    ("pattern", "plane"),
    [("RGGB", "luminance"), ("RCCB", "luminance"), ("RCCC", "luminance"), ("RGB-IR", "luminance"),
     ("RGGB", "R"), ("RGGB", ""), ("RCCB", "B"), ("RCCB", ""), ("RCCC", "C"), ("RCCC", ""), ("RGB-IR", ""), ("", "")],
)  # fmt: skip
def test_prediction_is_that_of_simulated_frames(pattern, plane):
    """A red lamp and a leaf: 10 luminances with 32,768 pixels each, within 3.5 standard errors."""
    leaf = [[400, 0.05], [520, 0.06], [550, 0.14], [600, 0.07], [680, 0.05], [720, 0.4], [780, 0.5]]
    spectra = [{"region": "bright", "emission": "monochromatic 625 nm"}, {"region": "dark", "reflectance": leaf}]
    chain = coloured(
        pattern, plane, spectra, windscreen={"transmittance": 0.9, "glare_cd_m2": 1.0, "glare_fraction": 0.1}
    )
    luminances = np.geomspace(0.05, 200, 10)
    exact, simulated = (chain.sweep(scene__luminance_cd_m2=luminances, **way) for way in ({"exact": True}, {"seed": 4}))
    error = np.maximum(simulated["standard_error"].values, 1e-3)
    assert np.abs((exact["cdp"].values - simulated["cdp"].values) / error).max() < 3.5
    for name in ("snr_dark", "snr_bright", "saturated_share"):
        both = [one[name].values[3:8] for one in (exact, simulated)]
        np.testing.assert_allclose(*both, rtol=0.03, atol=0.01)


def test_two_objects_of_one_luminance_differ_in_colour():
    """A red and a green patch of 20 cd/m2: no contrast for V, and one of each sign in the planes."""
    patches = [
        {"x": 0, "y": 0, "width": 60, "height": 60, "luminance_cd_m2": 20.0, "name": "red"},
        {"x": 64, "y": 0, "width": 60, "height": 60, "luminance_cd_m2": 20.0, "name": "green"},
    ]
    scene = {"type": "patches", "width": 128, "height": 64, "background_cd_m2": 1.0, "patches": patches}
    scene |= {"contrasts": [["green", "red"]], "spectra": [{"region": "red", "emission": "monochromatic 630 nm"}]}
    scene["spectra"].append({"region": "green", "emission": "monochromatic 530 nm"})
    base = coloured("RGGB").document | {"scene": scene}
    chain = Chain.from_document(base)
    for plane, brighter in (("R", "red"), ("G", "green")):
        seen = chain.with_(sensor__plane=plane)
        light, masks = seen.run(seed=1)["sensor"].luminance_cd_m2, seen.scene.regions()
        means = {name: float(light[masks[name]].mean()) for name in ("red", "green")}
        assert max(means, key=lambda name: means[name]) == brighter
        # Far beyond the other one: a contrast of 100 % or more is what remains.
        (exact,) = seen.sweep(exact=True, scene__background_cd_m2=[1.0], contrast=1.0)["above"].values
        assert exact > 0.9


def test_planes_and_captures_go_together():
    """A split pixel behind RCCB, and a blurred board."""
    chain = coloured("RCCB", optics={"f_number": 2.0, "transmittance": 0.9, "blur_sigma_m": 2e-6}).with_(
        sensor__photodiodes=[{"name": "small", "light_share": 0.02}],
        sensor__captures=[{"name": "large"}, {"name": "small", "photodiode": "small"}],
    )
    merged = Chain.from_document(chain.document | {"hdr": {"method": "most-sensitive"}})
    luminances = np.geomspace(1, 2000, 10)
    exact, simulated = (
        merged.sweep(scene__luminance_cd_m2=luminances, **way) for way in ({"exact": True}, {"seed": 4})
    )
    error = np.maximum(simulated["standard_error"].values, 2e-3)
    assert np.abs((exact["cdp"].values - simulated["cdp"].values) / error).max() < 3.5


def test_a_neutral_reflectance_changes_nothing():
    plain, grey = coloured("RGGB"), coloured("RGGB", "", [{"region": "dark", "reflectance": [[380, 0.2], [780, 0.2]]}])
    np.testing.assert_allclose(plain.run(2)["sensor"].values, grey.run(2)["sensor"].values)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"colour_filter": "RBGG"}, "colour_filter is 'RBGG': give one of RGGB, .*RCCC, .*RGB-IR"),
        ({"colour_filter": "RCCC"}, "planes has none: give R, C"),
        ({"planes": (ColourPlane("R", 0.5),)}, "planes has R: give none without a colour_filter"),
        (
            {"colour_filter": "RCCC", "planes": (ColourPlane("R", 0.5), ColourPlane("C", 0.5)), "plane": "B"},
            "plane is 'B'",
        ),
    ],
)
def test_filters_that_do_not_fit_are_refused(changes, message):
    values = {key: value for key, value in SENSOR.items() if key != "type"}
    with pytest.raises(InputError, match=message):
        Sensor(width=8, height=8, **values, **changes)


@pytest.mark.parametrize(
    ("spectrum", "message"),
    [
        ({"region": "sky"}, "spectra names the region 'sky': give each once, of dark, bright"),
        ({"region": "dark", "emission": "X99"}, "spectrum is 'X99', which is not known"),
        ({"region": "dark", "reflectance": [[500, 0.2]]}, "reflectance is"),
    ],
)
def test_spectra_that_do_not_fit_are_refused(spectrum, message):
    with pytest.raises(InputError, match=message):
        coloured("", spectra=[spectrum])
