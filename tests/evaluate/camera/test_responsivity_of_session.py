"""The responsivity of a session is one number, by whatever command."""

import pytest

from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.camera.characterise import characterise_session
from labcdp.session import Session, example_session


def test_it_is_that_of_the_calibration():
    session = Session.open(example_session())
    calibration = calibrate_session(observe_session(session))
    found = characterise_session(session).responsivity
    fitted = calibration.responsivity
    # Hot pixels are left out by the calibration only.
    assert found.value == pytest.approx(fitted.responsivity_dn_s_cd_m2, rel=0.2 * fitted.random_rel)
    u_rel = (fitted.random_rel**2 + calibration.meter_scale.common_rel**2) ** 0.5
    assert found.u / found.value == pytest.approx(u_rel, rel=0.02)
