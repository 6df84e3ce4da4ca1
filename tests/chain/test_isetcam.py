"""Numbers of ISETCam, a simulator of cameras by others, where its models are those of labcdp.

The numbers are facts from runs of ISETCam itself, recorded as baselines of the tests of SeongcheolJeong/pyisetcam (MIT
licence), tests/parity/baselines: scene_uniform_d65_small, scene_uniform_monochromatic_small, oi_cos4th_small,
optics_airy_disk_small, sensor_snr_components_small, sensor_imx490_uniform_small and
sensor_split_pixel_ovt_saturated_small. ISETCam sums from 400 to 700 nm in steps of 10 nm.
"""

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import minimize_scalar
from scipy.special import j0

from labcdp.chain import CameraModel, Chain, ExposureSettings, Optics, Sensor
from labcdp.chain.point_spread import diffraction_mtf
from labcdp.chain.predict.prediction import PatchRates, predict
from labcdp.core.photometry import PLANCK_J_S, SPEED_OF_LIGHT_M_S, photon_radiance_per_cd_m2, spectral_weights

#: Photons of D65 at 100 cd/m2 per s, m2, sr and nm.
D65_PHOTONS = 1e15 * np.array([
    2.307678, 2.615008, 2.735893, 2.598821, 3.217382, 3.671736, 3.779295, 3.764894, 3.880723, 3.718656, 3.813705,
    3.834879, 3.801036, 3.981477, 3.932992, 3.992162, 3.906778, 3.830860, 3.876079, 3.650613, 3.767926, 3.813506,
    3.793922, 3.661350, 3.737932, 3.629812, 3.694423, 3.847001, 3.714952, 3.357225, 3.498199,
])  # fmt: skip


def test_photons_of_d65_are_those_of_the_same_sum():
    wavelength_nm, power, visibility = spectral_weights("D65")
    at = np.searchsorted(wavelength_nm, np.arange(400, 701, 10))
    photons = power[at] * wavelength_nm[at] * 1e-9 / (PLANCK_J_S * SPEED_OF_LIGHT_M_S)
    per_100_cd_m2 = 100 * photons / (683 * 10 * np.sum(power[at] * visibility[at]))
    np.testing.assert_allclose(per_100_cd_m2, D65_PHOTONS, rtol=1e-3)
    # A sum counts both ends whole, an integral from 400 to 700 nm half: that makes 2.6 %.
    assert 10 * D65_PHOTONS.sum() / 100 == pytest.approx(1.11427e16, rel=1e-5)
    whole = trapezoid(D65_PHOTONS, dx=10) / 100
    assert whole / 1.11427e16 == pytest.approx(1 - 0.026, abs=1e-3)


def test_photons_of_one_wavelength():
    assert 100 * photon_radiance_per_cd_m2("monochromatic 550 nm") == pytest.approx(4.07433792e17, rel=1e-3)


def test_illuminance_behind_a_lens_falls_with_cos4():
    """640 samples, f = 3.86276 mm, f/4 at 1.2 m: illuminance at some of them in the middle row."""
    pitch_m, focal_m = 12.70198e-6, 3.86276e-3
    at_um = np.array([-2788.085, -2280.006, -1771.927, -1263.847, -755.768, 6.351])
    lux = np.array([2.0765295, 2.6419604, 3.2784147, 3.9190240, 4.4551444, 4.8025770])
    magnification = focal_m / (1.2 - focal_m)
    optics = Optics(4.0, 1.0, focal_length_m=focal_m, magnification=magnification)
    # ISETCam places the image at the focal length also for near scenes.
    vignetting = Optics(4.0, 1.0, focal_length_m=focal_m).vignetting(pitch_m)
    column = np.rint(at_um * 1e-6 / pitch_m - 0.5).astype(int) + 320
    relative = vignetting.relative_illuminance((1, 640))[0, column]
    np.testing.assert_allclose(relative / relative[-1], lux / lux[-1], rtol=1e-3)
    # It takes N for a tangent: pi / (1 + 4 N^2) instead of pi / (4 N^2), which makes 1.5 % at f/4.
    tangent = 1 / (1 + 1 / (4 * optics.working_f_number**2))
    assert 100 * optics.axial_illuminance_per_cd_m2 * tangent == pytest.approx(lux[-1], rel=1e-3)


def test_the_first_dark_ring_of_diffraction():
    """At f/3 and 550 nm, by the point spread that belongs to the MTF."""
    cutoff = 1 / (550e-9 * 3.0)
    frequency = np.linspace(0, cutoff, 20_001)
    mtf = diffraction_mtf(frequency, 550e-9, 3.0)

    def spread(radius_um):
        return trapezoid(mtf * j0(2 * np.pi * frequency * radius_um * 1e-6) * frequency, frequency)

    ring = minimize_scalar(spread, bounds=(1.5, 2.6), method="bounded", options={"xatol": 1e-5})
    assert ring.x == pytest.approx(2.013, rel=1e-3)
    assert ring.fun < 1e-5 * spread(0.0)


def test_signal_to_noise_ratio_of_all_components():
    """1 e- is 0.1 mV: read noise 3 mV, offsets 5 mV and gains 2 %; SNR in dB at 0.1 mV to 1 V."""
    electrons = np.geomspace(1, 10_000, 20)
    expected_db = [
        -35.3160668, -31.1063378, -26.8971067, -22.6886848, -18.4815794, -14.2766177, -10.0751525, -5.8794062,
        -1.6930533, 2.4777722, 6.6226928, 10.7238607, 14.7500936, 18.6466495, 22.3200065, 25.6250485, 28.3822884,
        30.4574271, 31.8573655, 32.7245874,
    ]  # fmt: skip
    sensor = Sensor(
        pixel_pitch_m=3e-6,
        width=8,
        height=8,
        quantum_efficiency=1.0,
        full_well_e=60_000.0,
        k_dn_per_e=1.0,
        read_noise_e=30.0,
        dark_current_e_s=0.0,
        bits=16,
        black_level_dn=2000.0,
        prnu_rel=0.02,
        dsnu_e=50.0,
    )
    camera = CameraModel(sensor, ExposureSettings(1.0))
    snr = predict(camera, PatchRates(electrons, 1.1 * electrons), 0.1).snr_dark
    np.testing.assert_allclose(snr, 10 ** (np.array(expected_db) / 20), rtol=1e-3)


def uniform_chain(sensor, mean_e, captures):
    """A uniform field that gives the sensor's own photodiode so many electrons, on the axis."""
    document = {
        "spectrum": "monochromatic 550 nm",
        "scene": {"type": "flat", "width": 256, "height": 256, "luminance_cd_m2": 1.0},
        "optics": {"f_number": 4.0, "transmittance": 1.0},
        "exposure": {"exposure_s": 0.1},
        "sensor": {"pixel_pitch_m": 3e-6, "quantum_efficiency": 0.5, "dark_current_e_s": 0.0, "bits": 12}
        | sensor
        | {"captures": captures},
    }
    chain = Chain.from_document(document)
    per_cd_m2 = Optics(4.0, 1.0).axial_illuminance_per_cd_m2 * chain.sensors[0][1].electrons_per_lx_s(
        "monochromatic 550 nm"
    )
    return chain.with_(scene__luminance_cd_m2=mean_e / (0.1 * per_cd_m2))


def test_four_captures_of_imx490():
    """Wells of 120,000 and 60,000 e-, areas of 9 to 1, a swing of 4096 x 0.25 mV, 12 bits, each at gains 1 and 4.

    A uniform scene of 100 cd/m2, 0.1 s, without noise: electrons, volts and DN of sensor_imx490_uniform_small. Its
    electrons of the large photodiode are taken, as the quantum efficiencies are in no text; all else follows.
    """
    electrons = np.array([8336.21005952, 8336.21005952, 926.24414598, 926.24414598])
    volts = np.array([0.07113564, 0.28454256, 0.01580792, 0.06323168])
    dn = np.array([284.54647827, 1138.16870117, 63.2016983, 252.92951965])
    swing_v = 4096 * 0.25e-3
    wells_e, gains = np.array([120_000, 120_000, 60_000, 60_000]), np.array([1, 4, 1, 4])
    # By hand: the swing is the full well at gain 1, and the range of the converter.
    np.testing.assert_allclose(electrons * swing_v / wells_e * gains, volts, rtol=2e-6)
    np.testing.assert_allclose(volts * 4096 / swing_v, dn, rtol=1e-3)
    k_dn_per_e = (4096 / wells_e * gains).tolist()
    names = ("large-1x", "large-4x", "small-1x", "small-4x")
    captures = [
        {"name": name, "k_dn_per_e": k, "photodiode": "small" if "small" in name else ""}
        for name, k in zip(names, k_dn_per_e, strict=True)
    ]
    sensor = {"full_well_e": 120_000, "k_dn_per_e": k_dn_per_e[0], "read_noise_e": 1.0}
    sensor["photodiodes"] = [{"name": "small", "light_share": 1 / 9, "full_well_e": 60_000}]
    run = uniform_chain(sensor, electrons[0], captures).run(1)
    seen = np.array([run[f"sensor {name}"].values.mean() for name in names])
    # Of 65,536 pixels with photon noise: below 2e-4 of the mean.
    np.testing.assert_allclose(seen, dn, rtol=1e-3)


def test_saturated_split_pixel():
    """Captures of R32 of IISW 2019 in far too much light: volts of sensor_split_pixel_ovt_saturated_small.

    22,000 e- at 49 uV, the same swing at 200 uV, and 7900 e- at 49 uV for the small photodiode.
    """
    volts, uv_per_e, wells_e = np.array([1.07799995, 1.07799995, 0.38710001]), (49, 200, 49), (22_000, 5390, 7900)
    np.testing.assert_allclose(np.array(wells_e) * uv_per_e * 1e-6, volts, rtol=1e-6)
    names = ("LPD-LCG", "LPD-HCG", "SPD-LCG")
    dn_per_v = 3500.0
    captures = [
        {
            "name": name,
            "k_dn_per_e": uv * 1e-6 * dn_per_v,
            "full_well_e": well,
            "photodiode": "small" * (name[0] == "S"),
        }
        for name, uv, well in zip(names, uv_per_e, wells_e, strict=True)
    ]
    sensor = {"full_well_e": 22_000, "k_dn_per_e": captures[0]["k_dn_per_e"], "read_noise_e": 0.0}
    sensor["photodiodes"] = [{"name": "small", "light_share": 0.01, "full_well_e": 7900}]
    run = uniform_chain(sensor, 1e8, captures).run(1)
    seen = np.array([run[f"sensor {name}"].values.mean() for name in names])
    # Whole DN.
    np.testing.assert_allclose(seen / dn_per_v, volts, atol=0.5 / dn_per_v)
