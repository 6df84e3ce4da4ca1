from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np
import pytest

from labcdp.chain import Chain, ExposureSettings, Sensor, ThesisSensor
from labcdp.chain.signal import Capture, Context, Signal
from labcdp.core.errors import InputError
from labcdp.core.photometry import photon_radiance_per_cd_m2

#: Photons s^-1 m^-2 per lux: 500 nm at 1000 lm/W.
PHOTONS = 500e-9 / (6.62607015e-34 * 299792458 * 1000)

_KINDS = ("", "row_", "column_")
NO_DARK_CURRENT = {f"{kind}dark_current_e_s": 0.0 for kind in _KINDS} | {
    f"{kind or 'pixel_'}pattern_e_s": 0.0 for kind in _KINDS
}


def thesis_sensor(**changes: Any) -> ThesisSensor:
    """The sensor of the thesis' table 5.2 with one DN per electron and a range that clips nothing."""
    ((_, sensor),) = Chain.load("thesis-2018").sensors
    assert isinstance(sensor, ThesisSensor)
    values = {"width": 300, "height": 200, "full_well_e": 60_000, "k_dn_per_e": 1.0, "bits": 16}
    return replace(sensor, **(values | changes))


def illuminance_of(electrons: np.ndarray, exposure_s: float) -> np.ndarray:
    return electrons / (PHOTONS * 0.7 * 2e-6**2 * exposure_s)


def capture(
    sensor: ThesisSensor,
    electrons: np.ndarray | float = 0.0,
    exposure_s: float = 0.5,
    *,
    index: int = 0,
    seed: int = 1,
    times: tuple[float, ...] = (),
    **settings: float,
) -> Capture:
    lux = illuminance_of(np.broadcast_to(np.asarray(electrons, float), sensor.shape), exposure_s)
    signal = Signal(lux, "illuminance", lambda values: values)
    settings_s = ExposureSettings(times or (exposure_s,), **settings)
    return sensor.capture(signal, Context("thesis-2018", seed, sensor.pixel_pitch_m, settings_s), index)


def test_the_thesis_takes_2_517e15_photons_for_a_candela_per_square_metre() -> None:
    assert photon_radiance_per_cd_m2("thesis-2018") == pytest.approx(PHOTONS, rel=1e-12)
    assert photon_radiance_per_cd_m2("thesis-2018") == pytest.approx(2.517e15, rel=2e-4)


@pytest.mark.parametrize(("temperature_c", "factor"), [(25.0, 1.0), (65.0, 16.0)])
def test_dark_signal_has_the_mean_of_the_three_dark_currents(temperature_c: float, factor: float) -> None:
    exposure_s = 16.0
    dn = capture(thesis_sensor(), exposure_s=exposure_s, temperature_c=temperature_c).dn
    # Poisson and pattern of pixels, rows and columns; what is cut off is 1/2 DN on average.
    spread_e_s = sqrt((35 + 5**2) / dn.size + (5 + 5**2) / 200 + (10 + 10**2) / 300)
    scale = factor * exposure_s
    assert dn.mean() == pytest.approx(50 * scale - 0.5, abs=5 * spread_e_s * scale)


def test_dark_signal_varies_over_rows_columns_and_pixels_as_the_rate_does() -> None:
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


def test_light_has_no_shot_noise_and_is_cut_off_not_rounded() -> None:
    sensor = thesis_sensor(**NO_DARK_CURRENT)
    electrons = np.linspace(0.05, 1000.0, sensor.width * sensor.height).reshape(sensor.shape)
    dn = capture(sensor, electrons).dn
    away = np.abs(electrons - np.rint(electrons)) > 1e-6
    np.testing.assert_array_equal(dn[away], np.floor(electrons)[away])


def test_the_converter_ends_at_2_to_the_bits_or_the_full_well_before() -> None:
    small = {"full_well_e": 1000, "k_dn_per_e": 0.25}
    for sensor, end in ((thesis_sensor(bits=8), 256), (thesis_sensor(**small), 250)):
        shot = capture(sensor, 5000.0)
        assert shot.dn.max() == shot.dn.min() == shot.saturation_dn == end
        assert shot.saturated.all()
    assert not capture(thesis_sensor(**small), 900.0, 1e-3).saturated.any()


def test_the_pattern_is_drawn_anew_for_each_exposure() -> None:
    first, second = (capture(thesis_sensor(), index=index, times=(0.5, 0.6)).dn.astype(float) for index in (0, 1))
    for axis, count in ((0, 300), (1, 200)):
        correlation = np.corrcoef(first.mean(axis=axis), second.mean(axis=axis))[0, 1]
        assert abs(correlation) < 5 / sqrt(count)


def test_way_back_takes_off_the_dark_signal_drawn() -> None:
    sensor = thesis_sensor()
    electrons = np.linspace(500.0, 900.0, sensor.width * sensor.height).reshape(sensor.shape)
    shot = capture(sensor, electrons)
    difference = shot.illuminance_lx(shot.dn) - illuminance_of(electrons, 0.5)
    # What is left is what is cut off; the mean of the noise is known to the way back.
    assert difference.mean() == pytest.approx(illuminance_of(np.float64(-0.5), 0.5), rel=0.02)


def test_missing_settings_are_refused(sensor: Sensor) -> None:
    for model in (thesis_sensor(), sensor):
        signal = Signal(np.ones(model.shape), "illuminance", lambda values: values)
        with pytest.raises(InputError, match=r"no exposure is set: add exposure_s, one time in s or several"):
            model.capture(signal, Context("thesis-2018"), 0)
