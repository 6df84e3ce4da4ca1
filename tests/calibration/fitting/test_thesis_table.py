"""Table 3.1 of the thesis as input: four patches, one exposure; the numbers that came out are in the tests."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from labcdp.calibration import fit, patch_luminance

from ..conftest import SimulatedCamera, codes, make_reading

#: L. Ebbert, Implementierung von CDP, HS Duesseldorf, 2018, table 3.1: by the meter, and calculated from the image.
MEASURED = {"upper right": 75.6, "upper left": 356.0, "lower right": 33.6, "lower left": 412.0}
CALCULATED = {"upper right": 100.4, "upper left": 542.72, "lower right": 48.7, "lower left": 570.0}
RATIOS = np.array([CALCULATED[patch] / MEASURED[patch] for patch in MEASURED])


#: The calculated values stand for the signal; they are free of darkness.
CAMERA = SimulatedCamera(dark_offset_dn=0.0, dark_rate_dn_s=0.0)


def seen(patch, mean_dn):
    return replace(CAMERA.observe(patch, 0.0, 1.0, None), mean_dn=mean_dn)


def test_one_gain_brings_all_four_within_8_percent_and_a_further_patch_is_known_to_21_percent(setup):
    """It is that of four scattering patches: standard deviation over sqrt(4), with 3 degrees of freedom."""
    observations = [seen(patch, dn) for patch, dn in CALCULATED.items()]
    # LS-110, +-2 % +-2 digits: 0.02 cd/m^2 below 100, 0.2 cd/m^2 above.
    readings = {patch: [make_reading(v, digits_half_width=0.2 if v >= 100 else 0.02)] for patch, v in MEASURED.items()}
    calibration = fit(observations, [CAMERA.dark(1.0, None)], readings, setup)
    deviations = {row.patch: round(100 * row.residual_rel, 1) for row in calibration.residuals}
    assert deviations == {"upper right": -6.4, "upper left": 7.4, "lower right": 2.1, "lower left": -2.5}
    assert calibration.left_out == ()
    relative = RATIOS.std(ddof=1) / RATIOS.mean()
    assert relative == pytest.approx(0.060, abs=5e-4)
    r = calibration.responsivity
    assert (r.scatter_rel, r.scatter_dof) == pytest.approx((relative, 3), rel=0.02)
    assert (r.random_rel, r.dof) == pytest.approx((relative / 2, 3), rel=0.02)
    assert "patches-scatter" in codes(calibration)
    patch = patch_luminance(calibration.at_their_temperature(), [seen("new", 200.0)])
    # t_3 s sqrt(1 + 1/4), the prediction interval of a mean of four, and the meter's 2 % beside it.
    assert patch.U_rel == pytest.approx(student.isf(0.025, 3) * relative * np.sqrt(1.25), rel=0.02)
    assert patch.U_rel == pytest.approx(0.214, abs=0.003)
