"""The dark pattern and hot pixels, from a session's own dark frames into the calibration and back."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.core.luminance import Invalid
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.corrections import corrections_of, corrections_of_lens
from labcdp.evaluate.bench.dark import with_dark_frames
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.report.result import session_result
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.report.envelope import envelope
from labcdp.session import Session

HOT = ((30, 70), (150, 300))  # row and column: one inside P01, one outside of all patches
OFFSET_DN, RATE_DN_S, REPEATS = 6.0, 400.0, 4


@pytest.fixture(scope="module")
def pattern(recorded):
    """Offset in DN and growth in DN/s of each pixel."""
    shape = recorded.load(recorded.frames()[0]).shape
    rng = np.random.default_rng(1)
    offset, rate = rng.normal(0, OFFSET_DN, shape), rng.normal(0, RATE_DN_S, shape)
    for place in HOT:
        offset[place] = 900.0
    return offset, rate


@pytest.fixture(scope="module")
def path(recorded, pattern, tmp_path_factory):
    """The example recorded with a sensor with a dark pattern, each frame with new noise `REPEATS` times."""
    path = tmp_path_factory.mktemp("pattern") / "session"
    offset, rate = pattern
    rng = np.random.default_rng(2)
    with Session.create(path, recorded.configuration) as session:
        for record in recorded.frames():
            frame = recorded.load(record)
            for repeat in range(REPEATS if record.role == "dark" else 1):
                # Further dark frames: those of the example in another order have the right noise.
                dn = frame.dn.ravel()[rng.permutation(frame.dn.size)].reshape(frame.shape) if repeat else frame.dn
                seen = dn + offset + rate * frame.exposure_s + rng.uniform(-0.5, 0.5, frame.shape)
                batch = frame.with_pixels(np.clip(np.rint(seen), 0, 4095).astype(np.uint16))
                session.add_frames([(replace(batch, frame_id=1000 * repeat + frame.frame_id), record.role, None)])
        for record in recorded.readings():
            session.add_reading(record.reading, record.patch)
    return path


@pytest.fixture(scope="module")
def session(path):
    with Session.open(path) as opened:
        yield opened


@pytest.fixture(scope="module")
def corrections(session):
    return with_dark_frames(corrections_of_lens(session), [session])


@pytest.fixture(scope="module")
def calibrated(session, corrections):
    return calibrate_session(observe_session(session, corrections=corrections))


def test_pattern_and_hot_pixels_are_found(corrections, pattern):
    own = corrections[None]
    assert {*zip(own.defects.rows.tolist(), own.defects.columns.tolist(), strict=True)} == set(HOT)
    offset, rate = pattern
    sound = ~own.defects.mask(offset.shape)
    for t in (0.002, 0.032):
        error = (own.dark_library.pattern_dn(offset.shape, t) - (offset + rate * t))[sound]
        assert error.std() == pytest.approx(own.dark_library.noise_dn(t), rel=0.1)


def test_luminances_of_pixels_come_nearer(session, calibrated, observed):
    """Spread over the darkest patch in one frame, against what is stated, with the library and without."""
    plain = calibrate_session(observe_session(session, corrections=corrections_of_lens(session)))
    frame = session.load(max(session.frames("light"), key=lambda record: record.exposure_s))
    (region,) = [p.region() for p in observed.configuration.target.patches if p.name == "P01"]
    spreads = []
    for calibration in (plain, calibrated):
        seen = calibration.to_luminance(frame)
        values, valid = region.select(seen.luminance_cd_m2), region.select(seen.invalid) & Invalid.DEFECT == 0
        noise = region.select(seen.random_rel * np.abs(seen.luminance_cd_m2))[valid]
        spreads.append((values[valid].std(), noise.mean()))
    (without, stated_without), (with_library, stated) = spreads
    assert with_library < 0.7 * without
    assert with_library == pytest.approx(stated, rel=0.06)  # the rest is noise, and known to be
    assert without > 1.5 * stated_without


def test_the_pattern_is_taken_off_once_everywhere(session, corrections, calibrated, observed, pattern):
    """The mean over a patch is the same by the map and by the observation; both without the pattern."""
    corrected = observe_session(session, corrections=corrections)
    frames = [session.load(r) for r in session.frames("light") if r.exposure_s == 0.032]
    dark_dn = calibrated.dark.mean_dn(0.032)
    r = calibrated.responsivity.responsivity_dn_s_cd_m2
    for name in ("P01", "P02", "P03"):
        (own,) = [o for o in corrected.patches[name] if o.exposure_s == 0.032]
        (even,) = [o for o in observed.patches[name] if o.exposure_s == 0.032]
        region = next(p.region() for p in corrected.configuration.target.patches if p.name == name)
        maps = [calibrated.to_luminance(frame) for frame in frames]
        sound = ~region.select(calibrated.defects.mask(maps[0].luminance_cd_m2.shape))
        by_map = np.mean([region.select(m.luminance_cd_m2)[sound].mean(dtype=float) for m in maps])
        assert by_map * r * 0.032 == pytest.approx(own.net_dn(dark_dn), abs=1e-3)
        # What the sensor's pattern adds to the region's mean is gone, but for the library's noise over its pixels.
        noise = corrections[None].dark_library.noise_dn(0.032) / np.sqrt(own.n_pixels)
        assert own.net_dn(dark_dn) == pytest.approx(even.net_dn(observed.darks[-1].mean_dn), abs=5 * noise + 0.1)


def test_it_is_saved_and_evaluation_uses_it(session, calibrated, tmp_path):
    save(calibrated, tmp_path / "calibration.json")
    loaded = load(tmp_path / "calibration.json")
    assert loaded.dark_library == calibrated.dark_library
    assert loaded.defects == calibrated.defects
    results = [
        evaluate_session(session, observe_session(session, corrections=corrections_of(c)), c)
        for c in (calibrated, loaded)
    ]
    assert envelope(session_result(results[0])) == envelope(session_result(results[1]))
    assert results[0].map.invalid[HOT[0]] & Invalid.DEFECT
