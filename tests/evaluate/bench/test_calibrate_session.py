"""Calibration from several recorded sessions, with patches held out, and with a measured flat field."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from labcdp.calibration import Calibration, load, save
from labcdp.chain import ImagingChain, Optics, Sensor
from labcdp.core.errors import CalibrationError, InputError
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.core.vignetting import Cos4Vignetting
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.corrections import corrections_of
from labcdp.evaluate.bench.flat import UniformLight, require_same_optics
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.session import Session, SessionConfiguration
from labcdp.session.bench_tables import SpectraConfiguration

HEIGHT, WIDTH, COLUMNS, ROWS = 120, 200, 5, 2
LUMINANCES_CD_M2 = {f"P{i}": float(value) for i, value in enumerate(np.geomspace(1, 400, COLUMNS * ROWS))}
EXPOSURES_S = (0.002, 0.008, 0.032)
BLACK_DN, BITS = 64, 12
METER = MeterIdentity("LS-110", "73323007")
START = datetime(2026, 3, 1, 12, tzinfo=UTC)
#: Fall-off of a lens that is not the cos^4 of its focal length: a third more in the corners.
EXTRA_FALL_OFF = 0.3


def configuration(**changes) -> SessionConfiguration:
    height, width = HEIGHT // ROWS, WIDTH // COLUMNS
    document = {
        "name": "bench",
        "operator": "A. Müller",
        "camera": {"pixel_pitch_m": 4e-6},
        "lens": {"model": "Prime", "serial": "7", "focal_length_m": 0.002, "f_number": 2.8},
        "meter": {"model": "LS-110", "serial": "73323007"},
        "source": {"spectrum": "D65"},
        "target": {
            "name": "ten patches",
            "patch": [
                {
                    "name": f"P{i}",
                    "roi": [i % COLUMNS * width + 6, i // COLUMNS * height + 6, width - 12, height - 12],
                }
                for i in range(COLUMNS * ROWS)
            ],
        },
        "contrast": [{"bright": "P9", "dark": "P2", "contrast": 10.0, "epsilon": 0.5}],
        "plan": {},
    }
    return SessionConfiguration.model_validate(document | changes)


@dataclass(frozen=True)
class Camera:
    """A camera with noise, a fixed pattern and more fall-off than its lens should have."""

    serial: str = "1"
    gain_db: float = 0.0
    full_well_e: float = 30000.0

    @property
    def chain(self) -> ImagingChain:
        sensor = Sensor(
            pixel_pitch_m=4e-6,
            width=WIDTH,
            height=HEIGHT,
            quantum_efficiency=0.5,
            full_well_e=self.full_well_e,
            k_dn_per_e=0.2,
            read_noise_e=6.0,
            dark_current_e_s=20.0,
            bits=BITS,
            black_level_dn=float(BLACK_DN),
            prnu_rel=0.005,
            dsnu_e=2.0,
            dsnu_e_s=0.0,
            device_seed=5,
        )
        return ImagingChain("D65", None, Optics(2.8, 0.9, 0.002), sensor)

    def frame(self, scene_cd_m2, exposure_s, number):
        rate = 0.0
        if scene_cd_m2 is not None:
            y, x = np.mgrid[:HEIGHT, :WIDTH]
            r2 = ((x - (WIDTH - 1) / 2) ** 2 + (y - (HEIGHT - 1) / 2) ** 2) / (HEIGHT**2 + WIDTH**2) * 4
            rate = self.chain.electron_rate(scene_cd_m2) * (1 - EXTRA_FALL_OFF * r2)
        dn = self.chain.sensor.expose(
            rate, exposure_s, self.gain_db, temperature_c=35.0, seed=11, exposure_index=number, threads=1
        )
        return Frame(
            dn=dn,
            exposure_s=exposure_s,
            gain_db=self.gain_db,
            bit_depth=BITS,
            saturation_dn=2.0**BITS - 1,
            black_level_dn=BLACK_DN,
            pixel_format="Mono12",
            colour_filter=None,
            temperature_c=35.0,
            timestamp=START,
            camera_timestamp_ns=number,
            frame_id=number,
            camera=CameraIdentity("Acme", "Test", self.serial, simulated=True),
        )


def scene(luminances=LUMINANCES_CD_M2):
    grid = np.reshape(list(luminances.values()), (ROWS, COLUMNS))
    return np.kron(grid, np.ones((HEIGHT // ROWS, WIDTH // COLUMNS)))


def reading(value, seconds):
    return Reading(
        value=round(value, 2),
        unit="cd/m2",
        resolution=0.01,
        scale_half_width_rel=0.02,
        digits_half_width=0.02,
        repeatability_rel=0.002,
        peak=False,
        correction="preset",
        held=False,
        meter=METER,
        timestamp=START + timedelta(seconds=seconds),
        raw="",
    )


def record(path, camera=None, of=None, n=2, exposures_s=EXPOSURES_S, first=0, **changes):
    """Write a session; `of` is the scene, None for the ten patches, which are then read too."""
    camera = camera or Camera()
    rng = np.random.default_rng(first)
    whole = scene() if of is None else of
    number = first
    with Session.create(path, configuration(**changes)) as session:
        for role, what in (("light", whole), ("dark", None)):
            for exposure_s in exposures_s:
                for _ in range(n):
                    number += 1
                    session.add_frame(camera.frame(what, exposure_s, number), role)
        for i, (name, value) in enumerate(LUMINANCES_CD_M2.items()):
            for j in range(3):
                session.add_reading(reading(value * (1 + rng.normal(0, 0.002)), 10 * i + j + first), name)
    return path


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return record(tmp_path_factory.mktemp("bench") / "s")


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    """Frames of an even source in the place of the target."""
    even = np.full((HEIGHT, WIDTH), 150.0)
    return record(tmp_path_factory.mktemp("flat") / "s", of=even, n=24, exposures_s=(0.008,), first=500)


def deviations(calibration: Calibration) -> np.ndarray:
    rows = calibration.residuals
    return np.array([row.luminance_cd_m2 / LUMINANCES_CD_M2[row.patch.split(" ")[0]] - 1 for row in rows])


def observe(path, corrections=None):
    with Session.open(path) as session:
        return observe_session(session, corrections=corrections)


def test_a_measured_flat_field_takes_off_what_cos4_does_not_know(bench, flat, tmp_path):
    plain = calibrate_session(observe(bench))
    with Session.open(flat) as of_source, Session.open(bench) as session:
        require_same_optics(session, of_source)
        corrections = UniformLight.read(of_source, 0.002).corrections
        observed = observe_session(session, corrections=corrections)
        calibration = calibrate_session(observed)
        assert isinstance(calibration, Calibration)
        assert not isinstance(calibration.vignetting, Cos4Vignetting)
        # What is left is noise and the readings' scatter; without the flat field it is the fall-off, up to 20 %.
        assert np.abs(deviations(calibration)).max() < 0.01
        assert np.abs(deviations(plain)).max() > 0.03
        path = tmp_path / "calibration.json"
        save(calibration, path)
        again = load(path)
        seen = observe_session(session, corrections=corrections_of(again))
        result = evaluate_session(session, seen, again)
    for row in result.patches:
        low, high = row.calibrated.interval_95_cd_m2
        assert low < LUMINANCES_CD_M2[row.region.name] < high
    truth = LUMINANCES_CD_M2["P9"] / LUMINANCES_CD_M2["P2"] - 1
    (contrast,) = result.contrasts
    assert abs(contrast.camera_contrast - truth) < 3 * contrast.camera_standard_uncertainty


def test_a_flat_field_of_another_camera_or_lens_is_refused(bench, tmp_path):
    even = np.full((HEIGHT, WIDTH), 150.0)
    other = record(tmp_path / "other", Camera(serial="2"), of=even, exposures_s=(0.008,))
    stopped_down = {"model": "Prime", "serial": "7", "focal_length_m": 0.002, "f_number": 4.0}
    lens = record(tmp_path / "lens", of=even, exposures_s=(0.008,), lens=stopped_down)
    with Session.open(bench) as session:
        for path, what in ((other, "the camera of the flat field"), (lens, "the lens of the flat field")):
            with Session.open(path) as flat, pytest.raises(CalibrationError, match=what):
                require_same_optics(session, flat)


def test_sessions_with_two_gains_become_one_calibration(bench, tmp_path):
    first = observe(bench)
    second = observe(record(tmp_path / "s", Camera(gain_db=6.0), first=1000))
    alone, both = calibrate_session(first), calibrate_session(first, second)
    assert isinstance(both, Calibration)
    assert [gain.gain_db for gain in both.gains] == [6.0]
    assert both.gains[0].factor == pytest.approx(10 ** (6 / 20), abs=4 * both.gains[0].factor_random_rel * 2)
    assert {row.patch for row in both.residuals} >= {"P0", "P0 (2)", "P9 (2)"}
    # The fall-off it is not told stays; with it aside both say the same.
    assert both.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(
        alone.responsivity.responsivity_dn_s_cd_m2, rel=4 * both.responsivity.random_rel
    )
    assert both.provenance.input_sha256 not in (first.input_sha256, second.input_sha256)


def test_a_held_out_patch_is_predicted_and_not_fitted(bench, flat):
    with Session.open(flat) as of_source:
        observed = observe(bench, UniformLight.read(of_source, 0.002).corrections)
    calibration = calibrate_session(observed, held_out=["P4"])
    assert "P4" not in {row.patch for row in calibration.residuals}
    (row,) = calibration.held_out
    assert row.patch == "P4"
    assert row.luminance_cd_m2 == pytest.approx(LUMINANCES_CD_M2["P4"], rel=0.01)
    with pytest.raises(InputError, match="there is no patch 'P77' to hold out: choose from P0, P1"):
        calibrate_session(observed, held_out=["P77"])


def test_sessions_with_other_lens_or_light_are_not_joined(bench, tmp_path):
    first = observe(bench)
    for what, changes in (
        ("source spectrum", {"source": {"spectrum": "A"}}),
        ("lens", {"lens": {"model": "Prime", "serial": "8", "focal_length_m": 0.002, "f_number": 2.8}}),
    ):
        other = replace(first, configuration=configuration(name="other", **changes))
        with pytest.raises(CalibrationError, match=f"the {what} of session 'bench' is .*: calibrate them apart"):
            calibrate_session(first, other)


def test_two_different_spectra_of_one_name_are_not_joined(bench):
    first = observe(bench)
    lamps = []
    for peak_nm in (560, 570):
        lamp = SpectraConfiguration(
            file="lamp.csv", sha256="0", wavelength_nm=(380, peak_nm, 780), columns={"relative": (0, 1, 0)}
        )
        source = first.configuration.source.model_copy(update={"spectrum_file": lamp})
        lamps.append(replace(first, configuration=first.configuration.model_copy(update={"source": source})))
    assert calibrate_session(lamps[0], lamps[0]).measured_spectrum == lamps[0].configuration.source.measured
    for other in (first, lamps[1]):
        with pytest.raises(CalibrationError, match=r"different measured spectra of the light .*: calibrate them apart"):
            calibrate_session(lamps[0], other)


def test_a_camera_that_is_full_before_its_converter_ends_is_refused(tmp_path):
    """20 000 e- are 4064 DN, of 4095."""
    observed = observe(record(tmp_path / "s", Camera(full_well_e=20000.0)))
    with pytest.raises(
        CalibrationError,
        match=r"the signal stays at 4064 DN with more light \(patches 'P7' at 0\.032 s, .*\): the camera saturates "
        r"there, below the 4095 DN that count as saturated; record with exposures at which no patch comes near that",
    ):
        calibrate_session(observed)
