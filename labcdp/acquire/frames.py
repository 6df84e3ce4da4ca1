"""Frames of a plan: set the camera, take frames, write them and keep their statistics."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from typing import Any

from ..core.clock import Clock, exposure_text
from ..core.errors import SessionError
from ..core.frame import Frame
from ..core.roi import Roi
from ..drivers.camera import Camera, CameraLostError, IncompleteFrameError, Refused
from ..drivers.camera_settings import CameraSettings
from ..session import EventRecord, FrameRecord, Role, Session
from ..session.records import CAMERA_LOST, CAMERA_RETURNED, LOSSES
from .control import Announced, Control, Progress, Report, Schedule, noted, take_frames
from .live import LiveNumbers, LiveStatistics, PatchNumbers, measured_black_dn
from .plan import frames_at, remaining, same_exposure, shown_patches
from .recording import FrameWriter

_log = logging.getLogger(__name__)

#: Most frames per exposure that a resumed run reads again for its statistics, to limit the time.
_LOOKED_BACK = 16


#: Exposure of the frames that warm a camera up, within its range, and more of them than any warm-up takes.
_WARM_UP_EXPOSURE_S = 0.01
_ENDLESS = 10**9
#: Time over which the temperature must be steady.
_STEADY_S = 60.0


class FrameRecorder:
    """Takes the frames of a session's plan.

    Parameters
    ----------
    session : Session
        Open for writing.
    camera : Camera
        Open.
    report : callable
        Called after each frame.
    clock : Clock
        Clock for the schedule of the frames.
    control : Control
        Polled between frames.
    bench : Announced or None
        Told which frames follow.
    """

    def __init__(
        self,
        session: Session,
        camera: Camera,
        report: Report,
        clock: Clock,
        control: Control,
        bench: Announced | None,
    ) -> None:
        self._session = session
        self._camera = camera
        self._report = report
        self._clock = clock
        self._control = control
        self._plan = session.configuration.plan
        self._bench = bench
        self._gaps_noted = len(camera.gaps)
        self._n_looks = 0
        self._n_losses = sum(isinstance(r, EventRecord) and r.kind in LOSSES for r in session.records)
        self._numbers: dict[tuple[Role, str | None, float], LiveNumbers] = {}

    def preview(self, exposure_s: float) -> Frame:
        """Take a frame without recording it; raises AcquisitionStoppedError."""
        self.configure(exposure_s)
        refused = noted(self._session.add_event, {"role": "light", "exposure_s": exposure_s})
        if self._bench is not None:
            self._bench.announce_frames("look", self._n_looks, 0)
        self._n_looks += 1
        with closing(take_frames(self._camera, 1, None, self._control, refused)) as frames:
            return self._session.configuration.camera.stated(next(frames))

    def preview_statistics(self, exposure_s: float, shown: str | None) -> tuple[PatchNumbers, ...]:
        """Return the statistics of the visible patches in a frame that is not recorded; none of a replay."""
        return LiveNumbers(self.regions(shown)).add(self.preview(exposure_s)) if self._camera.live else ()

    def warm_up(self) -> None:
        """Take frames without recording them until the camera's temperature is steady, or for the planned time."""
        plan, clock = self._plan, self._clock
        if plan.warm_up_s == 0 or not self._camera.live:
            return
        shortest_s, longest_s = self._camera.exposure_range_s
        self.configure(min(max(_WARM_UP_EXPOSURE_S, shortest_s), longest_s))
        refused = noted(self._session.add_event, {"role": "warm-up"})
        began_s, seen = clock.monotonic_s(), deque[tuple[float, float]]()
        stable = False
        with closing(take_frames(self._camera, _ENDLESS, None, self._control, refused)) as frames:
            for frame in frames:
                past_s = clock.monotonic_s() - began_s
                self._report(Progress("warm-up", min(int(past_s), int(plan.warm_up_s)), int(plan.warm_up_s)))
                if frame.temperature_c is not None:
                    seen.append((past_s, frame.temperature_c))
                while seen and past_s - seen[0][0] > _STEADY_S:
                    seen.popleft()
                stable = plan.stable_within_c is not None and _steady(seen, plan.stable_within_c)
                if stable or past_s >= plan.warm_up_s:
                    break
        last_c = seen[-1][1] if seen else None
        self._session.add_event("warm-up", {"duration_s": past_s, "temperature_c": last_c, "stable": stable})
        if plan.stable_within_c is not None and not stable:
            _log.warning("the camera's temperature is not steady to %g K after %g s", plan.stable_within_c, past_s)

    def configure(self, exposure_s: float) -> CameraSettings:
        """Apply the planned settings with an exposure, and return the settings in effect."""
        plan = self._plan
        return self._camera.configure(exposure_s=exposure_s, gain_db=plan.gain_db, pixel_format=plan.pixel_format)

    def record(self, role: Role, shown: str | None, lacking: Mapping[float, int]) -> None:
        """Take frames; they are on the disk when this returns or raises.

        Parameters
        ----------
        role : {'light', 'dark'}
            Whether the target is seen.
        shown : str or None
            The patch shown alone; None for all together.
        lacking : mapping of float to int
            Number of frames by exposure in seconds.

        Raises
        ------
        SessionError
            If they cannot be recorded, or the camera does not keep an exposure.
        """
        live = {exposure_s: self._live_numbers(role, shown, exposure_s) for exposure_s in lacking}
        black_dn, discard = self.black_dn(shown), self._plan.discard_frames if self._camera.live else 0
        done, total = self._done(role)
        self._report(Progress(f"{role} frames", done, total))
        try:
            with FrameWriter(self._session, self._clock) as writer:
                for exposure_s, n in lacking.items():
                    self._apply(exposure_s, role, writer)
                    refused = self._noting(writer, role, exposure_s)
                    starts = self._announcing(role, shown, exposure_s, discard)
                    taking = take_frames(self._camera, n, self._schedule(), self._control, refused, discard, starts)
                    with closing(taking) as frames:
                        stated = map(self._session.configuration.camera.stated, frames)
                        for taken, frame in enumerate(stated, start=1):
                            writer.put(frame, role, shown)
                            self._note_gaps(writer.put_event)
                            done += 1
                            numbers = _above(black_dn, live[exposure_s].add(frame))
                            now = LiveStatistics(role, exposure_s, numbers, frame.temperature_c, finished=taken == n)
                            self._report(Progress(f"{role} frames", done, total, now))
        except CameraLostError as error:
            self._session.add_event(CAMERA_LOST, {"reason": str(error)})
            raise
        finally:
            self._note_gaps(self._session.add_event)
        self._note_throughput(writer)

    def numbers(self, shown: str | None, role: Role = "light") -> list[PatchNumbers]:
        """Return the statistics of all exposures."""
        return list(_above(self.black_dn(shown), self._counted(role, shown)))

    def black_dn(self, shown: str | None) -> float | None:
        """Return the black level as measured so far; None if it is unknown."""
        return measured_black_dn(self._counted("dark", None), self._counted("light", shown))

    def _counted(self, role: Role, shown: str | None) -> list[PatchNumbers]:
        exposures_s = self._session.exposures_s or ()
        return [n for t in exposures_s for n in self._live_numbers(role, shown, t).numbers]

    def repeats(self, shown: str | None, role: Role) -> tuple[int, int]:
        """Return the number of frames that repeat an earlier one of their exposure, and of all, over all exposures."""
        live = [self._live_numbers(role, shown, exposure_s) for exposure_s in self._session.exposures_s or ()]
        return sum(numbers.n_repeated for numbers in live), sum(numbers.n_frames for numbers in live)

    def regions(self, shown: str | None) -> list[Roi]:
        """Regions of the visible patches."""
        patches = self._session.configuration.target.patches
        return [patch.region() for patch in patches if shown in (None, patch.name)]

    def forget(self) -> None:
        """Drop the statistics of frames that no longer count."""
        self._numbers.clear()

    def _live_numbers(self, role: Role, shown: str | None, exposure_s: float) -> LiveNumbers:
        """Statistics of an exposure, initialised with the last frames of an earlier run."""
        key = (role, shown, exposure_s)
        if key not in self._numbers:
            numbers = LiveNumbers(self.regions(shown))
            for record in frames_at(self._session.frames(role), exposure_s, shown)[-_LOOKED_BACK:]:
                numbers.add(self._session.load(record))
            self._numbers[key] = numbers
        return self._numbers[key]

    def _done(self, role: Role) -> tuple[int, int]:
        plan, rest = self._plan, remaining(self._session)
        exposures = len(self._session.exposures_s or ())
        if role == "dark":
            total = plan.dark_frames_per_exposure * exposures
            return total - sum(rest.dark.values()), total
        total = plan.frames_per_exposure * exposures * len(shown_patches(self._session.configuration))
        return total - sum(rest.light.values()), total

    def _schedule(self) -> Schedule | None:
        interval_s = self._plan.interval_s
        return Schedule(interval_s, self._clock, self._control) if interval_s > 0 else None

    def _apply(self, exposure_s: float, role: Role, writer: FrameWriter) -> None:
        applied = self.configure(exposure_s)
        if not same_exposure(applied.exposure_s, exposure_s):
            raise SessionError(
                f"the camera applied {exposure_text(applied.exposure_s, 6)} where the plan asks for "
                f"{exposure_text(exposure_s, 6)}: put an exposure it can keep into plan.exposures_s"
            )
        writer.put_event("camera settings", {"role": role, "settings": asdict(applied)})

    def _noting(self, writer: FrameWriter, role: Role, exposure_s: float) -> Refused:
        """Return a callback that records and counts incomplete frames."""
        note = noted(writer.put_event, {"role": role, "exposure_s": exposure_s})

        def refuse(error: IncompleteFrameError) -> None:
            self._n_losses += 1
            note(error)

        return refuse

    def _announcing(self, role: Role, shown: str | None, exposure_s: float, discard: int) -> Callable[[int], None]:
        """Return a callback that announces the next frames to a simulated bench before each start of a stream."""
        # With those that no longer count: what is taken again has other noise.
        known = [r for r in self._session.records if isinstance(r, FrameRecord) and r.role == role]
        n_recorded = len(frames_at(known, exposure_s, shown))

        def announce(n_taken: int) -> None:
            if self._bench is not None:
                # Nobody knows how many exposures a loss took: what follows it has other noise.
                series = f"{role}, {shown}, {exposure_s} s, {self._n_losses} losses"
                self._bench.announce_frames(series, n_recorded + n_taken, discard)

        return announce

    def _note_gaps(self, add_event: Callable[[str, Mapping[str, Any]], object]) -> None:
        for gap in self._camera.gaps[self._gaps_noted :]:
            self._gaps_noted += 1
            self._n_losses += 1
            times = {"lost_at": gap.lost_at.isoformat(), "back_at": gap.back_at.isoformat()}
            content = times | {"duration_s": gap.duration_s, "reason": gap.reason}
            add_event(CAMERA_RETURNED, content)
            _log.warning("the camera was lost for %.1f s and is connected again (%s)", gap.duration_s, gap.reason)

    def _note_throughput(self, writer: FrameWriter) -> None:
        went = writer.throughput
        if went.limited_by_disk:
            rate = went.frames_per_s
            _log.warning("limited by the disk: %.3g frames/s, no frame was lost", rate)
            self._session.add_event("limited by the disk", asdict(went) | {"frames_per_s": rate})


def _above(black_dn: float | None, numbers: Sequence[PatchNumbers]) -> tuple[PatchNumbers, ...]:
    return tuple(replace(n, black_dn=black_dn or 0.0) for n in numbers)


def _steady(seen: Sequence[tuple[float, float]], within_c: float) -> bool:
    temperatures_c = [temperature_c for _, temperature_c in seen]
    covered = bool(seen) and seen[-1][0] - seen[0][0] >= 0.9 * _STEADY_S
    return covered and max(temperatures_c) - min(temperatures_c) <= within_c
