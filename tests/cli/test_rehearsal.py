"""A bench of one's own, simulated: its file, questions as with devices, regions from a file, and parts taken again."""

import json

from labcdp.session import EventRecord, Session

from .conftest import only_line, plan

BENCH = """
seed = 5
[camera]
vendor = "Basler"
model = "acA2440-20gm"
serial = "40012345"
naming = "sfnc"
[sensor]
width = 700
height = 400
black_level_dn = 32.0
k_dn_per_e = 0.3
[meter]
scale_rel = 0.05
repeatability_rel = 0.0
"""


def test_a_rehearsal_on_a_bench_of_ones_own(labcdp, tmp_path):
    (tmp_path / "plan.toml").write_text(plan("P12", [0.002]).replace('model = "Manta_G-505B"\n', ""))
    (tmp_path / "own.toml").write_text(BENCH)
    region = {"name": "P12", "kind": "polygon", "corners": [[600, 300], [640, 300], [640, 340], [600, 340]]}
    regions = {"format": "labcdp regions", "version": 1, "regions": [region]}
    (tmp_path / "regions.json").write_text(json.dumps(regions))
    command = ("acquire", "plan.toml", "own", "--simulated-bench", "own.toml", "--virtual-clock")
    done = labcdp(*command, "--rehearse", "--roi", "regions.json", stdin="\n" * 4)
    assert done.returncode == 0, done.stderr

    with Session.open(tmp_path / "own") as session:
        (devices,) = [r.content for r in session.records if isinstance(r, EventRecord) and r.kind == "devices"]
        camera = {"vendor": "Basler", "model": "acA2440-20gm", "serial": "40012345", "simulated": True}
        assert devices["camera"] == camera
        (patch,) = session.configuration.target.patches
        assert patch.region().bounds == (600, 300, 640, 340)
        shown = float(f"{1.05 * patch.nominal_luminance_cd_m2:.4g}")
        assert {r.reading.luminance_cd_m2 for r in session.readings()} == {shown}
        light, dark = (session.load(session.frames(role)[0]).dn for role in ("light", "dark"))
        assert abs(dark.mean() - 32) < 0.1
        # One operator did it all: the lens was open for one, and covered for the other.
        assert light.mean() > dark.mean() + 1

    again = ("acquire", "own/session.toml", "own", "--virtual-clock", "--retake", "P12", "--simulated")
    assert "was begun with another simulated bench" in only_line(labcdp(*again))
