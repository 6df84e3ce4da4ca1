"""Calibration from several recorded sessions, with patches held out, with a flat field, and for parts of the sensor."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import contrast_u, load, save
from labcdp.calibration.bracket import bracket_luminance
from labcdp.chain import ImagingChain, Optics, Sensor
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import Readout
from labcdp.core.vignetting import Cos4Vignetting
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.corrections import UniformLight, require_same_optics
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.recorded import configured_lens
from labcdp.evaluate.bench.session import evaluate_session, observe_calibrated
from labcdp.evaluate.bench.verification import verify_session
from labcdp.session import Session

from .synthetic import CAMERA, configuration, exposed, record

HEIGHT, WIDTH, COLUMNS, ROWS = 120, 200, 5, 2
Y, X = np.mgrid[:HEIGHT, :WIDTH]
LUMINANCES_CD_M2 = {f"P{i}": float(value) for i, value in enumerate(np.geomspace(1, 400, COLUMNS * ROWS))}
SCENE = np.kron(np.reshape([*LUMINANCES_CD_M2.values()], (ROWS, COLUMNS)), np.ones((HEIGHT // ROWS, WIDTH // COLUMNS)))
EVEN = np.full((HEIGHT, WIDTH), 150.0)
ROIS = {f"P{i}": [i % COLUMNS * 40 + 6, i // COLUMNS * 60 + 6, 28, 48] for i in range(COLUMNS * ROWS)}
CONTRAST = {"bright": "P9", "dark": "P2", "contrast": 10.0, "epsilon": 0.5}
LENS = {"model": "Prime", "serial": "7", "focal_length_m": 0.002, "f_number": 2.8}
#: Vignetting of a lens that is not the cos^4 of its focal length: a third more in the corners.
EXTRA = 1 - 0.3 * ((X - (WIDTH - 1) / 2) ** 2 + (Y - (HEIGHT - 1) / 2) ** 2) / (HEIGHT**2 + WIDTH**2) * 4
#: Of a wide lens there are left 0.44 of the light in the corners; a part without the first column of patches.
WIDE, WHOLE, PART = LENS | {"focal_length_m": 0.00066}, np.s_[:HEIGHT, :WIDTH], np.s_[4:HEIGHT, 40:WIDTH]


def bench_of(path, of=SCENE, n=2, exposures_s=(0.002, 0.008, 0.032), first=0, window=WHOLE, sensor=None, seen=None,
             **changes):  # fmt: skip
    """Write a session of the ten patches, or of another scene, by a camera with more vignetting than its lens has."""
    lens = changes.setdefault("lens", LENS)
    made = {
        "pixel_pitch_m": 4e-6, "quantum_efficiency": 0.5, "full_well_e": 3e4, "k_dn_per_e": 0.2, "read_noise_e": 6.0,
        "dark_current_e_s": 20.0, "bits": 12, "black_level_dn": 64.0, "prnu_rel": 0.005, "dsnu_e": 2.0,
        "dsnu_e_s": 0.0, "device_seed": 5, "width": WIDTH, "height": HEIGHT,
    }  # fmt: skip
    camera = Sensor(**made | (sensor or {}))
    optics = Optics(lens["f_number"], 0.9, lens["focal_length_m"])
    light = (ImagingChain("D65", None, optics, camera).electron_rate(of) * EXTRA)[window]
    camera = replace(camera, width=light.shape[1], height=light.shape[0])
    top, left = (part.start or 0 for part in window)
    rois = {name: [x - left, y - top, w, h] for name, (x, y, w, h) in ROIS.items() if x > left}
    frames = exposed(camera, light, exposures_s, n, first, **(seen or {}))
    bench = configuration(rois, **{"contrast": [CONTRAST] if window is WHOLE else [], **changes})
    return record(path, bench, frames, {name: LUMINANCES_CD_M2[name] for name in rois}, first, first)


def observe(path, corrections=None):
    with Session.open(path) as session:
        return observe_session(session, corrections=corrections)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return bench_of(tmp_path_factory.mktemp("bench") / "s")


@pytest.fixture(scope="module")
def observed(bench):
    return observe(bench)


@pytest.fixture(scope="module")
def corrections(tmp_path_factory, bench):
    """By frames of an even source in the place of the target."""
    path = bench_of(tmp_path_factory.mktemp("flat") / "s", of=EVEN, n=24, exposures_s=(0.008,), first=500)
    with Session.open(path) as flat, Session.open(bench) as session:
        require_same_optics(session, flat)
        return UniformLight.read(flat, 0.002).corrections


def deviations(calibration):
    return [row.luminance_cd_m2 / LUMINANCES_CD_M2[row.patch] - 1 for row in calibration.residuals]


def evaluated(path, calibration):
    """Evaluation of a session, each of whose patches must lie in its interval."""
    with Session.open(path) as session:
        result = evaluate_session(*observe_calibrated(session, calibration))
    for row in result.patches:
        low, high = row.calibrated.interval_95_cd_m2
        assert low < LUMINANCES_CD_M2[row.region.name] < high
    return result


def test_a_measured_flat_field_takes_off_what_cos4_does_not_know(bench, observed, corrections, tmp_path):
    plain, calibration = calibrate_session(observed), calibrate_session(observe(bench, corrections))
    assert not isinstance(calibration.vignetting, Cos4Vignetting)
    # What is left is noise and the readings' scatter; without the flat field the patches show it, up to 20 %.
    assert np.abs(deviations(calibration)).max() < 0.01
    assert np.abs(deviations(plain)).max() < 0.01
    assert abs(plain.vignetting.log_corner) > 0.03
    save(calibration, tmp_path / "calibration.json")
    (contrast,) = evaluated(bench, load(tmp_path / "calibration.json")).contrasts
    truth = LUMINANCES_CD_M2["P9"] / LUMINANCES_CD_M2["P2"] - 1
    seen = contrast.bright.calibrated, contrast.dark.calibrated
    assert abs(contrast.camera_contrast - truth) < 3 * contrast_u(*seen)


def test_sessions_with_two_gains_become_one_calibration(observed, tmp_path):
    second = observe(bench_of(tmp_path / "s", first=1000, seen={"gain_db": 6.0}))
    alone, both = calibrate_session(observed), calibrate_session(observed, second)
    (gain,) = both.gains
    assert (gain.gain_db, gain.factor) == (6.0, pytest.approx(10 ** (6 / 20), abs=8 * gain.factor_random_rel))
    assert {row.patch for row in both.residuals} >= {"P0", "P0 (2)", "P9 (2)"}
    # The vignetting it is not told stays; with it aside both say the same.
    r, r_alone = both.responsivity.responsivity_dn_s_cd_m2, alone.responsivity.responsivity_dn_s_cd_m2
    assert r == pytest.approx(r_alone, rel=4 * both.responsivity.random_rel)
    assert both.provenance.input_sha256 not in (observed.input_sha256, second.input_sha256)


@pytest.mark.parametrize("full_well_e", [20000.0, 8000.0])
def test_a_camera_that_is_full_before_its_converter_ends_is_used_below(full_well_e, corrections, tmp_path):
    """20 000 e- are 4064 DN, of 4095; 8000 e- are 1664 DN. A patch that was held out is predicted."""
    path = bench_of(tmp_path / "s", sensor={"full_well_e": full_well_e})
    calibration = calibrate_session(observe(path, corrections), held_out=["P4"])
    (row,) = calibration.held_out
    assert (row.patch, row.luminance_cd_m2) == ("P4", pytest.approx(LUMINANCES_CD_M2["P4"], rel=0.01))
    (finding,) = (one for one in calibration.findings if one.code == "full-below-saturation")
    assert finding.values["level_dn"] == pytest.approx(64 + 0.2 * full_well_e, abs=1)
    assert calibration.state.saturation_dn == pytest.approx(64 + 0.18 * full_well_e, abs=1)
    assert np.abs(deviations(calibration)).max() < 0.01
    assert "patch-contradicts" not in {one.code for one in calibration.findings}
    evaluated(path, calibration)
    with Session.open(path) as session:
        bracket = bracket_luminance(calibration, [session.load(record) for record in session.frames("light")]).map
    assert np.median(np.abs(bracket.luminance_cd_m2 / SCENE - 1)[bracket.invalid == 0]) < 0.02


def test_calibration_of_the_whole_sensor_measures_a_part_of_it_and_no_other_part(tmp_path):
    def of(name, first, window=WHOLE, at=(0, 0)):
        readout = Readout(*at, sensor_size=(WIDTH, HEIGHT))
        # Without more vignetting than the lens has.
        of = {"of": SCENE / EXTRA, "lens": WIDE, "window": window, "seen": {"readout": readout}}
        return bench_of(tmp_path / name, n=6, first=first, **of)

    whole, part, corner = of("whole", 1), of("part", 2000, PART, (40, 4)), of("corner", 3000, PART)
    calibration = calibrate_session(observe(whole))
    rows = {row.region.name: row.calibrated.luminance_cd_m2 for row in evaluated(part, calibration).patches}
    assert rows == pytest.approx({name: LUMINANCES_CD_M2[name] for name in rows}, rel=0.01)
    of_part = calibrate_session(observe(part))
    # The axis is beside the middle of the part.
    r = of_part.responsivity.responsivity_dn_s_cd_m2
    assert r == pytest.approx(calibration.responsivity.responsivity_dn_s_cd_m2, rel=0.005)
    message = "of the calibration is column 40, row 4, .* has column 0, row 0"
    with Session.open(part) as session, Session.open(corner) as other:
        assert verify_session(session, calibration)[0].verdict == "conform"
        for refused in (lambda: evaluated(corner, of_part), lambda: verify_session(other, of_part)):
            with pytest.raises(CalibrationError, match=message):
                refused()
        with pytest.raises(CalibrationError, match="of the flat field's session is column 0, row 0"):
            require_same_optics(session, other)


def test_what_does_not_fit_together_is_refused(bench, observed, tmp_path):
    for what, changes in (
        ("camera", {"seen": {"camera": replace(CAMERA, serial="2")}}),
        ("lens", {"lens": LENS | {"f_number": 4.0}}),
    ):
        path = bench_of(tmp_path / what, of=EVEN, exposures_s=(0.008,), **changes)
        refused = pytest.raises(CalibrationError, match=f"the {what} of the flat field")
        with Session.open(bench) as session, Session.open(path) as flat, refused:
            require_same_optics(session, flat)
    for changes, what in (
        ({"source": {"spectrum": "A"}}, "the source spectrum of session 'bench' is"),
        ({"lens": LENS | {"serial": "8"}}, "the lens of session 'bench' is"),
    ):
        other = replace(observed, configuration=configuration(ROIS, **{"name": "other"} | changes))
        with pytest.raises(CalibrationError, match=f"{what} .*: calibrate them"):
            calibrate_session(observed, other)


@pytest.mark.parametrize("focus", [{}, {"focus_distance_m": 0.5}])
def test_a_lens_without_a_serial_number_may_be_the_same(observed, focus):
    """No serial number leaves no hole in the name of the lens, and is none that is another."""
    lens = {name: value for name, value in LENS.items() if name != "serial"} | focus
    other = replace(observed, configuration=configuration(ROIS, name="other", lens=lens))
    assert "(2 mm, f/2.8" in str(configured_lens(other.configuration))
    codes = {one.code for one in calibrate_session(observed, other).findings}
    assert "lens-serial-open" in codes
    assert "lens-serial-open" not in {one.code for one in calibrate_session(observed).findings}
