import shutil
from dataclasses import replace

import numpy as np
import pytest

import labcdp
from labcdp.acquire import acquire
from labcdp.core.errors import CalibrationError, InputError, SessionError
from labcdp.core.finding import warning
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.report.result import session_result
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.report.envelope import envelope_json
from labcdp.session import (
    ContrastConfiguration,
    Session,
    SourceConfiguration,
)
from labcdp.session.bench_tables import SpectraConfiguration

THESIS = {"upper right": 75.6, "upper left": 356.0, "lower right": 33.6, "lower left": 412.0}


def record(path, configuration, devices, shape=None):
    bench = SimulatedBench(configuration, devices, shape)
    with (
        Session.create(path, configuration) as session,
        bench.in_process_camera() as camera,
        bench.pty_meter(0) as pty,
        MinoltaLS110(pty.port) as meter,
    ):
        acquire(session, camera, meter, bench)
    return bench


def test_every_patch_lies_within_its_interval(evaluation):
    """The example's meter reads 0.6 % too much, inside its 2 %: the intervals must hold the simulated truth."""
    nominal = {p.name: p.nominal_luminance_cd_m2 for p in evaluation.observed.configuration.target.patches}
    assert len(nominal) == 16
    assert {name: nominal[name] for name in THESIS} == THESIS
    for row in evaluation.patches:
        low, high = row.calibrated.interval_95_cd_m2
        assert low < nominal[row.region.name] < high


def test_the_cdp_is_that_of_all_pairs(recorded, evaluation):
    """Brute force over a part of the pixels' pairs, in the frame the result names."""
    for row in evaluation.contrasts:
        frame = recorded.load(next(r for r in recorded.frames() if r.number == row.frame_number))
        assert frame.exposure_s == row.exposure_s
        seen = evaluation.calibration.to_luminance(frame).luminance_cd_m2
        regions = {r.region.name: r.region for r in evaluation.patches}
        bright, dark = (regions[name].select(seen) for name in (row.bright, row.dark))
        assert row.cdp.cdp == labcdp.cdp(bright, dark, row.cdp.contrast, row.cdp.epsilon).cdp
        contrast = bright[:, None] / dark[None, :] - 1
        low, high = row.cdp.interval
        assert row.cdp.cdp == pytest.approx(np.mean((contrast >= low) & (contrast <= high)), abs=1e-9)


def test_the_guess_is_wrong_as_in_the_thesis(evaluation):
    """The guessed K of 0.41 DN/e- instead of 0.6 makes the calculated luminance about 46 % too high."""
    for row in evaluation.patches:
        if row.region.name in THESIS:
            assert 1.33 < row.calculated_cd_m2 / row.measured_cd_m2 < 1.52


def test_results_can_be_written_as_json_and_are_repeated_exactly(recorded, evaluation):
    observed = observe_session(recorded)
    again = evaluate_session(recorded, observed, calibrate_session(observed))
    assert envelope_json(session_result(again)) == envelope_json(session_result(evaluation))
    assert evaluation.simulated == ["camera Manta_G-505B", "luminance meter LS-110", "target"]


def other(observed, **changes):
    """The observed session with another configuration."""
    return replace(observed, configuration=observed.configuration.model_copy(update=changes))


def test_another_lens_or_f_number_is_refused(recorded, observed, evaluation):
    lens = observed.configuration.lens.model_copy(update={"f_number": 4.0})
    with pytest.raises(CalibrationError, match=r"for the lens .*f/2\.6\), the frame was taken with .*f/4\)"):
        evaluate_session(recorded, other(observed, lens=lens), evaluation.calibration)


def test_another_light_is_warned_about(recorded, observed, evaluation):
    source = observed.configuration.source.model_copy(update={"spectrum": "A"})
    result = evaluate_session(recorded, other(observed, source=source), evaluation.calibration)
    assert result.findings[0] == warning("light-differs", calibrated="D65", measured="A")


def test_a_light_that_was_measured_is_another_than_one_of_the_same_name(recorded, observed, evaluation):
    spectrum = {
        "file": "lamp.csv",
        "sha256": "0" * 64,
        "wavelength_nm": (380.0, 780.0),
        "columns": {"lamp": (1.0, 2.0)},
    }
    configuration = observed.configuration
    lamp = SourceConfiguration(spectrum=configuration.source.spectrum, spectrum_file=spectrum)
    changed = replace(observed, configuration=configuration.model_copy(update={"source": lamp}))
    result = evaluate_session(recorded, changed, evaluation.calibration)
    assert "light-differs" in {one.code for one in result.findings}
    with_sensitivity = configuration.camera.model_copy(
        update={"spectral_sensitivity": SpectraConfiguration(**(spectrum | {"columns": {"relative": (1.0, 1.0)}}))}
    )
    known = changed.configuration.model_copy(update={"camera": with_sensitivity})
    result = evaluate_session(recorded, replace(changed, configuration=known), evaluation.calibration)
    assert "light-differs-by" in {one.code for one in result.findings}


def test_bright_and_dark_the_wrong_way_round_are_refused(recorded, observed, evaluation):
    pair = ContrastConfiguration(bright="lower right", dark="upper left", contrast=10.0)
    with pytest.raises(InputError, match="patch 'lower right' is darker than 'upper left'"):
        evaluate_session(recorded, observed, evaluation.calibration, [pair])


def test_a_missing_frame_is_named(recorded, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(recorded.path, copy)
    next(iter(sorted((copy / "frames").iterdir()))).unlink()
    with Session.open(copy) as session, pytest.raises(SessionError, match=r"0001_light_2ms\.tif"):
        observe_session(session)


@pytest.fixture
def overexposed(small_configuration, tmp_path):
    plan = small_configuration.plan.model_copy(update={"exposures_s": (0.004, 0.008, 0.016)})
    record(tmp_path / "s", small_configuration.model_copy(update={"plan": plan}), BenchDevices.standard(), (400, 480))
    with Session.open(tmp_path / "s") as session:
        yield session


def test_a_saturated_patch_is_named_and_can_be_left_out(overexposed):
    observed = observe_session(overexposed)
    with pytest.raises(
        CalibrationError, match=r"patch '(upper|lower) left' cannot be used at any exposure .*saturated.*--without"
    ):
        calibrate_session(observed)
    without = ["upper left", "lower left", "P12"]
    observed = observe_session(overexposed, without)
    calibration = calibrate_session(observed)
    assert {row.patch for row in calibration.residuals}.isdisjoint(without)
    with pytest.raises(InputError, match=r"no patch 'upper left' for the contrast.*may have been left out"):
        evaluate_session(overexposed, observed, calibration)


def test_another_black_level_is_refused(observed, evaluation):
    plane = observed.monochrome
    patches = {
        name: [replace(o, state=replace(o.state, black_level_dn=128.0)) for o in group]
        for name, group in plane.patches.items()
    }
    with pytest.raises(CalibrationError, match=r"black level of .* is 128 DN, but .* has 64 DN"):
        calibrate_session(replace(observed, planes={None: replace(plane, patches=patches)}))
