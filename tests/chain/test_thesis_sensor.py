from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.chain import Chain, ExposureSettings
from labcdp.chain.signal import Context, Signal
from labcdp.core.photometry import photon_radiance_per_cd_m2

#: Photons s^-1 m^-2 per lux: 500 nm at 1000 lm/W.
PHOTONS = 500e-9 / (6.62607015e-34 * 299792458 * 1000)

NO_DARK_CURRENT = dict.fromkeys(("dark_current_e_s", "row_dark_current_e_s", "column_dark_current_e_s"), 0.0)
NO_DARK_CURRENT |= dict.fromkeys(("pixel_pattern_e_s", "row_pattern_e_s", "column_pattern_e_s"), 0.0)


def thesis_sensor(**changes):
    """The sensor of the thesis' table 5.2 with one DN per electron and a range that clips nothing."""
    ((_, sensor),) = Chain.load("thesis-2018").sensors
    values = {"width": 300, "height": 200, "full_well_e": 60_000, "k_dn_per_e": 1.0, "bits": 16}
    return replace(sensor, **(values | changes))


def illuminance_of(electrons, exposure_s):
    return electrons / (PHOTONS * 0.7 * 2e-6**2 * exposure_s)


def capture(sensor, electrons=0.0, exposure_s=0.5, **settings):
    lux = illuminance_of(np.broadcast_to(np.asarray(electrons, float), sensor.shape), exposure_s)
    context = Context("thesis-2018", 1, sensor.pixel_pitch_m, ExposureSettings((exposure_s,), **settings))
    return sensor.capture(Signal(lux, "illuminance", lambda values: values), context, 0)


def test_the_thesis_takes_2_517e15_photons_for_a_candela_per_square_metre():
    assert photon_radiance_per_cd_m2("thesis-2018") == pytest.approx(PHOTONS, rel=1e-12)
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
    for values, variance, freedom in (
        (rows, 5 + 5**2 + (35 + 5**2) / 300, 199),
        (columns, 10 + 10**2 + (35 + 5**2) / 200, 299),
        (pixels, 35 + 5**2, 199 * 299),
    ):
        measured = ((values - values.mean()) ** 2).sum() / freedom
        # The excess of a Poisson number, 1 / mean, is small beside the 2 of the normal distribution.
        assert measured == pytest.approx(variance * scale**2, rel=5 * sqrt(2.5 / freedom))


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
