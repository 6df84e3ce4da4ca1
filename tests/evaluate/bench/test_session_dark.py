"""A map of a session's frames has the dark signal of its own dark frames, as its patches have."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.camera import make_device
from worlds.meter import read_patches, scale_errors
from worlds.recorder import LIGHT_S, READ_S, Recorder
from worlds.target import calibration_target
from worlds.world import World

from labcdp.calibration.bracket import bracket_luminance
from labcdp.core.roi import Roi
from labcdp.evaluate.bench.observe import calibration_for_frames
from labcdp.session import Session


def test_the_black_level_of_another_day_is_no_light(tmp_path):
    rng, world = np.random.default_rng(12), World()
    recorder = Recorder(make_device(world, rng), rng, tmp_path)
    target, scales = calibration_target(world, rng), scale_errors(world, rng)
    shown = read_patches(world, target.luminance_cd_m2, scales, rng, LIGHT_S, READ_S)
    with recorder.record("calibration", target, shown, frames=(3, 4)) as session:
        calibration = session.calibrate().calibration
    # 5 DN of about 180 that the darkest patch has.
    recorder.device = replace(recorder.device, world=replace(world, black_dn=world.black_dn + 5))
    recorder.record("later", target, shown, frames=(3, 4), after=1.0).close()
    session = Session.open(tmp_path / "later")
    there, findings = calibration_for_frames(session, calibration)
    assert [one.code for one in findings] == ["dark-changed"]
    frames = [session.load(one) for one in session.frames("light")]
    darkest = min(target.luminance_cd_m2, key=lambda name: target.luminance_cd_m2[name])
    region = Roi.rectangle(darkest, *target.regions[darkest])
    seen = [region.select(bracket_luminance(one, frames).map.luminance_cd_m2).mean() for one in (there, calibration)]
    truth = target.luminance_cd_m2[darkest]
    assert seen[0] == pytest.approx(truth, rel=0.02)
    assert abs(seen[1] / truth - 1) > 0.03
    # In the calibration's own session nothing changes.
    own = Session.open(tmp_path / "calibration")
    assert calibration_for_frames(own, calibration)[0].dark.offset_dn == calibration.dark.offset_dn
