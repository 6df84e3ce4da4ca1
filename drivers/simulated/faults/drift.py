"""Drifts: temperature and light of the simulated bench as functions of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ....core.clock import Clock
from .commands import Command


@dataclass(frozen=True)
class _Begun:
    """A drift and its start time on the clock."""

    drift: Command
    at_s: float

    def change(self, now_s: float) -> float:
        """Return the current amount of the change."""
        duration_s = self.drift.duration_s or 0.0
        return self.drift.number * (1.0 if duration_s == 0 else min(1.0, max(0.0, (now_s - self.at_s) / duration_s)))


class Drifts:
    """Temperature and light as they change with a clock.

    Parameters
    ----------
    clock : Clock
        Clock of the drifts.
    temperature_c : float
        Temperature at the beginning, in degrees Celsius.
    """

    def __init__(self, clock: Clock, temperature_c: float) -> None:
        self._clock = clock
        self._temperature_c = temperature_c
        self._begun: tuple[_Begun, ...] = ()

    def begin(self, drift: Command) -> None:
        """Start a drift now, in addition to existing ones."""
        self._begun = (*self._begun, _Begun(drift, self._clock.monotonic_s()))

    @property
    def begun(self) -> bool:
        """Whether there are any drifts."""
        return bool(self._begun)

    def temperature_c(self) -> float:
        """Temperature now, in degrees Celsius."""
        return self._temperature_c + sum(self._changes("temperature"))

    def light_rel(self) -> float:
        """Return the current light, relative to that at the start."""
        light = 1.0
        for change in self._changes("light"):
            light *= 1 + change
        return light

    def _changes(self, quantity: Literal["temperature", "light"]) -> list[float]:
        now_s = self._clock.monotonic_s()
        return [begun.change(now_s) for begun in self._begun if begun.drift.kind == quantity]
