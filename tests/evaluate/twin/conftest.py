"""The twin of the example session."""

import pytest

from labcdp.evaluate.camera.characterise import characterise_session
from labcdp.evaluate.twin.evaluate import twin_session


@pytest.fixture(scope="session")
def characterisation(recorded):
    return characterise_session(recorded)


@pytest.fixture(scope="session")
def twin(recorded, observed, calibration, characterisation):
    return twin_session(observed, calibration, characterisation)
