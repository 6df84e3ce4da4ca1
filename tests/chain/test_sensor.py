"""A sensor after EMVA 1288: counting statistics, noise, fixed pattern, clipping; and the camera around it."""

from dataclasses import replace
from math import inf, nan, pi, sqrt

import numpy as np
import pytest

from labcdp.chain import Chain, ExposureSettings, ImagingChain, Optics, Windscreen
from labcdp.chain.signal import Context, Signal
from labcdp.core.errors import InputError
from labcdp.core.photometry import photon_radiance_per_cd_m2

N = 300 * 200
#: Photons s^-1 m^-2 of 555 nm for 1 lux.
PHOTONS = 555e-9 / (6.62607015e-34 * 299792458) / 683


def expose(sensor, mean_e, index=0, **options):
    """An exposure of one second, as float."""
    settings = {"temperature_c": 25.0, "seed": 0, "exposure_index": index} | options
    return sensor.expose(mean_e, 1.0, **settings).astype(float)


def test_dark_current_doubles(sensor):
    device = replace(sensor, dark_current_e_s=40.0, reference_temperature_c=25.0, doubling_temperature_c=7.0)
    assert [device.dark_current_at(one) for one in (25.0, 39.0, 18.0)] == pytest.approx([40, 160, 20])
    assert expose(device, 0.0, temperature_c=39.0).mean() == pytest.approx(160, abs=5 * sqrt(160 / N))


def test_gain_is_20_log_10_of_the_amplitude(sensor):
    dn = expose(sensor, 1000.0, gain_db=20.0)
    assert dn.mean() == pytest.approx(10_000, abs=5 * 10 * sqrt(1000 / N))


def test_full_well_is_clipped_before_read_noise_and_lies_above_saturation(sensor):
    device = replace(sensor, full_well_e=1000.0, read_noise_e=10.0, black_level_dn=100.0)
    dn, sigma = expose(device, 5000.0), sqrt(100 + 1 / 12)
    assert dn.mean() == pytest.approx(1100, abs=5 * sigma / sqrt(N))
    assert dn.std() == pytest.approx(sigma, abs=5 * sigma / sqrt(2 * N))
    assert device.dark_noise_dn() == pytest.approx(sigma)
    noisy = replace(device, read_noise_e=20.0, dsnu_e=15.0)
    assert noisy.saturation_dn() == pytest.approx(1100 - 6 * 25)
    assert np.all(expose(noisy, 3000.0) >= noisy.saturation_dn())
    assert replace(sensor, bits=12).saturation_dn() == 4095
    assert (expose(sensor, 1e30) == sensor.full_well_e).all()


def test_seed_and_index_fix_the_noise_of_each_block_and_none_is_used_twice(sensor):
    device = replace(sensor, read_noise_e=5.0, prnu_rel=0.01)
    first = expose(device, 100.0)
    np.testing.assert_array_equal(first[:128], expose(replace(device, height=128), 100.0))
    shots = [expose(sensor, 1000.0, 0), expose(sensor, 1000.0, 1), expose(sensor, 1000.0, 0, seed=1)]
    blocks = [shot[rows].ravel() for shot in shots for rows in (slice(64), slice(64, 128))]
    np.testing.assert_allclose(np.corrcoef(blocks) - np.eye(6), 0, atol=5 / sqrt(64 * sensor.width))


@pytest.mark.parametrize(
    ("changes", "of", "mean", "spread", "count"),
    [
        ({"prnu_rel": 0.02}, lambda one: one.photo_response, 1.0, 0.02, N),
        ({"dsnu_e": 3.0}, lambda one: one.offset_e, 0.0, 3.0, N),
        ({"column_dsnu_e": 4.0}, lambda one: one.offset_e[0], 0.0, 4.0, 300),
        ({"row_dsnu_e": 2.0}, lambda one: one.offset_e[:, 0], 0.0, 2.0, 200),
        # A gamma distribution of order 4, of excess kurtosis 6 / 4.
        ({"dark_current_e_s": 10.0, "dsnu_e_s": 5.0}, lambda one: one.dark_current, 1.0, 0.5, N / (1 + 6 / 4 / 2)),
    ],
)
def test_patterns_have_their_mean_and_the_stated_spread(sensor, changes, of, mean, spread, count):
    values = of(replace(sensor, **changes).fixed_pattern)
    assert values.mean(dtype=float) == pytest.approx(mean, abs=5 * spread / sqrt(count))
    assert values.std(dtype=float) == pytest.approx(spread, abs=5 * spread / sqrt(2 * count))
    assert mean == 0 or values.min() >= 0


def test_patterns_stay_while_noise_averages_out_and_neither_is_in_the_other(sensor):
    device, count, mean_e = replace(sensor, prnu_rel=0.05, device_seed=7), 8, 10_000
    mean = np.mean([expose(device, mean_e, index) for index in range(count)], axis=0)
    noise_e, pattern = sqrt(mean_e / count), device.fixed_pattern.photo_response
    assert (mean - mean_e * pattern).std() == pytest.approx(noise_e, abs=5 * noise_e / sqrt(2 * N))
    noise = expose(replace(sensor, read_noise_e=10.0, black_level_dn=100.0), 0.0, seed=7)
    assert np.corrcoef(noise.ravel(), pattern.ravel())[0, 1] == pytest.approx(0, abs=5 / sqrt(N))


@pytest.mark.parametrize(
    "change", [{"exposure_s": 0.0}, {"gain_db": inf}, {"seed": -1}, {"electron_rate": nan}, {"electron_rate": -1.0}]
)
def test_exposure_out_of_range_is_refused(sensor, change):
    values = {"electron_rate": 1.0, "exposure_s": 1.0, "temperature_c": 25.0, "seed": 0, "exposure_index": 0}
    with pytest.raises(InputError, match=rf"^{next(iter(change))} (is|has) "):
        sensor.expose(**(values | change))


TEMPERATURE_C = 35.0


@pytest.fixture
def chain():
    """The bench's camera with a smaller sensor, without fixed pattern."""
    camera = Chain.load("manta-g505").camera()
    return replace(camera, sensor=replace(camera.sensor, width=320, height=240, dsnu_e=0.0, dsnu_e_s=0.0, prnu_rel=0.0))


@pytest.mark.parametrize(
    ("windscreen", "passed", "glare"), [(None, 1.0, 0.0), (Windscreen(0.8, glare_fraction=0.5), 0.8, 1.25)]
)
def test_light_reaches_the_pixels_with_its_shot_noise_once(sensor, windscreen, passed, glare):
    # Columns of 1 and 4 cd/m^2, 2.5 on average; so far behind the lens there is no vignetting.
    chain = ImagingChain("monochromatic 555 nm", windscreen, Optics(2.0, 0.9, focal_length_m=1.0), sensor)
    scene = np.broadcast_to(np.where(np.arange(sensor.width) % 2, 4.0, 1.0), sensor.shape)
    mean_e = passed * (scene + glare) * 0.9 * pi / 16 * PHOTONS * 9e-12 * 0.5
    np.testing.assert_allclose(chain.electron_rate(scene), mean_e, rtol=1e-6)
    dn = expose(sensor, chain.electron_rate(scene))
    # The square of a Poisson count's deviation has the mean m and the variance 2 m^2 + m.
    sigma = sqrt(np.mean(2 * mean_e**2 + mean_e) / N)
    assert np.mean((dn - mean_e) ** 2) == pytest.approx(mean_e.mean(), abs=5 * sigma)


@pytest.mark.parametrize(("exposure_s", "gain_db"), [(1e-3, 0.0), (0.5e-3, 6.0)])
def test_dn_are_linear_in_the_luminance_with_the_noise_of_the_sensor(chain, exposure_s, gain_db):
    chain = replace(chain, windscreen=Windscreen(0.9))
    scene = np.geomspace(40, 300, 320 * 240).reshape(240, 320)
    at = {"gain_db": gain_db, "temperature_c": TEMPERATURE_C}
    dn = chain.sensor.expose(chain.electron_rate(scene), exposure_s, seed=4, exposure_index=0, **at)
    net_dn = dn - chain.dark_dn(exposure_s, **at)
    vignetting = chain.optics.vignetting(chain.sensor.pixel_pitch_m).relative_illuminance(chain.sensor.shape)
    dn_per_cd_m2 = chain.responsivity_dn_s_cd_m2(gain_db) * exposure_s * vignetting
    variance_dn2 = chain.sensor.system_gain_dn_per_e(gain_db) * net_dn + chain.sensor.dark_noise_dn(gain_db) ** 2
    luminance, stated = net_dn / dn_per_cd_m2, variance_dn2 / dn_per_cd_m2**2
    squares = (luminance - scene) ** 2
    assert luminance.mean() == pytest.approx(scene.mean(), abs=5 * sqrt(squares.mean() / squares.size))
    # The stated noise follows from the noisy pixel itself, which skews it in the dark: compare means, in cd/m^2.
    assert squares.mean() == pytest.approx(stated.mean(), abs=5 * squares.std() / sqrt(squares.size))


def test_saturation_luminance_and_dark_current_together_reach_saturation(chain):
    exposure_s, temperature_c = 5.0, 65.0
    luminance = chain.saturation_luminance_cd_m2(exposure_s, temperature_c=temperature_c)
    rate = chain.electron_rate(np.full(chain.sensor.shape, luminance))[120, 160]
    electrons = exposure_s * (rate + 5 * 2 ** ((65 - 25) / 8))
    assert 64 + 0.6 * electrons == pytest.approx(chain.sensor.saturation_dn(), rel=1e-5)


# The sensor of the 2018 thesis


#: Photons s^-1 m^-2 per lux: 500 nm at 1000 lm/W.
THESIS_PHOTONS = 500e-9 / (6.62607015e-34 * 299792458 * 1000)

NO_DARK_CURRENT = dict.fromkeys(("dark_current_e_s", "row_dark_current_e_s", "column_dark_current_e_s"), 0.0)
NO_DARK_CURRENT |= dict.fromkeys(("pixel_pattern_e_s", "row_pattern_e_s", "column_pattern_e_s"), 0.0)


def thesis_sensor(**changes):
    """The sensor of the thesis' table 5.2 with one DN per electron and a range that clips nothing."""
    ((_, sensor),) = Chain.load("thesis-2018").sensors
    values = {"width": 300, "height": 200, "full_well_e": 60_000, "k_dn_per_e": 1.0, "bits": 16}
    return replace(sensor, **(values | changes))


def illuminance_of(electrons, exposure_s):
    return electrons / (THESIS_PHOTONS * 0.7 * 2e-6**2 * exposure_s)


def capture(sensor, electrons=0.0, exposure_s=0.5, **settings):
    lux = illuminance_of(np.broadcast_to(np.asarray(electrons, float), sensor.shape), exposure_s)
    context = Context("thesis-2018", 1, sensor.pixel_pitch_m, ExposureSettings((exposure_s,), **settings))
    return sensor.capture(Signal(lux, "illuminance", lambda values: values), context, 0)


def test_the_thesis_takes_2_517e15_photons_for_a_candela_per_square_metre():
    assert photon_radiance_per_cd_m2("thesis-2018") == pytest.approx(THESIS_PHOTONS, rel=1e-12)
    assert photon_radiance_per_cd_m2("thesis-2018") == pytest.approx(2.517e15, rel=2e-4)


@pytest.mark.parametrize(("temperature_c", "factor"), [(25.0, 1.0), (65.0, 16.0)])
def test_dark_signal_has_the_mean_of_the_three_dark_currents(temperature_c, factor):
    exposure_s = 16.0
    dn = capture(thesis_sensor(), exposure_s=exposure_s, temperature_c=temperature_c).dn
    # Poisson and pattern of pixels, rows and columns; what is cut off is 1/2 DN on average.
    spread_e_s = sqrt((35 + 5**2) / dn.size + (5 + 5**2) / 200 + (10 + 10**2) / 300)
    scale = factor * exposure_s
    assert dn.mean() == pytest.approx(50 * scale - 0.5, abs=5 * spread_e_s * scale)


def test_dark_signal_varies_over_rows_columns_and_pixels_as_the_rate_does():
    scale = 8.0  # s, at 25 degC: the noise is drawn for a second, then scaled
    dn = capture(thesis_sensor(), exposure_s=scale).dn.astype(float)
    rows, columns = dn.mean(axis=1), dn.mean(axis=0)
    pixels = dn - rows[:, None] - columns + dn.mean()
    for values, variance, dof in (
        (rows, 5 + 5**2 + (35 + 5**2) / 300, 199),
        (columns, 10 + 10**2 + (35 + 5**2) / 200, 299),
        (pixels, 35 + 5**2, 199 * 299),
    ):
        measured = ((values - values.mean()) ** 2).sum() / dof
        # The excess of a Poisson number, 1 / mean, is small beside the 2 of the normal distribution.
        assert measured == pytest.approx(variance * scale**2, rel=5 * sqrt(2.5 / dof))


def test_light_has_no_shot_noise_and_is_cut_off_not_rounded():
    sensor = thesis_sensor(**NO_DARK_CURRENT)
    electrons = np.linspace(0.05, 1000.0, sensor.width * sensor.height).reshape(sensor.shape)
    dn = capture(sensor, electrons).dn
    away = np.abs(electrons - np.rint(electrons)) > 1e-6
    np.testing.assert_array_equal(dn[away], np.floor(electrons)[away])


def test_the_converter_ends_at_2_to_the_bits_or_the_full_well_before():
    small = {"full_well_e": 1000, "k_dn_per_e": 0.25}
    for sensor, end in ((thesis_sensor(bits=8), 256), (thesis_sensor(**small), 250)):
        shot = capture(sensor, 5000.0)
        assert shot.dn.max() == shot.dn.min() == shot.saturation_dn == end
    assert not capture(thesis_sensor(**small), 900.0, 1e-3).saturated.any()


def test_way_back_takes_off_the_dark_signal_drawn():
    sensor = thesis_sensor()
    electrons = np.linspace(500.0, 900.0, sensor.width * sensor.height).reshape(sensor.shape)
    shot = capture(sensor, electrons)
    difference = shot.illuminance_lx(shot.dn) - illuminance_of(electrons, 0.5)
    # What is left is what is cut off; the mean of the noise is known to the way back.
    assert difference.mean() == pytest.approx(illuminance_of(np.float64(-0.5), 0.5), rel=0.02)
