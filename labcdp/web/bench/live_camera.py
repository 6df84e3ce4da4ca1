"""A live camera: one thread receives all its frames, the page shows the newest."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import fields, replace
from threading import Condition, Lock, Thread
from time import monotonic
from typing import Any, cast

from ...core.errors import LabcdpError
from ...core.frame import Frame
from ...drivers.camera import Camera, CameraSettingError, IncompleteFrameError
from ...drivers.camera_settings import CameraSetup, FeatureValue, Region
from .live import LiveState, WatchedCamera

#: Pause before a lost, busy or absent camera is looked for again.
_RETRY_S = 1.0
#: Longest wait of an acquisition for a lost camera or meter.
PATIENCE_S = 600.0
#: Frames of one grab; the next one follows immediately.
_MANY = 1_000_000
#: Weight of the newest interval in the frame rate.
_NEWEST = 0.1
#: How often settings are read back while frames are received.
_READ_BACK_S = 1.0
#: Settings of `Camera.configure`; the others are of a `CameraSetup`, or features.
_CONFIGURED = ("exposure_s", "gain_db", "pixel_format")
_SETUP = ("frame_rate_hz", "black_level", "region")
#: Value of a setting or feature.
Setting = FeatureValue | Region


class LiveCamera:
    """A camera that streams while somebody looks.

    Its thread opens the camera when the first viewer comes and releases it when the last one has gone. A lost camera is
    opened again, with the settings that were requested.

    Parameters
    ----------
    camera : Camera
        Closed.
    settings : dict
        Settings to begin with, as of `Camera.configure`.
    prepare : function
        Prepares the camera each time it was opened, before it is configured.
    stated : function of a frame
        Return it with what the plan states of the camera, as of `CameraConfiguration`.
    """

    def __init__(
        self,
        camera: Camera,
        settings: Mapping[str, Setting],
        prepare: Callable[[Camera], object] = lambda _camera: None,
        stated: Callable[[Frame], Frame] = lambda frame: frame,
    ) -> None:
        self._camera, self._prepare, self._stated = camera, prepare, stated
        self._changed = Condition()
        self._live = LiveState()
        self._n_viewers = 0
        #: Held by who has the camera open.
        self._open = Lock()
        self._ended = False
        #: Settings requested since the camera was configured, and all that were accepted before.
        self._requested: dict[str, Setting] = {}
        self._accepted = dict(settings)
        self._features_asked = True
        self._read_s = 0.0
        #: Called with each frame, in the camera's thread.
        self.watchers: list[Callable[[Frame], None]] = []
        self._thread = Thread(target=self._run, name="live camera", daemon=True)

    @property
    def live(self) -> LiveState:
        """Current state."""
        return self._live

    def start(self) -> None:
        """Start the thread; the camera is opened when somebody looks."""
        self._thread.start()

    def stop(self) -> None:
        """Release the camera and end the thread."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def look(self) -> Callable[[], None]:
        """Count a viewer; returns a function that ends the looking."""
        self._count_viewers(1)
        return lambda: self._count_viewers(-1)

    def request(self, **settings: Setting) -> None:
        """Change settings and features before the next frame; `Live.error` says which is rejected.

        Parameters
        ----------
        **settings : float, str, bool or Region
            As of `Camera.configure` and `CameraSetup`, or features by their GenICam names.
        """
        with self._changed:
            self._requested |= settings
            self._changed.notify_all()

    def read_features(self) -> None:
        """Read all features before the next frame, into `Live.features`."""
        self._features_asked = True

    def wait_for_news(self, seen: LiveState, timeout_s: float) -> LiveState:
        """Return the state once it differs from `seen`, or when the time is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._live is not seen or self._ended, timeout_s)
            return self._live

    @property
    def ended(self) -> bool:
        """Whether it was stopped."""
        return self._ended

    @contextmanager
    def lent(self) -> Iterator[Camera]:
        """Give the camera, open, to an acquisition; its frames are shown meanwhile."""
        self._publish(lent=True)
        try:
            with self._open:
                self.be_patient(PATIENCE_S)
                with self._camera as camera:
                    self._publish(settings=camera.settings, streaming=True, error="")
                    yield cast(Camera, WatchedCamera(camera, self._publish, self._receive))
        finally:
            self.be_patient(0.0)
            self._publish(streaming=False, rate_hz=0.0, lent=False)

    def be_patient(self, patience_s: float) -> None:
        """Wait this long within an acquisition when the camera is lost; 0 also ends a wait."""
        self._camera.be_patient(patience_s)

    def _count_viewers(self, more: int) -> None:
        with self._changed:
            self._n_viewers += more
            self._changed.notify_all()

    def _going(self) -> bool:
        return self._n_viewers > 0 and not self._ended and not self._live.lent

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._going() or self._ended)
            if self._ended:
                return
            try:
                with self._open, self._camera as camera:
                    self._stream(camera)
            except LabcdpError as error:
                self._publish(error=str(error), streaming=False, rate_hz=0.0)
                with self._changed:
                    self._changed.wait_for(lambda: self._ended, _RETRY_S)
            else:
                self._publish(streaming=False, rate_hz=0.0)

    def _stream(self, camera: Camera) -> None:
        self._prepare(camera)
        with self._changed:
            self._requested = self._accepted | self._requested
        self._configure(camera)
        while self._going():
            if self._requested:
                self._configure(camera)
            if self._features_asked:
                self._features_asked = False
                self._publish(features=camera.describe_features())
            grabbed = cast(Generator[Frame, None, None], camera.grab(_MANY, on_refused=self._refuse))
            with closing(grabbed) as frames:
                for frame in frames:
                    self._receive(frame)
                    if not self._going() or self._requested or self._features_asked or self._has_changed(camera):
                        break

    def _has_changed(self, camera: Camera) -> bool:
        """Read the settings back, now and then: frames state those of the start of the grab."""
        if monotonic() - self._read_s < _READ_BACK_S:
            return False
        self._read_s, before, now = monotonic(), self._live.settings, camera.settings
        if before is None or before == now:
            return False
        names = [field.name for field in fields(now)]
        both = ((name, getattr(before, name), getattr(now, name)) for name in names)
        self._publish(settings=now, changed=tuple(setting for setting in both if setting[1] != setting[2]))
        return True

    def _configure(self, camera: Camera) -> None:
        with self._changed:
            requested, self._requested = self._requested, {}
        errors = []
        # Each by itself: one that is rejected does not keep back the others.
        for name, value in requested.items():
            try:
                if name in _CONFIGURED:
                    camera.configure(**{name: value})  # type: ignore[arg-type]
                else:
                    is_feature = name not in _SETUP
                    given: dict[str, Any] = {"features": {name: value}} if is_feature else {name: value}
                    camera.prepare(CameraSetup(**given))
                    self._features_asked |= is_feature and bool(self._live.features)
                self._accepted[name] = value
            except CameraSettingError as rejected:
                # One that was accepted before is not asked for again; another value stays.
                if self._accepted.get(name) == value:
                    del self._accepted[name]
                errors.append(str(rejected))
        self._read_s = monotonic()
        self._publish(
            settings=camera.settings,
            exposure_range_s=camera.exposure_range_s,
            streaming=True,
            error="; ".join(errors),
            changed=(),
            received_s=self._read_s,
        )

    def _receive(self, frame: Frame) -> None:
        live, now_s = self._live, monotonic()
        period_s = max(now_s - live.received_s, 1e-6)
        rate_hz = 1 / (_NEWEST * period_s + (1 - _NEWEST) / live.rate_hz) if live.rate_hz else 1 / period_s
        stated = self._stated(frame)
        for watcher in self.watchers:
            watcher(stated)
        self._publish(frame=stated, n_frames=live.n_frames + 1, received_s=now_s, rate_hz=rate_hz)

    def _refuse(self, _error: IncompleteFrameError) -> None:
        self._publish(n_incomplete=self._live.n_incomplete + 1)

    def _publish(self, **changes: object) -> None:
        with self._changed:
            self._live = replace(self._live, **changes)  # type: ignore[arg-type]
            self._changed.notify_all()
