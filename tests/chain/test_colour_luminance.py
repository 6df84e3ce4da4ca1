"""Luminance combined of the planes of a colour filter: weights by hand, pairs counted in plain NumPy, prediction."""

import numpy as np
import pytest
import tifffile

import labcdp
from labcdp import Chain
from labcdp.chain import ColourPlane
from labcdp.chain.luminance import luminance_weights
from labcdp.core.errors import InputError
from labcdp.core.photometry import electron_radiance_per_cd_m2
from labcdp.core.spectra import SpectralTable, f1_prime

from .test_colour import PLANES, coloured


def weights_of(pattern, **changes):
    chain = coloured(pattern, "luminance").with_(**changes)
    return dict(luminance_weights(chain.sensors[0][1], chain.spectrum))


def test_weights_are_those_stated_or_nearest_to_the_eye():
    stated = [{"name": "R", "quantum_efficiency": 0.2, "luminance_weight": 1.0}]
    stated += [{"name": "C", "quantum_efficiency": 0.6, "luminance_weight": 3.0}]
    assert weights_of("RCCC", sensor__planes=stated) == {"R": 0.25, "C": 0.75}
    # Planes of one sensitivity count by their pixels.
    alike = [{"name": name, "quantum_efficiency": 0.3} for name in "RGB"]
    assert weights_of("RGGB", sensor__planes=alike) == pytest.approx({"R": 0.25, "G": 0.5, "B": 0.25})
    # A small change of any weight makes the combined sensitivity less like V: f1' is larger.
    wavelength_nm = np.arange(380.0, 781)

    def distance(weights):
        total = 0.0
        for name, weight in weights.items():
            efficiency = np.interp(wavelength_nm, *np.transpose(PLANES[name]), left=0, right=0)
            total = total + weight * efficiency * wavelength_nm / electron_radiance_per_cd_m2("D65", PLANES[name])
        return f1_prime(SpectralTable(tuple(wavelength_nm), tuple(total)))

    for pattern in ("RGGB", "RCCB", "RGB-IR"):
        best = weights_of(pattern)
        assert sum(best.values()) == pytest.approx(1.0)
        names = list(best)
        for first, second in zip(names, names[1:] + names[:1], strict=True):
            for step in (-0.01, 0.01):
                other = best | {first: best[first] + step, second: best[second] - step}
                assert distance(other) > distance(best)


def test_pairs_are_those_counted_in_plain_numpy():
    """Two greens, red and blue of Poisson counts, read noise and rounding, weighted and counted in pairs."""
    efficiencies, weights = {"R": 0.2, "G": 0.5, "B": 0.1}, {"R": 0.3, "G": 0.6, "B": 0.1}
    planes = [{"name": n, "quantum_efficiency": q, "luminance_weight": weights[n]} for n, q in efficiencies.items()]
    chain = coloured("RGGB", "luminance").with_(
        sensor__planes=planes, sensor__prnu_rel=0.0, spectrum="monochromatic 555 nm"
    )
    luminances = [0.3, 2.0, 20.0, 150.0]
    exact = chain.sweep(exact=True, contrast=1.0, scene__luminance_cd_m2=luminances)["cdp"].values
    rng, n = np.random.default_rng(8), 200_000
    lx = np.pi * 0.9 / (4 * 2.0**2)

    def cells(luminance_cd_m2):
        total = 0.0
        for plane in "RGGB":
            per_cd_m2 = electron_radiance_per_cd_m2("monochromatic 555 nm", efficiencies[plane]) * 3e-6**2 * lx * 0.01
            electrons = np.minimum(rng.poisson(luminance_cd_m2 * per_cd_m2 + 0.1, n), 10000)
            dn = np.clip(np.rint(0.38 * rng.normal(electrons, 2.0) + 64), 0, 4095)
            total = total + weights[plane] / "RGGB".count(plane) * (dn - 64 - 0.038) / (0.38 * per_cd_m2)
        return total

    for luminance, expected in zip(luminances, exact, strict=True):
        dark, bright = cells(luminance), cells(2 * luminance)
        lit = dark > 0
        contrast = np.divide(bright, dark, out=np.full(n, np.inf), where=lit) - 1
        counted = float(np.mean((contrast >= 0.5) & (contrast <= 1.5)))
        assert abs(counted - expected) < 3.5 * np.sqrt(max(counted * (1 - counted), 1 / n) / n) + 2e-4


def test_merged_and_companded_planes():
    base = coloured("RCCB", "luminance").document
    captures = {"captures": [{"name": "high"}, {"name": "low", "k_dn_per_e": 0.09, "read_noise_e": 4.0}]}
    document = base | {
        "sensor": base["sensor"] | captures | {"full_well_e": 40_000},
        "hdr": {"method": "most-sensitive"},
    }
    document |= {"isp": {"type": "pwl", "curve": "AR0231"}}
    chain = Chain.from_document(document)
    luminances = np.geomspace(0.5, 150, 8)
    exact, simulated = (chain.sweep(scene__luminance_cd_m2=luminances, **way) for way in ({"exact": True}, {"seed": 4}))
    error = np.maximum(simulated["standard_error"].values, 1e-3)
    assert np.abs((exact["cdp"].values - simulated["cdp"].values) / error).max() < 3.5


def test_signals_are_of_the_light_of_the_chain():
    chain = coloured("RGGB", "luminance")
    run = chain.run(3)
    masks = chain.scene.regions()
    assert run["sensor"].quantity == "illuminance"
    for name, level in (("dark", 5.0), ("bright", 10.0)):
        light = run["sensor"].luminance_cd_m2[masks[name]]
        assert light.mean() == pytest.approx(level, abs=4 * light.std() / np.sqrt(light.size) + 1e-3)
    full = chain.with_(scene__luminance_cd_m2=5e4).run(3)["sensor"]
    assert full.saturated.all()
    again = Chain.from_toml(chain.to_toml())
    np.testing.assert_array_equal(again.run(3)["sensor"].values, run["sensor"].values)


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match="plane is 'luminance': give none"):
        coloured("", "luminance")
    planes = [{"name": n, "quantum_efficiency": 0.3, "luminance_weight": w} for n, w in (("R", 1.0), ("C", -1.0))]
    contradictory = coloured("RCCC", "luminance").with_(sensor__planes=planes)
    with pytest.raises(InputError, match="the luminance_weight of the planes add up to 0: give weights"):
        contradictory.run()
    with pytest.raises(InputError, match="luminance_weight is 'much'"):
        ColourPlane("R", 0.3, luminance_weight="much")
    blurred = coloured("RGGB", "luminance").with_(optics__blur_sigma_m=2e-6)
    with pytest.raises(InputError, match="behind a lens that blurs"):
        blurred.sweep(exact=True, scene__luminance_cd_m2=[1.0])


def test_pictures_of_the_mosaic_have_the_luminance_of_the_chain(tmp_path):
    """The clear pixels of RCCB, as `--bayer RCCB` has them: cells of a picture against the prediction."""
    planes = [
        {"name": name, "quantum_efficiency": PLANES[name], "luminance_weight": float(name == "C")} for name in "RCB"
    ]
    mosaic = coloured("RCCB").with_(sensor__planes=planes, sensor__prnu_rel=0.0, sensor__dark_current_e_s=0.0)
    mosaic = mosaic.with_(scene__square_px=128, scene__luminance_cd_m2=3.0)
    exact = mosaic.with_(sensor__plane="luminance").sweep(exact=True, contrast=[0.5, 1.0], scene__luminance_cd_m2=[3.0])
    tifffile.imwrite(tmp_path / "mosaic.tif", mosaic.run(6)["sensor"].values)
    picture = labcdp.read_image(
        tmp_path / "mosaic.tif", encoding="linear", bayer="RCCB", black_level_dn=64, bit_depth=12, no_vignetting=True
    )
    light = np.asarray(picture.luminance, dtype=float)
    # Each cell of 2 x 2 pixels once, in the two upper squares.
    cells = light[:128:2, ::2] if light.shape == (256, 256) else light[:64]
    dark, bright = sorted((cells[:, :64], cells[:, 64:]), key=np.mean)
    counted = labcdp.cdp(bright.ravel(), dark.ravel(), [0.5, 1.0])
    z = (counted.cdp - exact["cdp"].values.ravel()) / np.maximum(counted.u, 1e-3)
    assert np.abs(z).max() < 3.5
