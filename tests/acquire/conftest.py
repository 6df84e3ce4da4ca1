from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest

from labcdp.acquire import acquire
from labcdp.core.clock import SimulatedClock
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.session import EventRecord, Session

SHAPE = (400, 480)


@dataclass
class Bench:
    """A simulated bench in simulated time, with what looks at it open."""

    session: Session
    bench: SimulatedBench
    camera: Any
    meter: Any
    clock: SimulatedClock

    def acquire(self, operator=None, **options):
        return acquire(self.session, self.camera, self.meter, operator or self.bench, clock=self.clock, **options)

    def events(self, kind):
        return [r.content for r in self.session.records if isinstance(r, EventRecord) and r.kind == kind]

    @property
    def counts(self):
        return len(self.session.frames("light")), len(self.session.readings()), len(self.session.frames("dark"))


@pytest.fixture
def changed(small_configuration):
    """The small configuration with other values in its tables."""

    def change(patches=None, **tables):
        tables.setdefault("target", {})
        if patches is not None:
            known = {patch.name: patch for patch in small_configuration.target.patches}
            tables["target"] = tables["target"] | {"patches": tuple(known[name] for name in patches)}
            tables["contrasts"] = ()
        update = {
            name: getattr(small_configuration, name).model_copy(update=values) if isinstance(values, dict) else values
            for name, values in tables.items()
        }
        return small_configuration.model_copy(update=update)

    return change


@pytest.fixture
def on_bench(tmp_path):
    """Open a session on a simulated bench in simulated time; opening it again resumes it."""

    @contextmanager
    def opened(configuration, patience_s=0.0, name="session"):
        clock = SimulatedClock()
        path = tmp_path / name
        session = Session.open(path, True, clock) if path.exists() else Session.create(path, configuration, clock=clock)
        with (
            session,
            SimulatedBench(configuration, BenchDevices.standard(), SHAPE, clock=clock) as bench,
            bench.in_process_camera(patience_s=patience_s) as camera,
            bench.in_process_meter() as meter,
        ):
            yield Bench(session, bench, camera, meter, clock)

    return opened


class Hands:
    """An operator who notes what was asked and repeats what a test says."""

    def __init__(self, bench, repeat=lambda what, findings: False):
        self.bench, self._repeat = bench, repeat
        self.done, self.found = [], []

    def cover_lens(self):
        self.done.append("cover")
        self.bench.cover_lens()

    def uncover_lens(self):
        self.done.append("uncover")
        self.bench.uncover_lens()

    def point_meter(self, patch):
        self.done.append(f"point {patch}")
        self.bench.point_meter(patch)

    def show_patch(self, patch):
        self.done.append(f"show {patch}")
        self.bench.show_patch(patch)

    def repeat(self, what, findings):
        self.found.append((what, [finding.check for finding in findings]))
        return self._repeat(what, findings)


def new_frame(dn, frame_id=1, exposure_s=0.01):
    """A frame of 12 bits with these pixels."""
    return Frame(
        dn=np.asarray(dn, dtype=np.uint16),
        exposure_s=exposure_s,
        gain_db=0.0,
        bit_depth=12,
        saturation_dn=4095,
        black_level_dn=64.0,
        pixel_format="Mono12",
        colour_filter=None,
        temperature_c=35.0,
        timestamp=datetime(2026, 3, 2, tzinfo=UTC),
        camera_timestamp_ns=frame_id,
        frame_id=frame_id,
        camera=CameraIdentity("v", "m", "s"),
    )
