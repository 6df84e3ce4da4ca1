"""Flicker of regions of the live image: each frame counts, not only those that the page shows."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from threading import Lock

import numpy as np

from ...acquire.live import region_values
from ...core.errors import InputError
from ...core.frame import Frame
from ...core.roi import Roi
from ...metrics.modulation import Flicker, flicker
from ...metrics.region import SATURATED_SHARE

#: Frames that are kept, and fewest of which flicker is shown.
MOST_FRAMES, FEWEST_FRAMES = 1200, 12
_NS = 1e-9


class FlickerTrace:
    """Light of regions in the last frames of a camera with one exposure.

    Parameters
    ----------
    regions : callable
        Returns the regions that count now.
    black_dn : callable
        Returns the black level in DN.

    Examples
    --------
    >>> from labcdp import Roi
    >>> from labcdp.web.bench.flicker import FlickerTrace
    >>> FlickerTrace(lambda: (Roi.rectangle("lamp", 0, 0, 8, 8),), lambda: 0.0).n_frames
    0
    """

    def __init__(self, regions: Callable[[], Sequence[Roi]], black_dn: Callable[[], float]) -> None:
        self._regions, self._black_dn = regions, black_dn
        self._lock = Lock()
        self._of: tuple[object, ...] = ()
        self._times_s: deque[float] = deque(maxlen=MOST_FRAMES)
        self._values: dict[Roi, deque[float]] = {}

    @property
    def n_frames(self) -> int:
        """Frames so far, with these regions and settings."""
        return len(self._times_s)

    def add(self, frame: Frame) -> None:
        """Add a frame, in the camera's thread; other regions or settings begin anew."""
        regions, black_dn = tuple(self._regions()), self._black_dn()
        means = {}
        for roi in regions:
            means[roi] = float("nan")
            with suppress(InputError):
                values = region_values(frame, roi)
                if np.mean(values >= frame.linear_saturation_dn) <= SATURATED_SHARE:
                    means[roi] = float(values.mean(dtype=np.float64)) - black_dn
        of = (regions, frame.exposure_s, frame.gain_db, black_dn)
        time_s = frame.camera_timestamp_ns * _NS or frame.timestamp.timestamp()
        with self._lock:
            if of != self._of or (self._times_s and time_s <= self._times_s[-1]):
                self._of = of
                self._times_s.clear()
                self._values = {roi: deque(maxlen=MOST_FRAMES) for roi in regions}
            self._times_s.append(time_s)
            for roi, mean in means.items():
                self._values[roi].append(mean)

    def measured(self) -> Iterator[Mapping[str, Flicker]]:
        """Yield the flicker of each region by its name, once; none of too few frames."""
        with self._lock:
            times_s = np.array(self._times_s)
            values = {roi.name: np.array(means) for roi, means in self._values.items()}
        if times_s.size < FEWEST_FRAMES:
            yield {}
            return
        yield {name: flicker(means, times_s=times_s) for name, means in values.items() if np.isfinite(means).any()}
