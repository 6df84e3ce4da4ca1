from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from labcdp.acquire import acquire
from labcdp.core.clock import SimulatedClock
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices
from labcdp.session import EventRecord, Session

SHAPE = (400, 480)
#: Two patches of very different luminance.
FAR = ["P01", "lower left"]


@dataclass
class Bench:
    """A simulated bench with a session and what looks at it open."""

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
    """The small configuration with other values in its tables, or some of its patches only."""

    def change(patches=None, **tables):
        if patches is not None:
            known = {patch.name: patch for patch in small_configuration.target.patches}
            chosen = tuple(known[name] for name in patches)
            tables |= {"target": {"patches": chosen} | tables.get("target", {}), "contrasts": ()}
        return small_configuration.model_copy(
            update={
                name: getattr(small_configuration, name).model_copy(update=values) if values else values
                for name, values in tables.items()
            }
        )

    return change


@pytest.fixture
def on_bench(tmp_path):
    """Open a session on a simulated bench in simulated time; opening it again resumes it."""

    @contextmanager
    def opened(configuration, patience_s=0.0):
        clock, path = SimulatedClock(), tmp_path / "session"
        session = Session.open(path, True, clock) if path.exists() else Session.create(path, configuration, clock=clock)
        with (
            session,
            SimulatedBench(configuration, SimulatedDevices.standard(), SHAPE, clock=clock) as bench,
            bench.in_process_camera(patience_s=patience_s) as camera,
            bench.in_process_meter() as meter,
        ):
            yield Bench(session, bench, camera, meter, clock)

    return opened


class Hands:
    """An operator who notes what was asked and repeats what a test says."""

    def __init__(self, bench, repeat=lambda what, findings: False):
        self._bench, self._repeat = bench, repeat
        self.done, self.found = [], []

    def repeat(self, what, findings):
        self.found.append((what, [finding.check for finding in findings]))
        return self._repeat(what, findings)

    def __getattr__(self, step):
        def do(*patch):
            self.done.append(" ".join((step, *patch)))
            getattr(self._bench, step)(*patch)

        return do
