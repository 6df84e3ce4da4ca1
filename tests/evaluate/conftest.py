import pytest

from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.session import Session, example_session


@pytest.fixture(scope="session")
def recorded():
    with Session.open(example_session()) as session:
        yield session


@pytest.fixture(scope="session")
def observed(recorded):
    return observe_session(recorded)


@pytest.fixture(scope="session")
def calibration(observed):
    return calibrate_session(observed)


@pytest.fixture(scope="session")
def evaluation(observed, calibration):
    return evaluate_session(observed, calibration)
