"""The plan of a verification: few patches, calibrated exposures, nothing saturated."""

from dataclasses import replace

import pytest

from labcdp.acquire.verify_plan import verification_configuration
from labcdp.calibration import ColourCalibration
from labcdp.core.errors import InputError
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.session import Session, SessionConfiguration, example_session


@pytest.fixture(scope="module")
def recorded():
    with Session.open(example_session()) as session:
        yield session


@pytest.fixture(scope="module")
def calibration(recorded):
    return calibrate_session(observe_session(recorded))


def test_darkest_middle_and_brightest(recorded, calibration):
    plan = verification_configuration(recorded.configuration, calibration)
    luminance = {row.patch: row.reading_cd_m2 for row in calibration.residuals}
    names = {patch.name for patch in plan.target.patches}
    assert len(names) == 3
    assert {min(luminance, key=luminance.get), max(luminance, key=luminance.get)} <= names
    assert plan.contrasts == ()
    assert set(plan.plan.exposures_s) <= set(calibration.exposures_s)
    # It can be written, read, and be the plan of a session.
    assert SessionConfiguration.from_toml(plan.to_toml(), "test") == plan


def test_exposures_leave_headroom(recorded, calibration):
    luminance = {row.patch: row.reading_cd_m2 for row in calibration.residuals}
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    for name in luminance:
        plan = verification_configuration(recorded.configuration, calibration, [name])
        (exposure_s,) = plan.plan.exposures_s
        assert calibration.dark.mean_dn(exposure_s) + r * exposure_s * luminance[name] < 0.92 * 4095
        assert [patch.name for patch in plan.target.patches] == [name]


def test_a_patch_of_unknown_luminance_is_seen_at_all_exposures(recorded, calibration):
    configuration = recorded.configuration
    first = configuration.target.patches[0]
    new = first.model_copy(update={"name": "new", "nominal_luminance_cd_m2": None})
    target = configuration.target.model_copy(update={"patches": (new,)})
    changed = configuration.model_copy(update={"target": target})
    plan = verification_configuration(changed, calibration, ["new"])
    assert plan.plan.exposures_s == calibration.exposures_s
    with pytest.raises(InputError, match="no patch of the configuration is known to lie within the calibrated range"):
        verification_configuration(changed, calibration)


@pytest.fixture(scope="module")
def colour(calibration):
    """Planes of which blue sees a fifth of the light; the darkest and the brightest patch are no grey ones for them."""
    darkest, *greys, brightest = sorted(calibration.residuals, key=lambda row: row.reading_cd_m2)
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    planes = tuple(
        replace(
            calibration,
            state=replace(
                calibration.state, plane=plane, image_shape=tuple(n // 2 for n in calibration.state.image_shape)
            ),
            residuals=tuple(greys),
            vignetting=None,
            responsivity=replace(calibration.responsivity, responsivity_dn_s_cd_m2=r * (0.2 if plane == "B" else 1.0)),
        )
        for plane in ("R", "Gr", "Gb", "B")
    )
    rows = tuple(tuple(1e-6 * (i == j) for j in range(4)) for i in range(4))
    return ColourCalibration(
        planes=planes,
        weights=(0.25, 0.4, 0.4, -0.05),
        weight_covariance=rows,
        spectral_rel=0.0,
        scatter_rel=0.0,
        range_cd_m2=calibration.range_cd_m2,
        residuals=(darkest, *greys, brightest),
        held_out=(),
        left_out=(),
        ladder=(),
        sensitivity=None,
        f1_prime=None,
        findings=(),
    )


def test_grey_patches_come_first_and_every_plane_has_its_exposure(recorded, colour):
    greys = {row.patch: row.reading_cd_m2 for row in colour.planes[0].residuals}
    plan = verification_configuration(recorded.configuration, colour)
    names = {patch.name for patch in plan.target.patches}
    assert len(names) == 3
    assert {min(greys, key=greys.get), max(greys, key=greys.get)} <= names <= set(greys)
    assert set(plan.plan.exposures_s) <= set(colour.exposures_s)
    name = max(greys, key=greys.get)
    plan = verification_configuration(recorded.configuration, colour, [name])
    for plane in colour.planes:
        full_dn = plane.responsivity.responsivity_dn_s_cd_m2 * greys[name]
        fitting = [t for t in colour.exposures_s if full_dn * t + plane.dark.mean_dn(t) <= 0.9 * 4095]
        assert max(fitting) in plan.plan.exposures_s


def test_refusals(recorded, calibration):
    name = recorded.configuration.target.patches[0].name
    with pytest.raises(InputError, match="there is no patch 'none' to verify with: choose from P01"):
        verification_configuration(recorded.configuration, calibration, ["none"])
    with pytest.raises(InputError, match=f"patch '{name}' is given twice"):
        verification_configuration(recorded.configuration, calibration, [name, name])
    bright = recorded.configuration.target.patches[0].model_copy(update={"name": "sun", "nominal_luminance_cd_m2": 1e9})
    target = recorded.configuration.target.model_copy(update={"patches": (bright,)})
    changed = recorded.configuration.model_copy(update={"target": target})
    with pytest.raises(InputError, match=r"patch 'sun' has about 1e\+09 cd/m\^2, for which no calibrated exposure"):
        verification_configuration(changed, calibration, ["sun"])
