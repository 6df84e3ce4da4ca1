"""Commands that resume: killed at any moment, they end as if nothing had happened, without --force."""

import json
import os
import shutil
import signal
from itertools import accumulate

import numpy as np
import pytest

from labcdp.regions import save_regions
from labcdp.regions.shapes import RectangleShape
from labcdp.session import Session, SessionConfiguration, example_session

from ..conftest import wait_until
from ..evaluate.video.videos import MOVING, STILL, driving, write
from ..forking import KILLED_AT
from .conftest import SIMULATED, plan
from .importable import write_importable


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Two videos with their regions."""
    folder = tmp_path_factory.mktemp("inputs")
    for seed, name in enumerate(("first.avi", "second.avi", "third.avi")):
        write(folder / name, driving(12, 1, 2.0, seed), "MJPG")
    shapes = [RectangleShape(roi.name, *map(int, roi.corners[0]), 30, 30) for roi in (MOVING, STILL)]
    save_regions(folder / "rois.json", shapes, (160, 120))
    return folder


@pytest.fixture
def work(tmp_path, inputs):
    for path in inputs.iterdir():
        shutil.copy2(path, tmp_path)
    return tmp_path


VIDEO = ("--roi", "rois.json", "--contrast", "20%,100%", "-o", "out")
COMMANDS = {
    "video": ("video", "first.avi", *VIDEO),
    "archive": ("video", "first.avi", "second.avi", "third.avi", *VIDEO, "--workers", "1"),
    "sweep": ("sweep", "manta-g505", "--exact", "--over", "scene.contrast=10%:100%:5", "-o", "out"),
}


def outcome(folder):
    """All that a run left: names of files, what journals hold, and the values of results."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    assert not [name for name in names if ".labcdp-" in name]
    left = {"names": names}
    for name in names:
        if name.endswith(".jsonl"):
            left[name] = (folder / name).read_bytes()
        elif name.endswith("results.json"):
            values = json.loads((folder / name).read_text())
            left[name] = {key: values[key] for key in ("tables", "findings")}
    return left


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory, inputs, labcdp_in):
    """What each command leaves that nothing interrupts."""
    left = {}

    def run(command):
        if command not in left:
            folder = tmp_path_factory.mktemp(command)
            for path in inputs.iterdir():
                shutil.copy2(path, folder)
            done = labcdp_in(folder, *COMMANDS[command])
            assert done.returncode == 0, done.stderr
            left[command] = outcome(folder / "out")
        return left[command]

    return run


@pytest.mark.parametrize(
    "command", [pytest.param(one, marks=() if one == "sweep" else pytest.mark.long) for one in COMMANDS]
)
def test_killed_again_and_again_at_calls_that_change_the_disk_it_ends_the_same(command, work, uninterrupted, labcdp):
    steps = np.random.default_rng(7).integers(1, 9, 100)
    n_kills = 0
    for call in accumulate(steps.tolist()):
        done = labcdp(*COMMANDS[command], environment={KILLED_AT: str(call)})
        # Killed when all was written, it has nothing left to resume.
        if done.returncode == 0 or "already has results" in done.stderr:
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        n_kills += 1
    assert n_kills >= 3
    assert outcome(work / "out") == uninterrupted(command)


@pytest.mark.parametrize("n_lines", [pytest.param(2, marks=pytest.mark.long), 9])
def test_an_archive_killed_while_its_workers_work_is_resumed_at_once(n_lines, work, uninterrupted, labcdp, start):
    started = start(*COMMANDS["archive"])

    def is_midway():
        journals = [path.read_bytes().count(b"\n") for path in (work / "out").glob("second/*.jsonl")]
        return started.poll() is not None or any(n >= n_lines for n in journals)

    wait_until(is_midway, "the second video is evaluated")
    started.send_signal(signal.SIGKILL)
    assert started.wait() == -signal.SIGKILL
    done = labcdp(*COMMANDS["archive"])
    assert done.returncode == 0, done.stderr
    assert outcome(work / "out") == uninterrupted("archive")


def recorded(session):
    """Pixels of the frames and values of the readings, with what they are of."""
    session.verify()
    frames = [(one.role, one.exposure_s, session.load(one).dn.tobytes()) for one in session.frames()]
    return frames, [(one.patch, one.reading.value) for one in session.readings()]


def test_an_import_that_is_killed_again_and_again_is_complete_in_the_end(tmp_path, labcdp):
    arguments = write_importable(tmp_path)
    assert labcdp("import", "plan.toml", "whole", *arguments).returncode == 0
    names = sorted(os.listdir(tmp_path))
    n_kills = 0
    for call in accumulate(np.random.default_rng(8).integers(1, 15, 100).tolist()):
        done = labcdp("import", "plan.toml", "out", *arguments, environment={KILLED_AT: str(call)})
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        n_kills += 1
    assert n_kills >= 3
    assert recorded(Session.open(tmp_path / "out")) == recorded(Session.open(tmp_path / "whole"))
    assert not list((tmp_path / "out").rglob(".labcdp-*"))
    assert sorted(os.listdir(tmp_path)) == sorted([*names, "out"])


@pytest.mark.parametrize(
    ("devices", "calls"), [(SIMULATED, (10, 40)), (SIMULATED[:2], (30, 70))], ids=["in this process", "on the wire"]
)
def test_a_simulated_acquisition_that_is_killed_again_and_again_has_the_data_of_an_uninterrupted_one(
    devices, calls, aravis, tmp_path, labcdp
):
    # The exposures are found by looks, and the first frames of each stream are dropped.
    searched = plan("P07|P12", []).replace("exposures_s = []\n", "discard_frames = 1\n")
    (tmp_path / "plan.toml").write_text(searched)
    assert labcdp("acquire", "plan.toml", "whole", *devices).returncode == 0
    n_kills = 0
    for call in np.random.default_rng(9).integers(*calls, 100).tolist():
        done = labcdp("acquire", "plan.toml", "out", *devices, environment={KILLED_AT: str(call)})
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        n_kills += 1
    assert n_kills >= 2
    assert recorded(Session.open(tmp_path / "out")) == recorded(Session.open(tmp_path / "whole"))


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.long)])
def test_an_acquisition_killed_while_it_replaces_a_session_of_an_earlier_plan_begins_again(step, tmp_path, labcdp):
    """The earlier session has no records yet: its plan was refused, and corrected since."""
    example = example_session()
    arguments = ("acquire", example / "session.toml", "out", "--replay", example)
    configuration = SessionConfiguration.load(example / "session.toml")
    # As many calls as it takes to remove one and to make the other.
    for call in range(step, 28, step):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        Session.create(tmp_path / "out", configuration.model_copy(update={"operator": "another"})).close()
        assert labcdp(*arguments, environment={KILLED_AT: str(call)}).returncode == -signal.SIGKILL
        done = labcdp(*arguments)
        assert done.returncode == 0, (call, done.stderr)
        assert os.listdir(tmp_path) == ["out"]
        assert Session.open(tmp_path / "out").configuration == configuration
