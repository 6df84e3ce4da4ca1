"""The example session with six patches, whose names are out to do harm, evaluated and written."""

import pytest

from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.evaluate.bench.session_page import write_results
from labcdp.evaluate.bench.session_result import session_result
from labcdp.session import ContrastConfiguration, Session

from ..synthetic import again

NAMES = {
    "upper left": "<b>bold</b>",
    "lower right": "=1+1",
    "upper right": "$\\frac{1}$",
    "P09": '"><img src=x onerror=alert(1)>',
    "P02": "{{ 7 * 7 }}",
    "P04": "grey & \u7070",
}


@pytest.fixture(scope="session")
def recorded(recorded, tmp_path_factory):
    target = recorded.configuration.target
    patches = [patch.model_copy(update={"name": NAMES[patch.name]}) for patch in target.patches if patch.name in NAMES]
    pairs = (("lower right", 9.6, 0.03), ("upper right", 3.0, 0.25))
    changes = {
        "name": "Test <i>session</i>",
        "operator": "=cmd()",
        "notes": "A note with </style> in it.",
        "target": target.model_copy(update={"name": "Six <em>patches</em>", "patches": tuple(patches)}),
        "contrasts": tuple(
            ContrastConfiguration(bright="<b>bold</b>", dark=NAMES[dark], contrast=contrast, epsilon=epsilon)
            for dark, contrast, epsilon in pairs
        ),
    }
    path = tmp_path_factory.mktemp("report") / "session"
    again(path, recorded, lambda frames: [(*one, None) for one in frames], NAMES, **changes)
    with Session.open(path) as session:
        yield session


@pytest.fixture(scope="session")
def evaluation(recorded):
    observed = observe_session(recorded)
    return evaluate_session(recorded, observed, calibrate_session(observed))


@pytest.fixture(scope="session")
def result(evaluation):
    return session_result(evaluation)


@pytest.fixture(scope="session")
def written(evaluation, result, tmp_path_factory):
    """Folder with the results of the evaluation."""
    folder = tmp_path_factory.mktemp("results")
    write_results(evaluation, result, folder)
    return folder
