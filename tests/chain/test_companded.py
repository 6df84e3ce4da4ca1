"""Companded output of a chain: each code, exact prediction against simulation, and the file of a frame read back."""

import numpy as np
import pytest
import tifffile

import labcdp
from labcdp import Chain
from labcdp.chain import PiecewiseLinear
from labcdp.core.errors import InputError

KNEES = {"codes": [0, 1024, 2048, 4000], "values": [0, 1024, 9216, 65535], "bits": 12}
SENSOR = {"width": 256, "height": 256, "pixel_pitch_m": 3e-6, "quantum_efficiency": 0.5, "full_well_e": 9000}
SENSOR |= {"k_dn_per_e": 0.45, "read_noise_e": 3, "dark_current_e_s": 20, "bits": 12, "black_level_dn": 60}
BOARD = {"type": "checkerboard", "width": 256, "height": 256, "square_px": 32, "luminance_cd_m2": 10.0, "contrast": 1.0}
#: One exposure of 12 bits in codes of 10, and two merged to 16 in codes of 12.
SINGLE = {
    "exposure": {"exposure_s": 0.01},
    "isp": {"type": "pwl", "codes": [0, 512, 1020], "values": [0, 512, 4090], "bits": 10},
}
MERGED = {
    "exposure": {"exposure_s": [0.02, 0.002]},
    "hdr": {"method": "normal", "bits": 16},
    "isp": {"type": "pwl", **KNEES},
}
#: A capture with its own gain and photodiode, which nothing merges.
CAPTURE = SINGLE | {
    "sensor": SENSOR | {
        "photodiodes": [{"name": "small", "light_share": 0.4, "full_well_e": 5000}],
        "captures": [{"name": "low", "photodiode": "small", "k_dn_per_e": 0.7, "exposure_s": 0.02}],
    },
}  # fmt: skip


def chain_of(changes):
    optics = {"f_number": 2.0, "transmittance": 0.9}
    document = {"name": "companded", "spectrum": "D65", "scene": BOARD, "optics": optics, "sensor": SENSOR, **changes}
    return Chain.from_document(document)


@pytest.mark.parametrize("changes", [SINGLE, CAPTURE, MERGED], ids=["one exposure", "one capture", "merged"])
def test_exact_prediction_is_that_of_simulated_frames(changes):
    """20 cells of 65536 pixels; each within 3.5 standard errors of the simulated CDP."""
    chain = chain_of(changes)
    axes = {"scene__luminance_cd_m2": [0.5, 3.0, 20.0, 80.0, 300.0], "scene__contrast": [0.2, 0.5, 1.0, 2.0]}
    exact, simulated = chain.sweep(exact=True, **axes), chain.sweep(seed=3, **axes)
    error = np.maximum(simulated["standard_error"].values, 1 / 32768)
    z = (exact["cdp"].values - simulated["cdp"].values) / error
    assert np.abs(z).max() < 3.5
    assert 0.05 < exact["cdp"].values.mean() < 0.95


def test_a_frame_in_a_file_has_the_contrast_of_the_chain(tmp_path):
    """No black level here: relative luminance of the file is in proportion to that of the chain."""
    chain = chain_of({**MERGED, "sensor": {**SENSOR, "dark_current_e_s": 0}}).with_(scene__luminance_cd_m2=20.0)
    run = chain.run(seed=5)
    tifffile.imwrite(tmp_path / "codes.tif", run["isp"].values.astype(np.uint16))
    curve = labcdp.files.Companding("knees", **{key: tuple(KNEES[key]) for key in ("codes", "values")}, bits=12)
    image = labcdp.read_image(tmp_path / "codes.tif", encoding=curve, no_vignetting=True)
    inside = np.asarray(image.luminance, dtype=float) * curve.scale
    behind = run["isp"].to_luminance(run["isp"].values)
    ratio = inside / behind
    assert ratio.std() / ratio.mean() < 1e-4
    assert np.array_equal(image.luminance.invalid > 0, np.zeros(image.luminance.shape, dtype=bool))


@pytest.mark.parametrize("curve", [PiecewiseLinear("AR0231"), PiecewiseLinear("OX03C10"), PiecewiseLinear(**KNEES)])
def test_each_code_begins_where_it_says(curve):
    codes = np.arange(curve.n_codes)
    assert np.array_equal(curve.encode(curve.decode(codes)), codes)
    inside = np.nextafter(curve.first_dn[1:], np.inf)
    assert np.array_equal(curve.encode(inside * (1 + 1e-12)), codes[1:])
    assert np.array_equal(curve.encode(inside * (1 - 1e-9)), codes[:-1])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "curve is '': give a curve's name, or codes and values"),
        ({"curve": "AR0231", "codes": (0, 1), "values": (0, 1)}, "give a curve's name, or codes and values"),
        ({"curve": "AR1"}, "^curve is .AR1., which does not ship"),
        ({"curve": "AR0231", "bits": 10}, "bits is 10, but codes of the curve AR0231 have 12"),
        ({"codes": (0, 5, 3), "values": (0, 1, 2)}, "rising order"),
        ({"codes": ("a", 5), "values": (0, 1)}, "codes is"),
    ],
)
def test_a_curve_that_is_none_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        PiecewiseLinear(**options)


def test_knees_that_begin_at_other_values_are_exact_too():
    """A chain has its black level in the sensor, whatever value the first knee has."""
    for first in (-60, 60):
        chain = chain_of({**MERGED, "isp": {"type": "pwl", "codes": [0, 1024, 2000], "values": [first, 2000, 65535]}})
        axes = {"scene__luminance_cd_m2": [1.0, 20.0]}
        exact, simulated = chain.sweep(exact=True, **axes), chain.sweep(seed=3, **axes)
        assert exact["cdp"].values == pytest.approx(simulated["cdp"].values, abs=0.01)
