"""Calibration through the curve of a series camera with hand-overs: its world is plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile

import labcdp
from labcdp.acquire.import_check import ImportFile
from labcdp.acquire.import_files import import_session
from labcdp.api.session import Session
from labcdp.calibration import load_any, save
from labcdp.core.errors import CalibrationError, InputError
from labcdp.core.frame import Frame
from labcdp.files import Companding
from labcdp.session import SessionConfiguration

from ..series_camera import BLACK_DN, CODES, K_DN_PER_E, RATIOS, READ_DN, VALUES, SeriesCamera, write_bench

CAMERA = SeriesCamera()
FRONT = Companding("front", CODES, VALUES, 12, black_value=BLACK_DN)


def imported(folder, camera=CAMERA, **of_bench):
    """Session of the world's pictures, as ``labcdp import`` makes it."""
    write_bench(folder, camera, **of_bench)
    files = [
        ImportFile(path, role, exposure_s=float(path.name.split("ms")[0]) / 1000)
        for role in ("light", "dark")
        for path in sorted((folder / role).iterdir())
    ]
    import_session(SessionConfiguration.load(folder / "bench.toml"), folder / "session", files, folder / "readings.csv")
    return Session.open(folder / "session")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return imported(tmp_path_factory.mktemp("series"))


@pytest.fixture(scope="module")
def calibration(session):
    return session.calibrate().calibration


def codes_of(calibration):
    return {finding.code for finding in calibration.findings}


def test_a_session_keeps_codes_and_its_readers_expand_them(session):
    frame = session.load(session.frames("light")[-1])
    assert frame.dn.dtype == np.uint16
    assert frame.dn.max() <= CODES[-1]
    assert frame.companding == FRONT
    assert np.array_equal(frame.linear_dn(), np.interp(frame.dn, CODES, VALUES) - BLACK_DN)
    assert frame.metadata()["companding"] == {"name": "front", "sha256": FRONT.sha256}
    assert session.configuration.camera.encoding.sha256 == FRONT.sha256


def test_the_responsivity_is_found_through_all_hand_overs(calibration):
    assert calibration.response.kind == "linear"
    fit = calibration.responsivity
    assert abs(fit.responsivity_dn_s_cd_m2 / CAMERA.dn_s_cd_m2 - 1) < 3 * fit.random_rel
    # The dips of the SNR are no scatter of the patches.
    assert fit.scatter_rel == 0
    assert fit.chi_squared < fit.degrees_of_freedom + 4 * np.sqrt(2 * fit.degrees_of_freedom)
    assert calibration.state.saturation_dn == VALUES[-1] - BLACK_DN
    wrong = {"curve-wrong", "curve-disagrees", "patches-scatter", "full-below-saturation"}
    assert not codes_of(calibration) & wrong


@pytest.mark.parametrize("net_dn", [20.0, 1500.0, 20_000.0, 40_000.0, 150_000.0])
def test_the_noise_is_that_of_each_capture_and_of_the_step_of_its_code(calibration, net_dn):
    ratio = next(r for r in RATIOS if net_dn / r < 3800 - BLACK_DN)
    step = 1 if net_dn + BLACK_DN < 2048 else 64 if net_dn + BLACK_DN < 65536 else 1024
    of_capture = ratio * K_DN_PER_E * net_dn + ratio**2 * (READ_DN**2 + 1 / 12)
    variance = calibration.noise.variance_dn2(net_dn)
    # Levels are a factor of 1.2 apart.
    assert variance == pytest.approx(of_capture + step**2 / 12, rel=0.15)


def test_luminance_of_frames_and_patches(session, calibration, tmp_path):
    rows = session.evaluate(calibration).evaluation.patches
    for row, truth in zip(rows, CAMERA.luminances_cd_m2, strict=True):
        low, high = row.calibrated.interval_95_cd_m2
        assert low < truth < high
    frame = session.load(session.frames("light")[0])
    luminance = calibration.to_luminance(frame)
    for number, (x, y, width, height) in enumerate(CAMERA.regions().values()):
        part = luminance.luminance_cd_m2[y : y + height, x : x + width].astype(float)
        random_rel = luminance.random_rel[y : y + height, x : x + width]
        truth, spread = CAMERA.luminances_cd_m2[number], part.std()
        assert part.mean() == pytest.approx(truth, abs=4 * spread / np.sqrt(part.size) + 0.01 * truth)
        # 900 pixels: 10 % are 4 sigma; 20 %, as noise of 0.4 steps is known to a quarter of its variance.
        assert np.sqrt(np.mean(np.square(random_rel * part))) == pytest.approx(spread, rel=0.2)
    save(calibration, tmp_path / "c.json")
    assert load_any(tmp_path / "c.json") == calibration


def test_frames_without_the_curve_are_refused(session, calibration):
    frame = session.load(session.frames("light")[0])
    bare = replace(frame, companding=None)
    with pytest.raises(CalibrationError, match=r"curve of its codes of .* is front .*, but .* has none"):
        calibration.to_luminance(bare)
    with pytest.raises(ValueError, match="codes of the curve 'front', which is not in it"):
        Frame.from_metadata(frame.dn, frame.metadata())


WRONG = {
    "curve-wrong": "codes = [0, 2048, 3040, 4000]\nvalues = [0, 2048, 60000, 900000]\nblack_value = 168",
    "curve-disagrees": "codes = [0, 2048, 3040, 4000]\nvalues = [0, 2048, 65536, 1100000]\nblack_value = 168",
}


@pytest.mark.parametrize("code", WRONG)
def test_a_wrong_curve_is_found_with_its_size(session, tmp_path, code):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(f'name = "wrong"\nbits = 12\n{WRONG[code]}\n')
    configuration = session.configuration
    configuration = configuration.model_copy(update={"camera": configuration.camera.with_encoding(str(wrong))})
    again = recoded(session, configuration, tmp_path / "again")
    found = next(f for f in again.calibrate().calibration.findings if f.code == code)
    if code == "curve-wrong":
        assert found.values["other"] == "AR0231"
        assert found.values["other_rel"] < 0.01 < 0.03 < found.values["deviation_rel"]
    else:
        # (65536 + (1100000 - 65536) q) / (65536 + (1048576 - 65536) q) at the highest signal, q of the last segment.
        q = (found.values["net_dn"] + BLACK_DN - 65536) / (1_100_000 - 65536)
        truth = (65536 + (1_048_576 - 65536) * q) / (65536 + (1_100_000 - 65536) * q) - 1
        assert found.values["deviation_rel"] == pytest.approx(truth, abs=0.005)


def test_codes_without_a_curve_are_said_to_be_those_of_one(tmp_path):
    with pytest.raises(CalibrationError, match=r'by the curve AR0231 by 0\.\d%: state camera.encoding = "AR0231"'):
        imported(tmp_path, encoding=None).calibrate()


def test_a_curve_of_values_that_are_no_codes_is_found(tmp_path):
    def linear(camera, scene_cd_m2, exposure_s, rng):
        rate_e_s = camera.dn_s_cd_m2 / K_DN_PER_E * scene_cd_m2 + camera.dark_e_s
        noisy = K_DN_PER_E * rng.poisson(rate_e_s * exposure_s) + rng.normal(BLACK_DN, READ_DN, scene_cd_m2.shape)
        return np.clip(np.rint(noisy), 0, 4000).astype(np.uint16)

    camera = replace(CAMERA, luminances_cd_m2=tuple(np.geomspace(0.5, 800, 12).tolist()))
    session = imported(tmp_path, camera, encoding='"AR0231"', capture=linear)
    found = next(f for f in session.calibrate().calibration.findings if f.code == "curve-needless")
    assert found.values["other_rel"] < 0.02 < 0.06 < found.values["deviation_rel"]


@pytest.mark.long
def test_stated_uncertainty_of_r_holds_in_many_sessions(tmp_path):
    n, inside = 80, 0
    for seed in range(n):
        fit = imported(tmp_path / str(seed), seed=seed).calibrate().calibration.responsivity
        inside += abs(fit.responsivity_dn_s_cd_m2 / CAMERA.dn_s_cd_m2 - 1) < 1.96 * fit.random_rel
    # 4 sigma of a binomial distribution.
    assert abs(inside / n - 0.95) < 4 * np.sqrt(0.95 * 0.05 / n)


def recoded(session, configuration, folder):
    """Session with the same frames and readings, and another curve."""
    with Session.create(folder, configuration) as again:
        for record in session.frames():
            again.add_frame(replace(session.load(record), companding=None), record.role)
        for record in session.readings():
            again.add_reading(record.reading, record.patch)
    return Session.open(folder)


def test_pictures_of_the_camera_are_expanded_by_the_calibration_and_frames_by_their_session(
    session, calibration, tmp_path
):
    save(calibration, tmp_path / "c.json")
    record = session.frames("light")[0]
    frame, file = session.load(record), session.path / record.file.name
    truth = calibration.to_luminance(frame).luminance_cd_m2
    tifffile.imwrite(tmp_path / "bare.tif", frame.dn)
    by_calibration = labcdp.read_image(tmp_path / "bare.tif", calibration=tmp_path / "c.json", exposure_s=0.002)
    assert np.array_equal(np.asarray(by_calibration.luminance), truth)
    assert np.array_equal(np.asarray(labcdp.read_image(file, calibration=calibration).luminance), truth)
    relative = np.asarray(labcdp.read_image(file).luminance, dtype=float)
    assert relative * FRONT.scale == pytest.approx(frame.linear_dn(), rel=1e-6)
    # Away from its session, the frame says which curve it lacks.
    copied = tmp_path / "copied.tif"
    copied.write_bytes(file.read_bytes())
    with pytest.raises(InputError, match="codes of the curve 'front', which is not in it"):
        labcdp.read_image(copied)
    assert np.array_equal(np.asarray(labcdp.read_image(copied, encoding=FRONT).luminance, dtype=float), relative)
    with pytest.raises(InputError, match="a calibration includes the encoding"):
        labcdp.read_image(file, calibration=calibration, encoding="AR0231")


def test_linear_values_of_20_bits_are_kept_calibrated_and_converted_as_they_are(tmp_path):
    wide = imported(
        tmp_path, encoding=None, pixel_format="Mono20", capture=SeriesCamera.linear, store=lambda v: v.astype(np.uint32)
    )
    frame = wide.load(wide.frames("light")[-1])
    assert (frame.dn.dtype, frame.bit_depth) == (np.uint32, 20)
    assert np.array_equal(frame.dn, tifffile.imread(sorted((tmp_path / "light").iterdir())[-1]))
    calibration = wide.calibrate().calibration
    fit = calibration.responsivity
    assert calibration.response.kind == "linear"
    assert abs(fit.responsivity_dn_s_cd_m2 / CAMERA.dn_s_cd_m2 - 1) < 3 * fit.random_rel
    luminance = calibration.to_luminance(frame).luminance_cd_m2
    # Two neighbouring values stay two: float64 in the place of float32.
    assert luminance.dtype == np.float64
    dark = calibration.dark.mean_dn(frame.exposure_s)
    scale = fit.responsivity_dn_s_cd_m2 * frame.exposure_s
    in_middle = luminance[60, 80] * scale + dark, int(frame.dn[60, 80])
    assert in_middle[0] == pytest.approx(in_middle[1], rel=1e-6)
    tifffile.imwrite(tmp_path / "bare.tif", frame.dn)
    image = labcdp.read_image(tmp_path / "bare.tif", calibration=calibration, exposure_s=frame.exposure_s)
    assert np.array_equal(np.asarray(image.luminance), luminance)
