"""The operator: manual steps at the bench, by the user or the simulated bench."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Literal, Protocol

from ..core.errors import DeviceError
from ..drivers.shutter import Shutter
from .checks import CheckFinding


class Operator(Protocol):
    """Performs manual steps; each method returns when its step is done.

    Examples
    --------
    >>> from labcdp.acquire import Operator, Unattended
    >>> operator: Operator = Unattended("covered")
    >>> operator.cover_lens()
    """

    def cover_lens(self) -> None:
        """Cover the lens."""

    def uncover_lens(self) -> None:
        """Uncover the lens."""

    def point_meter(self, patch: str) -> None:
        """Point the luminance meter at the centre of a patch."""

    def show_patch(self, patch: str) -> None:
        """Place a patch in front of camera and meter, where patches are shown one by one."""

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Decide whether to repeat a unit because of its problems."""


class AskedOperator:
    """A person who is asked for each manual step; `request` and `repeat` say how.

    Parameters
    ----------
    hands : Operator or None
        The simulated bench, which then does what the person confirmed.

    Examples
    --------
    >>> from labcdp.acquire import AskedOperator
    >>> class Told(AskedOperator):
    ...     def request(self, step: str, patch: str = "") -> None:
    ...         print(step)
    >>> Told().cover_lens()
    Cover the lens
    """

    def __init__(self, hands: Operator | None = None) -> None:
        self._hands = hands

    def request(self, step: str, patch: str = "") -> None:
        """Ask for a step, which is about a patch or none, and return when it is done."""
        raise NotImplementedError

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Ask whether to repeat a unit."""
        raise NotImplementedError

    def cover_lens(self) -> None:
        """Ask for the cap."""
        self._have_done("cover_lens", "Cover the lens")

    def uncover_lens(self) -> None:
        """Ask for a free lens."""
        self._have_done("uncover_lens", "Uncover the lens and light the target")

    def point_meter(self, patch: str) -> None:
        """Ask for the meter to be pointed."""
        self._have_done("point_meter", f"Point the luminance meter at the centre of patch {patch}", patch)

    def show_patch(self, patch: str) -> None:
        """Ask for the next patch."""
        self._have_done("show_patch", f"Place patch {patch} in front of camera and luminance meter", patch)

    def _have_done(self, name: str, step: str, *patch: str) -> None:
        self.request(step, *patch)
        if self._hands is not None:
            getattr(self._hands, name)(*patch)


class ShutterOperator:
    """An operator whose dark frames a shutter or lamp makes: no hand covers the lens.

    Parameters
    ----------
    shutter : Shutter
        Open. It is set to 0 for dark frames and to 1 for all others.
    other : Operator
        Performs the other steps.

    Examples
    --------
    >>> from labcdp.acquire import ShutterOperator, Unattended
    >>> from labcdp.drivers.simulated.shutter import SimulatedShutter
    >>> operator = ShutterOperator(SimulatedShutter(print), Unattended())
    >>> operator.cover_lens()
    0.0
    """

    def __init__(self, shutter: Shutter, other: Operator) -> None:
        self._shutter = shutter
        self._other = other

    def cover_lens(self) -> None:
        """Make it dark; raises ShutterError."""
        self._shutter.set(0.0)

    def uncover_lens(self) -> None:
        """Let all light through; raises ShutterError."""
        self._shutter.set(1.0)

    def point_meter(self, patch: str) -> None:
        """Have the meter pointed."""
        self._other.point_meter(patch)

    def show_patch(self, patch: str) -> None:
        """Have a patch shown."""
        self._other.show_patch(patch)

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Have it decided."""
        return self._other.repeat(what, findings)


class HandNeededError(DeviceError):
    """A manual step is required, but no operator is present.

    Examples
    --------
    >>> from labcdp.acquire import HandNeededError, Unattended
    >>> try:
    ...     Unattended().show_patch("a")
    ... except HandNeededError as error:
    ...     print(error)
    put each patch before camera and meter
    """


class Unattended:
    """Unattended bench: manual steps are refused, so that an acquisition skips them.

    Parameters
    ----------
    lens : {'uncovered', 'covered'}
        State of the lens cap.

    Examples
    --------
    >>> from labcdp.acquire import CheckFinding, Unattended
    >>> operator = Unattended()
    >>> flicker = CheckFinding("flicker", "the light flickers", value=0.03, limit=0.01)
    >>> [operator.repeat("light frames", [flicker]) for _ in range(2)]
    [True, False]
    """

    def __init__(self, lens: Literal["uncovered", "covered"] = "uncovered") -> None:
        self._lens = lens
        self._repeated: set[str] = set()

    def cover_lens(self) -> None:
        """Refuse, unless the cap is on the lens."""
        if self._lens != "covered":
            raise HandNeededError("cover the lens")

    def uncover_lens(self) -> None:
        """Refuse, unless the lens is free."""
        if self._lens != "uncovered":
            raise HandNeededError("uncover the lens and light the target")

    def point_meter(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("point the luminance meter at each patch")

    def show_patch(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("put each patch before camera and meter")

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Repeat a unit once if that may solve the problem without a manual step."""
        again = what not in self._repeated and any(finding.passing for finding in findings)
        self._repeated.add(what)
        return again


class LensCap:
    """State of the lens cap, which an operator moves.

    Parameters
    ----------
    operator : Operator
        Moves the cap.
    """

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._is: Literal["unknown", "on", "off"] = "unknown"

    def on(self) -> None:
        """Ensure that the lens is covered; raises HandNeededError."""
        if self._is != "on":
            self._operator.cover_lens()
            self._is = "on"

    def off(self) -> None:
        """Ensure that the lens is uncovered; raises HandNeededError."""
        if self._is != "off":
            self._operator.uncover_lens()
            self._is = "off"

    def leave_off(self) -> None:
        """Remove the cap at the end if it was put on and an operator is present."""
        if self._is == "on":
            with suppress(HandNeededError):
                self.off()
