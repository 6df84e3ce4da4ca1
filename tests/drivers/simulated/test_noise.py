"""Noise of simulated frames: against the sensor's own model, from frame to frame, and after an interruption."""

from itertools import product

import numpy as np
import pytest

from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.noise_kernel import QUANTILES, draw_exposure

SHAPE = (400, 480)
N = 200_000


@pytest.mark.parametrize(
    ("mean_e", "read_noise_e"), [*product([0.0, 0.3, 3.9, 4.1, 20.0, 900.0, 6950.0, 8000.0], [0.0, 10.0])]
)
def test_distribution_is_that_of_poisson_full_well_and_read_noise(mean_e, read_noise_e):
    """Mean, variance and third moment of the counted electrons, which NumPy draws one by one."""
    rng = np.random.default_rng(1)
    theirs = np.minimum(rng.poisson(mean_e, N), 7000) + rng.normal(0, read_noise_e, N)
    flat = np.full((400, N // 400), mean_e, np.float32)
    # Gain 4 keeps steps of single electrons visible.
    dn = draw_exposure(flat, np.zeros_like(flat), (7000.0, 65535.0), read_noise_e, 4.0, 1000.0, 99, QUANTILES)
    ours = (dn.ravel().astype(float) - 1000) / 4
    assert ours.mean() == pytest.approx(theirs.mean(), abs=4 * np.sqrt((mean_e + read_noise_e**2) * 2 / N) + 1e-9)
    # The approximation above 4 electrons is 0.5 % low in variance where no read noise covers it.
    assert ours.var() == pytest.approx(theirs.var(), rel=0.005 + 4 * np.sqrt(4 / N), abs=0.01)
    third = [((values - values.mean()) ** 3).mean() for values in (ours, theirs)]
    assert third[0] == pytest.approx(third[1], abs=5 * np.sqrt(30 / N) * (mean_e + read_noise_e**2) ** 1.5 + 0.02)


def test_pixels_of_one_frame_do_not_depend_on_each_other():
    flat = np.full((512, 512), 1000, np.float32)
    dn = draw_exposure(flat, np.zeros_like(flat), (1e6, 65535.0), 5.0, 1.0, 0.0, 7, QUANTILES).astype(float)
    spectrum = np.abs(np.fft.rfft2((dn - dn.mean()) / dn.std())) ** 2 / dn.size
    power = np.sort(spectrum[1:-1, 1:-1].ravel())
    # White noise: powers are exponential with mean 1; the largest of n is about log(n).
    assert power.mean() == pytest.approx(1, abs=5 / np.sqrt(power.size))
    assert power[-1] < np.log(power.size) + 8


def test_a_resumed_bench_has_other_noise(small_configuration):
    brightest = max(small_configuration.target.patches, key=lambda patch: patch.nominal_luminance_cd_m2).name

    def started(n_records):
        bench = SimulatedBench(small_configuration, BenchDevices.standard(), SHAPE, n_records=n_records)
        with bench.in_process_camera() as camera, bench.in_process_meter(0) as meter:
            bench.point_meter(brightest)
            camera.configure(exposure_s=0.001)
            return camera.snap().dn, [meter.measure().value for _ in range(5)]

    first, again, resumed = started(0), started(0), started(17)
    np.testing.assert_array_equal(first[0], again[0])
    assert first[1] == again[1] != resumed[1]
    assert (first[0] != resumed[0]).mean() > 0.2
