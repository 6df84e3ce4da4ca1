"""One small simulated session, evaluated: six patches, some with names that are out to do harm."""

from dataclasses import replace
from pathlib import Path

import pytest

from labcdp.acquire import acquire
from labcdp.core.reading import MeterIdentity
from labcdp.core.result import Result
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.report.page import write_results
from labcdp.evaluate.bench.report.result import session_result
from labcdp.evaluate.bench.session import SessionEvaluation, evaluate_session
from labcdp.session import Session, SessionConfiguration

HOSTILE_NAMES = ("<b>bold</b>", "=1+1", "$\\frac{1}$", '"><img src=x onerror=alert(1)>', "{{ 7 * 7 }}", "grey & \u7070")

_BENCH = """
name = "Test <i>session</i>"
operator = "=cmd()"
notes = "A note with </style> in it."
[camera]
pixel_pitch_m = 3.45e-6
[lens]
model = "Kowa LM6NCL"
serial = "12345"
focal_length_m = 6e-3
f_number = 2.6
[meter]
model = "LS-110"
serial = "SIM-1"
calibration_date = 2026-03-02
[source]
spectrum = "D65"
[plan]
exposures_s = [0.002, 0.02]
frames_per_exposure = 2
readings_per_patch = 2
[guess]
quantum_efficiency = 0.4
k_dn_per_e = 0.41
f_number = 2.6
transmittance = 0.9
pixel_pitch_m = 3.45e-6
dark_dn = 64.0
[[contrast]]
bright = "<b>bold</b>"
dark = "=1+1"
contrast = 0.98
epsilon = 0.03
[[contrast]]
bright = "<b>bold</b>"
dark = "$\\\\frac{1}$"
contrast = 3.0
epsilon = 0.25
[target]
name = "Six <em>patches</em>"
"""


def _configuration() -> SessionConfiguration:
    patches = []
    for i, name in enumerate(HOSTILE_NAMES):
        x, y = 20 + 90 * (i % 3), 20 + 90 * (i // 3)
        escaped = name.replace("\\", "\\\\").replace('"', '\\"')
        patches.append(
            f'[[target.patch]]\nname = "{escaped}"\nroi = [{x}, {y}, 50, 50]\nnominal_luminance_cd_m2 = {40 / 2**i}\n'
        )
    return SessionConfiguration.from_toml(_BENCH + "\n".join(patches), "the tests' bench")


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session recorded on the simulated bench."""
    configuration = _configuration()
    bench = SimulatedBench(configuration, BenchDevices.standard(seed=1), sensor_shape=(200, 300))
    identity = MeterIdentity("LS-110", configuration.meter.serial, "2026-03-02", simulated=True)
    path = tmp_path_factory.mktemp("report") / "session"
    with (
        Session.create(path, configuration) as session,
        bench.in_process_camera() as camera,
        bench.pty_meter(0.0) as pty,
        MinoltaLS110(pty.port, identity) as meter,
    ):
        acquire(session, camera, meter, bench)
    return path


@pytest.fixture(scope="session")
def evaluation(recorded: Path) -> SessionEvaluation:
    """Its evaluation."""
    with Session.open(recorded) as session:
        observed = observe_session(session)
        return evaluate_session(session, observed, calibrate_session(observed))


@pytest.fixture(scope="session")
def real_evaluation(evaluation: SessionEvaluation) -> SessionEvaluation:
    """The same numbers as if no device had been simulated."""
    calibration = evaluation.calibration
    camera = replace(calibration.state.camera, simulated=False)
    meter = replace(calibration.meter_scale.meter, simulated=False)
    calibration = replace(
        calibration,
        state=replace(calibration.state, camera=camera),
        meter_scale=replace(calibration.meter_scale, meter=meter),
    )
    return replace(evaluation, calibration=calibration)


@pytest.fixture(scope="session")
def result(evaluation: SessionEvaluation) -> Result:
    """The evaluation as one result."""
    return session_result(evaluation)


@pytest.fixture(scope="session")
def written(evaluation: SessionEvaluation, result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the results of the evaluation."""
    folder = tmp_path_factory.mktemp("results")
    write_results(evaluation, result, folder)
    return folder
