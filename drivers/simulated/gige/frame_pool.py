"""Rendering of frames in a thread of its own, so that the camera answers meanwhile."""

from __future__ import annotations

from collections.abc import Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .device import FORMATS, FrameSource, Readout
from .genicam import GAIN_STEPS_PER_DB

#: A frame as bytes, with the state of the source that it shows; None if the state changed while it was rendered.
_Rendered = tuple[Hashable, NDArray[np.uint8] | None]


@dataclass(frozen=True)
class Wanted:
    """Specification of a frame.

    Parameters
    ----------
    exposure_us, gain_steps, format_code : int
        Values of the registers.
    readout : Readout
        Readout of the sensor.
    """

    exposure_us: int
    gain_steps: int
    format_code: int
    readout: Readout


class FramePool:
    """Rendered frames of one kind, sent in turn once there are enough.

    Parameters
    ----------
    source : FrameSource
        Source of the pixels.
    size : int
        Number of frames rendered per kind.
    """

    def __init__(self, source: FrameSource, size: int) -> None:
        self._source = source
        self._size = size
        self._executor: ThreadPoolExecutor | None = None
        self._kind: Hashable = None
        self._frames: tuple[NDArray[np.uint8], ...] = ()
        self._coming: Future[_Rendered] | None = None
        self._n_sent = 0

    def open(self) -> None:
        """Start the rendering thread."""
        self._executor = ThreadPoolExecutor(1, "simulated camera")

    def close(self) -> None:
        """Stop rendering; may be called twice."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = self._coming = None

    def next(self, wanted: Wanted) -> NDArray[np.uint8] | None:
        """Return the next frame, or None if it is not rendered yet."""
        state = self._source.state
        if (state, wanted) != self._kind:
            self._kind, self._frames, self._coming = (state, wanted), (), None
        if len(self._frames) < self._size:
            frame = self._arrived(state)
            if frame is not None:
                self._frames = (*self._frames, frame)
                self._n_sent += 1
            if self._coming is None and self._executor is not None and len(self._frames) < self._size:
                self._coming = self._executor.submit(self._render, wanted, self._n_sent)
            return frame
        self._n_sent += 1
        return self._frames[(self._n_sent - 1) % self._size]

    def _arrived(self, state: Hashable) -> NDArray[np.uint8] | None:
        if self._coming is None or not self._coming.done():
            return None
        coming, self._coming = self._coming, None
        shown, frame = coming.result()
        return frame if shown == state else None

    def _render(self, wanted: Wanted, index: int) -> _Rendered:
        state = self._source.state
        dn = self._source.expose(wanted.exposure_us * 1e-6, wanted.gain_steps / GAIN_STEPS_PER_DB, index)
        if self._source.state != state:
            return state, None
        layout = next(form for form in FORMATS if form.code == wanted.format_code)
        return state, wanted.readout.payload(dn, layout)
