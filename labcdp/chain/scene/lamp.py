"""A pulsed lamp as a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..lamp import PulsedLamp
from ..parameters import Fraction, Luminance, Number, Ratio, Whole
from .scene import Levelled

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
        Phase of the lamp at which the exposure begins, in periods after the start of a pulse; None for one at random:
        by the seed in a simulation, all with the same probability in a prediction.

    Raises
    ------
    InputError
        If a value is out of its range, or the lamp is larger than the scene.

    Examples
    --------
    >>> from labcdp.chain import LampScene
    >>> scene = LampScene(40, 30, 20.0, 2.0, side_px=10, frequency_hz=90, duty=0.1, phase=0.5)
    >>> scene.exposed(0.001).luminance_cd_m2, scene.exposed(1 / 90).luminance_cd_m2  # between pulses, and over a period
    (0.0, 20.0)
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

    def exposed(self, exposure_s: float, seed: int = 0) -> LampScene:
        """Return the steady scene that has the light of a frame.

        Parameters
        ----------
        exposure_s : float
            Exposure time.
        seed : int
            Decides a phase at random.
        """
        phase = self.phase
        if phase is None:
            phase = float(np.random.default_rng([_PHASE_KEY, seed]).uniform())
        share = self.lamp.collected(exposure_s, phase) / exposure_s / self.lamp.mean_level
        # Rounding of an integral of pulses is no light.
        luminance = round(self.luminance_cd_m2 * share, 12)
        return replace(self, luminance_cd_m2=luminance, duty=1.0)

    def at_phases(self, n: int) -> list[LampScene]:
        """Return the scene at so many phases at equal distances, or as it is if its phase is known."""
        if self.phase is not None:
            return [self]
        return [replace(self, phase=(index + 0.5) / n) for index in range(n)]

    def layout(self) -> tuple[Mapping[str, float], NDArray[np.intp]]:
        """Return the surroundings as ``background``, and the ``lamp`` with its mean luminance over time."""
        owner = np.zeros(self.shape, np.intp)
        top, left = (self.height - self.side_px) // 2, (self.width - self.side_px) // 2
        owner[top : top + self.side_px, left : left + self.side_px] = 1
        return {"background": self.background_cd_m2, "lamp": self.luminance_cd_m2}, owner

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return the lamp and its surroundings, by their mean luminance over time."""
        if self.luminance_cd_m2 == self.background_cd_m2:
            return ()
        names = ("background", "lamp")
        return (names if self.luminance_cd_m2 > self.background_cd_m2 else names[::-1],)


def light_of_frame(scene: Any, exposures_s: Sequence[float], seed: int) -> Any:
    """Return the scene whose light a frame has: that of the exposure for a pulsed lamp, else the scene itself.

    Raises
    ------
    InputError
        If captures of different exposure times see a pulsed lamp.
    """
    if not isinstance(scene, LampScene) or not exposures_s:
        return scene
    times = sorted(set(exposures_s))
    if len(times) > 1:
        raise InputError(
            f"captures of {times[0]:g} s to {times[-1]:g} s see different light of a pulsed lamp: give one exposure "
            "time, or predict its flicker with labcdp.chain.PulsedLamp.flicker"
        )
    return scene.exposed(times[0], seed)
