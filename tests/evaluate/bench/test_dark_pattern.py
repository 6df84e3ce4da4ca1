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


@pytest.fixture(scope="module")
def pattern():
    """Offset in DN and growth in DN/s of each pixel."""
    rng = np.random.default_rng(1)
    offset, rate = rng.normal(0, 6.0, SHAPE), rng.normal(0, 400.0, SHAPE)
    offset[tuple(zip(*HOT, strict=True))] = 900.0
    return offset, rate


@pytest.fixture(scope="module")
def session(recorded, pattern, tmp_path_factory):
    """The example recorded with a sensor with a dark pattern, each dark frame with new noise `REPEATS` times."""
    offset, rate = pattern
    rng = np.random.default_rng(2)

    def seen(frames):
        for frame, role in frames:
            for repeat in range(REPEATS if role == "dark" else 1):
                # Further dark frames: those of the example in another order have the right noise.
                dn = rng.permutation(frame.dn.ravel()).reshape(SHAPE) if repeat else frame.dn
                dn = dn + offset + rate * frame.exposure_s + rng.uniform(-0.5, 0.5, SHAPE)
                one = frame.with_pixels(np.clip(np.rint(dn), 0, 4095).astype(np.uint16))
                yield replace(one, frame_id=1000 * repeat + frame.frame_id), role, None

    with Session.open(again(tmp_path_factory.mktemp("pattern") / "s", recorded, seen)) as opened:
        yield opened


@pytest.fixture(scope="module")
def corrections(session):
    return with_dark_frames(corrections_of_lens(session), [session])


@pytest.fixture(scope="module")
def corrected(session, corrections):
    return observe_session(session, corrections=corrections)


@pytest.fixture(scope="module")
def calibrated(corrected):
    return calibrate_session(corrected)


def region_of(observed, name):
    return next(patch.region() for patch in observed.configuration.target.patches if patch.name == name)


def test_pattern_and_hot_pixels_are_found(corrections, pattern):
    own, (offset, rate) = corrections[None], pattern
    assert {*zip(own.defects.rows.tolist(), own.defects.columns.tolist(), strict=True)} == set(HOT)
    for t in (0.002, 0.032):
        error = (own.dark_library.pattern_dn(SHAPE, t) - (offset + rate * t))[~own.defects.mask(SHAPE)]
        assert error.std() == pytest.approx(own.dark_library.noise_dn(t), rel=0.1)


def test_the_pattern_is_taken_off_once_everywhere(session, corrections, corrected, calibrated, observed):
    """The mean over a patch is the same by the map and by the observation; both without the pattern."""
    maps = [calibrated.to_luminance(session.load(r)) for r in session.frames("light") if r.exposure_s == 0.032]
    dn_per_cd_m2 = calibrated.responsivity.responsivity_dn_s_cd_m2 * 0.032
    for name in ("P01", "P02", "P03"):
        own, even = (next(o for o in one.patches[name] if o.exposure_s == 0.032) for one in (corrected, observed))
        region = region_of(observed, name)
        sound = ~region.select(calibrated.defects.mask(SHAPE))
        by_map = np.mean([region.select(m.luminance_cd_m2)[sound].mean(dtype=float) for m in maps])
        net_dn = own.net_dn(calibrated.dark.mean_dn(0.032))
        assert by_map * dn_per_cd_m2 == pytest.approx(net_dn, abs=1e-3)
        # What the sensor's pattern adds to the region's mean is gone, but for the library's noise over its pixels.
        noise = corrections[None].dark_library.noise_dn(0.032) / np.sqrt(own.n_pixels)
        assert net_dn == pytest.approx(even.net_dn(observed.darks[-1].mean_dn), abs=5 * noise + 0.1)


def test_it_is_saved_and_evaluation_uses_it(session, corrected, calibrated, tmp_path):
    save(calibrated, tmp_path / "calibration.json")
    loaded = load(tmp_path / "calibration.json")
    assert (loaded.dark_library, loaded.defects) == (calibrated.dark_library, calibrated.defects)
    first = evaluate_session(session, corrected, calibrated)
    other = evaluate_session(session, observe_session(session, corrections=corrections_of(loaded)), loaded)
    assert envelope(session_result(first)) == envelope(session_result(other))
    assert first.map.invalid[HOT[0]] & Invalid.DEFECT
