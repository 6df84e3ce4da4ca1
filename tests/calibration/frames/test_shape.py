"""What the meter sees of a patch: the part of its region that frames show, against the whole."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import fit, observe_patches
from labcdp.calibration.frames.observations import PatchPart
from labcdp.core.roi import Roi

from ..conftest import SimulatedCamera, bench, codes, make_frame, make_reading

#: A region of 30 x 18 pixels, and light that falls with the square of the distance from its centre.
REGION = Roi("P", ((10.0, 12.0), (40.0, 12.0), (40.0, 30.0), (10.0, 30.0)))
Y, X = np.mgrid[:48, :64] + 0.5
AWAY = np.hypot(X - 25, Y - 21)
LIGHT = 1000 * (1 - 4e-4 * AWAY**2)
INSIDE = (np.abs(X - 25) < 15) & (np.abs(Y - 21) < 9)


@pytest.mark.parametrize(
    ("field_px", "seen"),
    [(None, (np.abs(X - 25) < 5) & (np.abs(Y - 21) < 3)), (8.0, AWAY <= 4), (400.0, INSIDE)],
)
def test_the_part_that_the_meter_sees_is_its_field_or_the_middle_third(field_px, seen):
    frames = [make_frame(64 + LIGHT + n, frame_id=n) for n in (0, 1)]
    (observed,) = observe_patches(frames, [REGION], field_px=field_px)
    expected = LIGHT[seen & INSIDE].mean() / LIGHT[INSIDE].mean() - 1
    assert observed.shape_dn(64.5) / observed.net_dn(64.5) == pytest.approx(expected, abs=5e-4)
    assert (observed.middle is None) == (field_px == 400)


def shaped(is_field):
    """A bench whose patches are 2 % brighter where the meter reads, and its readings."""
    exact = {"repeatability_rel": 0.0, "digits_half_width": 0.0}
    observations, darks, readings = bench(SimulatedCamera(), lambda v: make_reading(v, **exact))
    middle = [
        PatchPart(1.02 * (o.mean_dn - d) + d, 1.0, 1 / 9, is_field)
        for o in observations
        for d in [64 + 40 * o.exposure_s]
    ]
    observations = [replace(o, middle=one) for o, one in zip(observations, middle, strict=True)]
    readings = {name: [replace(r, value=1.02 * r.value) for r in group] for name, group in readings.items()}
    return observations, darks, readings


def test_a_shape_that_all_patches_have_is_an_error_of_all_or_corrected_by_the_meters_field(setup):
    unknown, known = (fit(*shaped(is_field), setup) for is_field in (False, True))
    assert "patch-shape" in codes(unknown)
    assert unknown.responsivity.random_rel == pytest.approx(0.02, rel=0.01)
    assert "patch-shape" not in codes(known)
    assert known.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-6)
    assert known.responsivity.random_rel < 0.001
    # Contrasts are those of the light in either case.
    assert unknown.responsivity.scatter_rel < 1e-4
