"""Rendering of frames in a thread of its own, so that the camera answers meanwhile."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .device import FORMATS, FrameSource, Readout
from .genicam import feature

_GAIN_STEPS_PER_DB: Final = feature("Gain")["steps"]

#: Frames rendered ahead: one to send while the next is made.
_AHEAD: Final = 2

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


class FrameRenderer:
    """Frames rendered ahead, each sent once.

    Parameters
    ----------
    source : FrameSource
        Source of the pixels.
    """

    def __init__(self, source: FrameSource) -> None:
        self._source = source
        self._executor: ThreadPoolExecutor | None = None
        self._kind: Hashable = None
        self._coming: deque[Future[_Rendered]] = deque()
        self._n_begun = 0

    def open(self) -> None:
        """Start the rendering thread."""
        self._executor = ThreadPoolExecutor(1, "simulated camera")

    def close(self) -> None:
        """Stop rendering; may be called twice."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None
            self._coming.clear()

    def next(self, wanted: Wanted) -> NDArray[np.uint8] | None:
        """Return the next frame, or None if it is not rendered yet."""
        state = self._source.state
        if (state, wanted) != self._kind:
            self._kind = (state, wanted)
            for outdated in self._coming:
                outdated.cancel()
            self._coming.clear()
        frame = None
        if self._coming and self._coming[0].done():
            shown, rendered = self._coming.popleft().result()
            frame = rendered if shown == state else None
        while len(self._coming) < _AHEAD and self._executor is not None:
            self._coming.append(self._executor.submit(self._render, wanted, self._n_begun))
            self._n_begun += 1
        return frame

    def _render(self, wanted: Wanted, index: int) -> _Rendered:
        state = self._source.state
        dn = self._source.expose(wanted.exposure_us * 1e-6, wanted.gain_steps / _GAIN_STEPS_PER_DB, index)
        if self._source.state != state:
            return state, None
        layout = next(form for form in FORMATS if form.code == wanted.format_code)
        return state, wanted.readout.payload(dn, layout)
