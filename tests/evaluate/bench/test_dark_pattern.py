"""The dark pattern and hot pixels, from a session's own dark frames into the calibration and back."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.core.luminance import Invalid
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.corrections import corrections_of, corrections_of_lens, with_dark_frames
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.evaluate.bench.session_result import session_result
from labcdp.report.files import envelope
from labcdp.session import Session

from .synthetic import again

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
        corrections = with_dark_frames(corrections_of_lens(session), [session])
        corrected = observe_session(session, corrections=corrections)
        calibrated = calibrate_session(corrected)
        save(calibrated, tmp_path / "calibration.json")
        loaded = load(tmp_path / "calibration.json")
        first = evaluate_session(corrected, calibrated)
        other = evaluate_session(observe_session(session, corrections=corrections_of(loaded)), loaded)
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
        net_dn = seen.net_dn(calibrated.dark.mean_dn(0.032))
        assert by_map * dn_per_cd_m2 == pytest.approx(net_dn, abs=1e-3)
        # What the sensor's pattern adds to the region's mean is gone, but for the library's noise over its pixels.
        noise = own.dark_library.noise_dn(0.032) / np.sqrt(seen.n_pixels)
        assert net_dn == pytest.approx(even.net_dn(observed.darks[-1].mean_dn), abs=5 * noise + 0.1)
    assert (loaded.dark_library, loaded.defects) == (calibrated.dark_library, calibrated.defects)
    assert envelope(session_result(first)) == envelope(session_result(other))
    assert first.map.invalid[HOT[0]] & Invalid.DEFECT
