"""A pulsed lamp as a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..lamp import CaptureTime, PulsedLamp
from ..parameters import Fraction, Luminance, Number, Ratio, Whole
from .scene import Level, Levelled

#: Seeds of the phase stand apart from those of the noise.
_PHASE_KEY = 0x6C616D70


@dataclass(frozen=True)
class LampScene(Levelled):
    """A pulsed lamp in the middle of even surroundings.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    luminance_cd_m2 : float
        Luminance of the lamp as a meter and the eye see it: its mean over time.
    background_cd_m2 : float
        Luminance of the surroundings.
    side_px : int
        Side of the square lamp.
    frequency_hz, duty, off_level
        As of `labcdp.chain.PulsedLamp`.
    phase : float or None
        Phase of the lamp at which the frame begins, in periods after the start of a pulse; None for one at random:
        by the seed in a simulation, all with the same probability in a prediction.

    Raises
    ------
    InputError
        If a value is out of its range, or the lamp is larger than the scene.

    Examples
    --------
    >>> from labcdp.chain import CaptureTime, LampScene
    >>> scene = LampScene(40, 30, 20.0, 2.0, side_px=10, frequency_hz=90, duty=0.1, phase=0.5)
    >>> scene.seen_by(CaptureTime(0.001, 0.0)).luminance_cd_m2  # between two pulses
    0.0
    >>> scene.seen_by(CaptureTime(1 / 90, 0.0)).luminance_cd_m2  # over a period
    20.0
    """

    luminance_cd_m2: Luminance
    background_cd_m2: Luminance
    side_px: Annotated[int, Whole("pixels", 1)]
    frequency_hz: Annotated[float, Number("Hz", 1e-3, 1e7)]
    duty: Fraction
    off_level: Annotated[float, Ratio("(a fraction)", 0, 1)] = 0.0
    phase: Annotated[float | None, Number("periods", 0, 1)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.side_px > min(self.shape):
            raise InputError(
                f"side_px is {self.side_px}, but the scene is {self.width} x {self.height} pixels: give a smaller lamp",
                key="side_px",
            )

    @property
    def lamp(self) -> PulsedLamp:
        """The lamp without its surroundings."""
        return PulsedLamp(self.frequency_hz, self.duty, self.off_level)

    def seen_by(self, time: CaptureTime, seed: int = 0) -> LampScene:
        """Return the steady scene that has the light of a capture.

        Parameters
        ----------
        time : CaptureTime
            Exposure time, and start after that of the frame.
        seed : int
            Decides a phase at random, the same for all captures of a frame.
        """
        phase = self.phase
        if phase is None:
            phase = float(np.random.default_rng([_PHASE_KEY, seed]).uniform())
        collected_s = self.lamp.collected(time.exposure_s, phase + time.start_s * self.frequency_hz)
        # Rounding of an integral of pulses is no light.
        luminance = round(self.luminance_cd_m2 * (collected_s / time.exposure_s / self.lamp.mean_level), 12)
        return replace(self, luminance_cd_m2=luminance, duty=1.0)

    def levels(self) -> Sequence[Level]:
        """Return the level of each region that is seen, with its share of the area."""
        lamp, every = self.side_px**2, self.width * self.height
        rows = (("background", self.background_cd_m2, every - lamp), ("lamp", self.luminance_cd_m2, lamp))
        return tuple(Level(name, luminance, count / every) for name, luminance, count in rows if count)

    def layout(self) -> tuple[Mapping[str, float], NDArray[np.intp]]:
        """Return the surroundings as ``background``, and the ``lamp`` with its mean luminance over time."""
        owner = np.zeros(self.shape, np.intp)
        top, left = (self.height - self.side_px) // 2, (self.width - self.side_px) // 2
        owner[top : top + self.side_px, left : left + self.side_px] = 1
        return {"background": self.background_cd_m2, "lamp": self.luminance_cd_m2}, owner

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return the lamp and its surroundings, by their mean luminance over time; nothing if only the lamp is seen."""
        if self.luminance_cd_m2 == self.background_cd_m2 or self.side_px**2 == self.width * self.height:
            return ()
        names = ("background", "lamp")
        return (names if self.luminance_cd_m2 > self.background_cd_m2 else names[::-1],)
