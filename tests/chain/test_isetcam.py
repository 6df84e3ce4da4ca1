"""Numbers of ISETCam, a simulator of cameras by others, where its models are those of labcdp.

The numbers are facts from runs of ISETCam itself, recorded as baselines of the tests of SeongcheolJeong/pyisetcam (MIT
licence), tests/parity/baselines: scene_uniform_d65_small, scene_uniform_monochromatic_small, oi_cos4th_small,
optics_airy_disk_small and sensor_snr_components_small. ISETCam sums from 400 to 700 nm in steps of 10 nm.
"""

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import minimize_scalar
from scipy.special import j0

from labcdp.chain import CameraModel, ExposureSettings, Optics, Sensor
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
