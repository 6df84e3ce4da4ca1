"""Predicted colour separation against simulated cells, of contrasts and of metamers that have none."""

import numpy as np
import pytest

import labcdp
from labcdp.core.errors import InputError, PredictionError

from .test_colour import PATTERNS, coloured

RED = {"reflectance": [[380, 0.2], [590, 0.2], [610, 1.0], [780, 1.0]]}
GREY = {"reflectance": [[380, 0.4], [780, 0.4]]}
#: Two patches of one luminance, far from each other and from the edges.
METAMERS = {
    "type": "patches",
    "width": 256,
    "height": 128,
    "background_cd_m2": 3.0,
    "patches": [
        {"x": 0, "y": 0, "width": 128, "height": 128, "luminance_cd_m2": 3.0, "name": "dark"},
        {"x": 128, "y": 0, "width": 128, "height": 128, "luminance_cd_m2": 3.0, "name": "bright"},
    ],
    "contrasts": [["dark", "bright"]],
}
SPECTRA = [{"region": "bright", **RED}, {"region": "dark", **GREY}]


def cells(values, pattern):
    """Means of the pixels of each plane in each 2 x 2, shape (height, width, planes)."""
    height, width = (size // 2 * 2 for size in values.shape)
    parts = values[:height, :width].reshape(height // 2, 2, width // 2, 2).transpose(0, 2, 1, 3).reshape(
        height // 2, width // 2, 4
    )  # fmt: skip
    filters = list(pattern)
    return np.stack(
        [parts[..., [at for at in range(4) if filters[at] == plane]].mean(axis=-1) for plane in PATTERNS[pattern]],
        axis=-1,
    )


@pytest.mark.parametrize("pattern", ["RGGB", "RCCB", "RCCC"])
@pytest.mark.parametrize("scene", ["metamers", "contrast"])
def test_prediction_equals_simulated_cells(pattern, scene):
    chain = coloured(pattern, spectra=SPECTRA[:1])
    if scene == "metamers":
        chain = labcdp.Chain.from_document(chain.document | {"scene": METAMERS | {"spectra": SPECTRA}})
    # Few electrons, so that shares are neither 0 nor 1.
    chain = labcdp.Chain.from_document(chain.document).with_(exposure__exposure_s=0.001)
    predicted = chain.colour_separation(stage="sensor")
    run = chain.run(seed=8)
    regions = run.chain.scene.regions()
    linear = run["sensor"].values.astype(float) - 64 - 10.0 * 0.001 * 0.38
    by_cell = cells(linear, pattern)
    pixels = [by_cell[regions[name][::2, ::2]] for name in ("dark", "bright")]
    measured = labcdp.colour_separation(*pixels)
    for name, quantity in (
        ("colour_distance", measured.distance),
        ("csp", measured.csp),
        ("csp_counted", measured.csp_counted),
        ("colours_detected", measured.detected),
    ):
        # Intervals of 95 % may miss in one of 24 cases; twice U does in one of 10^4.
        assert abs(quantity.value - float(predicted[name])) <= 2 * quantity.U + 1e-12, name


def test_more_light_separates_and_what_cannot_be_predicted_is_said():
    chain = labcdp.Chain.from_document(coloured("RGGB", spectra=SPECTRA).document)
    swept = chain.colour_separation(scene__luminance_cd_m2=[0.01, 0.1, 1.0, 10.0], exposure__exposure_s=[0.001, 0.01])
    assert swept["csp"].dims == ("scene.luminance_cd_m2", "exposure.exposure_s")
    assert (np.diff(swept["csp"].values, axis=0) >= 0).all()
    assert float(swept["csp"][0, 0]) == pytest.approx(0.5, abs=0.02)
    with pytest.raises(InputError, match="has no colour filter"):
        labcdp.Chain.from_document(coloured("").document).colour_separation()
    blurred = coloured("RGGB", optics={"f_number": 2.0, "transmittance": 0.9, "blur_sigma_m": 2e-6})
    with pytest.raises(PredictionError, match="mixes the colours"):
        labcdp.Chain.from_document(blurred.document).colour_separation()
