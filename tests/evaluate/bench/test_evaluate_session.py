import shutil
from dataclasses import astuple, replace

import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.calibration.uncertainty import expanded_rel
from labcdp.core.errors import CalibrationError, InputError
from labcdp.core.luminance import Invalid
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.corrections import calibration_corrections, lens_corrections, with_dark_frames
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session, observe_calibrated
from labcdp.evaluate.bench.session_page import session_files
from labcdp.evaluate.bench.session_result import session_result
from labcdp.evaluate.bench.verification import verify_session
from labcdp.report.files import envelope
from labcdp.session import ContrastConfiguration, Session

from .synthetic import again

THESIS = {"upper right": 75.6, "upper left": 356.0, "lower right": 33.6, "lower left": 412.0}


def test_every_patch_lies_within_its_interval(evaluation):
    """The example's meter reads 0.6 % too much, inside its 2 %: the intervals must hold the simulated truth."""
    nominal = {p.name: p.nominal_luminance_cd_m2 for p in evaluation.observed.configuration.target.patches}
    assert {name: nominal[name] for name in THESIS} == THESIS
    for row in evaluation.patches:
        low, high = row.calibrated.interval_95_cd_m2
        assert low < nominal[row.region.name] < high
        # Of the map, too, which takes each pixel from an exposure that does not saturate it.
        seen = row.region.select(evaluation.map.luminance_cd_m2)
        assert row.region.select(evaluation.map.valid).mean() > 0.95
        assert seen.mean() == pytest.approx(nominal[row.region.name], rel=0.03)
        if row.region.name in THESIS:
            # The guessed K of 0.41 DN/e- instead of 0.6 makes the calculated luminance about 46 % too high.
            assert 1.33 < row.calculated_cd_m2 / row.reading.luminance_cd_m2 < 1.52
            # 95 % of a rectangular error of 2 % are within 1.9 %.
            assert expanded_rel([row.meter], row.reading.random_rel) == pytest.approx(0.019, abs=0.001)


def test_a_contrast_is_that_of_the_longest_exposure_that_saturates_neither_patch(recorded, observed, evaluation):
    exposures = {frame.number: frame.exposure_s for frame in recorded.frames()}
    for row in evaluation.contrasts:
        seen = [o for name in (row.target.bright, row.target.dark) for o in observed.patches[name]]
        saturated = {o.exposure_s for o in seen if o.saturated_share > 0}
        assert exposures[row.frame_number] == row.exposure_s == max({o.exposure_s for o in seen} - saturated)


def test_a_calibration_from_before_parts_were_taken_again_is_no_check(recorded, evaluation, tmp_path):
    shutil.copytree(recorded.path, tmp_path / "s")
    with Session.open(tmp_path / "s", writable=True) as session:
        session.supersede(session.readings()[-1:], "taken again")
        found = evaluate_session(observe_session(session), evaluation.calibration)
        with pytest.raises(CalibrationError, match="cannot verify it"):
            verify_session(session, evaluation.calibration)
    codes = {finding.code for finding in session_result(found).findings}
    assert {"calibration-before-retake", "not-checked"} <= codes
    assert "checked-by-another-measurement" not in codes


def test_patches_shown_one_by_one_give_what_they_give_in_one_image(recorded, evaluation, tmp_path):
    """The example again, with frames in which everything but one patch is wrong."""
    target = recorded.configuration.target.model_copy(update={"presentation": "one by one"})
    regions = {patch.name: patch.region() for patch in target.patches}

    def alone(frames):
        for frame, role in frames:
            for name, region in regions.items() if role == "light" else [(None, None)]:
                dn = frame.dn if region is None else np.full_like(frame.dn, 1234)
                if region is not None:
                    window = region.window(frame.shape)
                    dn[window] = np.where(region.mask(frame.shape), frame.dn[window], 1234)
                yield frame.with_pixels(dn), role, name

    with Session.open(again(tmp_path / "s", recorded, alone, target=target)) as session:
        observed = observe_session(session)
        result = evaluate_session(observed, calibrate_session(observed))
        by_number = {record.number: record for record in session.frames("light")}
    assert [astuple(row) for row in result.patches] == [astuple(row) for row in evaluation.patches]
    for row, expected in zip(result.contrasts, evaluation.contrasts, strict=True):
        assert repr(row.cdp) == repr(expected.cdp)
        frames = [by_number[n] for n in (row.frame_number, row.dark_frame_number)]
        assert [frame.patch for frame in frames] == row.name.split(" / ")
        assert {frame.exposure_s for frame in frames} == {row.exposure_s}
    shown, expected = (one.map.luminance_cd_m2 for one in (result, evaluation))
    for region in regions.values():
        np.testing.assert_array_equal(region.select(shown), region.select(expected))


def other(observed, **changes):
    """The observed session with another configuration."""
    return replace(observed, configuration=observed.configuration.model_copy(update=changes))


def test_another_light_lens_or_black_level_is_not_evaluated_without_a_word(recorded, observed, evaluation, tmp_path):
    another_light = other(observed, source=observed.configuration.source.model_copy(update={"spectrum": "A"}))
    found = evaluate_session(another_light, evaluation.calibration).findings[0]
    assert (found.code, found.severity) == ("light-differs", "warning")
    # An unknown serial number is not another one.
    lens = observed.configuration.lens.model_copy(update={"serial": None})
    found = evaluate_session(other(observed, lens=lens), evaluation.calibration)
    assert "lens-serial-open" in {one.code for one in found.findings}
    assert "lens-serial-open" not in {one.code for one in evaluation.findings}
    lens = observed.configuration.lens.model_copy(update={"serial": "another"})
    with pytest.raises(CalibrationError, match="another"):
        evaluate_session(other(observed, lens=lens), evaluation.calibration)
    lens = observed.configuration.lens.model_copy(update={"f_number": 4.0})
    with pytest.raises(CalibrationError, match=r"for the lens .*f/2\.6\), the frame was taken with .*f/4\)"):
        evaluate_session(other(observed, lens=lens), evaluation.calibration)
    state = replace(evaluation.calibration.state, black_level_register=128.0)
    with pytest.raises(CalibrationError, match=r"black level of .* is 128, but .* has 64"):
        evaluate_session(observed, replace(evaluation.calibration, state=state))
    pair = ContrastConfiguration(bright="lower right", dark="upper left", contrast=10.0)
    with pytest.raises(InputError, match="patch 'lower right' is darker than 'upper left'"):
        evaluate_session(observed, evaluation.calibration, [pair])


def test_a_saturated_patch_is_named_and_can_be_left_out(recorded, observed):
    full = [replace(one, saturated_share=0.5) for one in observed.patches["upper left"]]
    patches = {**observed.patches, "upper left": full}
    with pytest.raises(CalibrationError, match=r"'upper left' cannot be used at any .*saturated.*leave it out$"):
        calibrate_session(replace(observed, patches_by_plane={None: patches}))
    without = calibrate_session(observe_session(recorded, ["upper left"]))
    assert "upper left" not in {row.patch for row in without.residuals}


# The dark pattern and hot pixels, from a session's own dark frames into the calibration and back

HOT = ((30, 70), (150, 300))  # row and column: one inside P01, one outside of all patches
SHAPE, REPEATS = (400, 480), 4


def with_pattern(frames, offset_dn, rate_dn_s):
    """Frames of a sensor with a dark pattern, each dark frame with new noise `REPEATS` times."""
    rng = np.random.default_rng(2)
    for frame, role in frames:
        for repeat in range(REPEATS if role == "dark" else 1):
            # Further dark frames: those of the example in another order have the right noise.
            dn = rng.permutation(frame.dn.ravel()).reshape(SHAPE) if repeat else frame.dn
            dn = dn + offset_dn + rate_dn_s * frame.exposure_s + rng.uniform(-0.5, 0.5, SHAPE)
            one = frame.with_pixels(np.clip(np.rint(dn), 0, 4095).astype(np.uint16))
            yield replace(one, frame_id=1000 * repeat + frame.frame_id), role, None


def test_pattern_and_hot_pixels_are_found_taken_off_once_everywhere_and_saved(recorded, observed, tmp_path):
    rng = np.random.default_rng(1)
    offset, rate = rng.normal(0, 6.0, SHAPE), rng.normal(0, 400.0, SHAPE)
    offset[tuple(zip(*HOT, strict=True))] = 900.0
    with Session.open(again(tmp_path / "s", recorded, lambda frames: with_pattern(frames, offset, rate))) as session:
        corrections, _ = with_dark_frames(lens_corrections(session), [session])
        corrected = observe_session(session, corrections=corrections)
        calibrated = calibrate_session(corrected)
        save(calibrated, tmp_path / "calibration.json")
        loaded = load(tmp_path / "calibration.json")
        first = evaluate_session(corrected, calibrated)
        other = evaluate_session(observe_session(session, corrections=calibration_corrections(loaded)), loaded)
        maps = [calibrated.to_luminance(session.load(r)) for r in session.frames("light") if r.exposure_s == 0.032]
    own = corrections[None]
    assert {*zip(own.defects.rows.tolist(), own.defects.columns.tolist(), strict=True)} == set(HOT)
    for t in (0.002, 0.032):
        sound, truth = ~own.defects.mask(SHAPE), offset + rate * t
        error = (own.dark_library.pattern_dn(SHAPE, t) - truth)[sound]
        assert error.std() == pytest.approx(own.dark_library.noise_dn(t), rel=0.1)
        assert own.dark_library.nonuniformity_dn(t) == pytest.approx(truth[sound].std(), rel=0.05)
    # The mean over a patch is the same by the map and by the observation; both without the pattern.
    dn_per_cd_m2 = calibrated.responsivity.responsivity_dn_s_cd_m2 * 0.032
    for patch in observed.configuration.target.patches[:3]:
        seen, even = (
            next(o for o in one.patches[patch.name] if o.exposure_s == 0.032) for one in (corrected, observed)
        )
        sound = ~patch.region().select(calibrated.defects.mask(SHAPE))
        by_map = np.mean([patch.region().select(m.luminance_cd_m2)[sound].mean(dtype=float) for m in maps])
        as_shown = seen.with_vignetting(calibrated.vignetting)
        # Over a region, what patches have shown of the vignetting is that in its middle.
        of_patch = as_shown.net_dn(calibrated.dark.mean_dn(0.032))
        assert by_map * dn_per_cd_m2 == pytest.approx(of_patch, rel=2e-5)
        net_dn = seen.net_dn(calibrated.dark.mean_dn(0.032))
        # What the sensor's pattern adds to the region's mean is gone, but for the library's noise over its pixels.
        noise = own.dark_library.noise_dn(0.032) / np.sqrt(seen.n_pixels)
        assert net_dn == pytest.approx(even.net_dn(observed.darks_by_plane[None][-1].mean_dn), abs=5 * noise + 0.1)
    assert (loaded.dark_library, loaded.defects) == (calibrated.dark_library, calibrated.defects)
    for one, two in zip(first.patches, other.patches, strict=True):
        assert one.calibrated.luminance_cd_m2 == pytest.approx(two.calibrated.luminance_cd_m2, rel=2e-5)
    assert first.map.invalid[HOT[0]] & Invalid.DEFECT


@pytest.mark.parametrize("own", [False, True])
def test_a_patch_that_is_saturated_at_every_exposure_has_a_bound(recorded, calibration, tmp_path, own):
    """Without the frames of 2 ms the brightest patches are saturated in all.

    All others keep their values; the simulated truth of the saturated ones is above the bound.
    """
    truth = {patch.name: patch.nominal_luminance_cd_m2 for patch in recorded.configuration.target.patches}
    limits = {"lower left": (100.0, 500.0), "upper left": (1.0, 50.0)}
    patches = [
        patch.model_copy(update={"limits_cd_m2": limits.get(patch.name)})
        for patch in recorded.configuration.target.patches
    ]
    target = recorded.configuration.target.model_copy(update={"patches": tuple(patches)})
    again(tmp_path / "s", recorded, lambda frames: ((f, role, None) for f, role in frames if f.exposure_s > 0.004),
          target=target)  # fmt: skip
    with Session.open(tmp_path / "s") as session:
        found = evaluate_session(*observe_calibrated(session, None if own else calibration))
    rows = {row.patch.name: row for row in found.patches}
    bounded = {name for name, row in rows.items() if row.bound}
    assert {"lower left", "upper left"} <= bounded < set(rows)
    for name, row in rows.items():
        low, high = row.interval_95_cd_m2
        assert row.calibrated.luminance_cd_m2 < truth[name] if row.bound else low < truth[name] < high
    # A bound decides where it is above the limits.
    assert [rows[name].limit_verdict for name in limits] == ["undecided", "fail"]
    for row in found.contrasts:
        saturated = row.target.bright in bounded
        assert row.bound == (">" if saturated and row.target.dark not in bounded else "?" if saturated else "")
        assert np.isnan(row.cdp.cdp) == saturated
        assert not saturated or row.verdict == "saturated"
        assert row.bound != ">" or row.camera_contrast < row.measured_contrast
    result = session_result(found)
    codes = {one.code for one in result.findings}
    # A bound checks no calibration.
    assert "patch-saturated-everywhere" in codes
    assert "checked-by-held-out" not in codes
    for table, value in (("contrasts", "camera_contrast"), ("luminance", "calibrated_cd_m2")):
        written = envelope(result)["tables"][table]["rows"]
        assert {row[f"{value}_bound"] for row in written} > {""}
        assert all(row[f"expanded_{value}"] is None for row in written if row[f"{value}_bound"])
    page = session_files(found, result)["report.html"].decode()
    assert f"&gt; {rows['lower left'].calibrated.luminance_cd_m2:.3g}"[:7] in page
