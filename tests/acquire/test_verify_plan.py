"""The plan of a verification: few patches, calibrated exposures, nothing saturated."""

import pytest

from labcdp.acquire.verify_plan import verification_configuration
from labcdp.core.errors import InputError
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.session import SessionConfiguration


@pytest.fixture(scope="module")
def calibration(example):
    return calibrate_session(observe_session(example))


def test_darkest_middle_and_brightest_with_headroom(example, calibration):
    plan = verification_configuration(example.configuration, calibration)
    of = {row.patch: row.reading_cd_m2 for row in calibration.residuals}
    names = {patch.name for patch in plan.target.patches}
    assert len(names) == 3
    assert {min(of, key=of.get), max(of, key=of.get)} <= names <= set(of)
    assert set(plan.plan.exposures_s) <= set(calibration.exposures_s)
    # It can be written, read, and be the plan of a session.
    assert SessionConfiguration.from_toml(plan.to_toml(), "test") == plan
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    for name, cd_m2 in of.items():
        plan = verification_configuration(example.configuration, calibration, [name])
        (exposure_s,) = plan.plan.exposures_s
        assert calibration.dark.mean_dn(exposure_s) + r * exposure_s * cd_m2 < 0.92 * 4095
        assert [patch.name for patch in plan.target.patches] == [name]


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
