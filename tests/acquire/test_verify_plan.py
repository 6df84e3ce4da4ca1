"""The plan of a verification: few patches, calibrated exposures, nothing saturated."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.acquire.verify_plan import verification_configuration
from labcdp.calibration import ColourCalibration
from labcdp.core.errors import InputError
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.session import SessionConfiguration


@pytest.fixture(scope="module")
def calibration(example):
    return calibrate_session(observe_session(example))


def luminance(residuals):
    return {row.patch: row.reading_cd_m2 for row in residuals}


def assert_darkest_and_brightest(plan, of, exposures_s):
    names = {patch.name for patch in plan.target.patches}
    assert len(names) == 3
    assert {min(of, key=of.get), max(of, key=of.get)} <= names <= set(of)
    assert set(plan.plan.exposures_s) <= set(exposures_s)


def test_darkest_middle_and_brightest(example, calibration):
    plan = verification_configuration(example.configuration, calibration)
    assert_darkest_and_brightest(plan, luminance(calibration.residuals), calibration.exposures_s)
    # It can be written, read, and be the plan of a session.
    assert SessionConfiguration.from_toml(plan.to_toml(), "test") == plan


def test_exposures_leave_headroom(example, calibration):
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    for name, cd_m2 in luminance(calibration.residuals).items():
        plan = verification_configuration(example.configuration, calibration, [name])
        (exposure_s,) = plan.plan.exposures_s
        assert calibration.dark.mean_dn(exposure_s) + r * exposure_s * cd_m2 < 0.92 * 4095
        assert [patch.name for patch in plan.target.patches] == [name]


@pytest.fixture(scope="module")
def colour(calibration):
    """Planes of which blue sees a fifth of the light; the darkest and the brightest patch are no grey ones for them."""
    darkest, *greys, brightest = sorted(calibration.residuals, key=lambda row: row.reading_cd_m2)
    r, state = calibration.responsivity, calibration.state
    planes = tuple(
        replace(
            calibration,
            state=replace(state, plane=plane, image_shape=tuple(n // 2 for n in state.image_shape)),
            residuals=tuple(greys),
            vignetting=None,
            responsivity=replace(r, responsivity_dn_s_cd_m2=r.responsivity_dn_s_cd_m2 * share),
        )
        for plane, share in {"R": 1.0, "Gr": 1.0, "Gb": 1.0, "B": 0.2}.items()
    )
    return ColourCalibration(
        planes=planes, weights=(0.25, 0.4, 0.4, -0.05), weight_covariance=tuple(map(tuple, 1e-6 * np.eye(4))),
        spectral_rel=0.0, scatter_rel=0.0, range_cd_m2=calibration.range_cd_m2,
        residuals=(darkest, *greys, brightest), held_out=(), left_out=(), ladder=(), sensitivity=None, f1_prime=None,
        findings=(),
    )  # fmt: skip


def test_grey_patches_come_first_and_every_plane_has_its_exposure(example, colour):
    greys = luminance(colour.planes[0].residuals)
    plan = verification_configuration(example.configuration, colour)
    assert_darkest_and_brightest(plan, greys, colour.exposures_s)
    name = max(greys, key=greys.get)
    plan = verification_configuration(example.configuration, colour, [name])
    for plane in colour.planes:
        full_dn = plane.responsivity.responsivity_dn_s_cd_m2 * greys[name]
        fitting = [t for t in colour.exposures_s if full_dn * t + plane.dark.mean_dn(t) <= 0.9 * 4095]
        assert max(fitting) in plan.plan.exposures_s


def test_patches_of_unknown_or_too_high_luminance(example, calibration):
    def planned(nominal_cd_m2, *names):
        first, *_ = (configuration := example.configuration).target.patches
        other = first.model_copy(update={"name": "other", "nominal_luminance_cd_m2": nominal_cd_m2})
        target = configuration.target.model_copy(update={"patches": (first, other) if names else (other,)})
        return verification_configuration(configuration.model_copy(update={"target": target}), calibration, names)

    # Seen at all exposures.
    assert planned(None, "other").plan.exposures_s == calibration.exposures_s
    for nominal_cd_m2, names in [(None, []), (None, ["none"]), (None, ["P01", "P01"]), (1e9, ["other"])]:
        with pytest.raises(InputError):
            planned(nominal_cd_m2, *names)
