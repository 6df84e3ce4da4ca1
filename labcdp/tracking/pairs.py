"""Regions that moved together: a jump of one against the other is noticed."""

from __future__ import annotations

from math import dist

#: Pixels a frame by which two regions that move together may differ as a rule, and by which one of them jumps.
_TOGETHER_PX, _JUMP_PX = 1.5, 6.0
#: Pixels by which a region is doubted that is not where another one's motion carries it, beside some times the usual.
_DOUBT_PX, _DOUBT_USUAL = 0.5, 3.0
#: Part of what is new in a frame that is remembered.
_LEARNT = 0.2


class Companions:
    """Watches the steps of regions against each other."""

    def __init__(self) -> None:
        self._apart: dict[tuple[int, int], float] = {}
        self._off: dict[tuple[int, int], float] = {}

    def jumped(self, steps: dict[int, tuple[float, float]], expected: dict[int, tuple[float, float]]) -> set[int]:
        """Which regions jumped against one they moved with.

        Parameters
        ----------
        steps : dict of int to (float, float)
            Steps in pixels since the frame before of the regions seen in both.
        expected : dict of int to (float, float)
            The steps that were expected of them.

        Returns
        -------
        set of int
            Of two such regions the one whose step was expected less.
        """
        jumped = set()
        for a in steps:
            for b in steps:
                if a >= b:
                    continue
                apart = dist(steps[a], steps[b])
                usual = self._apart.get((a, b))
                if usual is not None and usual < _TOGETHER_PX and apart > _JUMP_PX + usual:
                    off = {key: dist(steps[key], expected[key]) for key in (a, b)}
                    jumped.add(max(off, key=lambda key: off[key]))
                    continue
                self._apart[a, b] = apart if usual is None else usual + _LEARNT * (apart - usual)
        return jumped

    def doubted(self, off: dict[tuple[int, int], float]) -> list[tuple[int, int]]:
        """Which pairs, moved as one thing until now, do so no longer.

        Parameters
        ----------
        off : dict of (int, int) to float
            Pixels from where the second region's motion since the first frame carries the first one to where it is.

        Returns
        -------
        list of (int, int)
            Such pairs.
        """
        doubted = []
        for pair, this in off.items():
            usual = self._off.get(pair, this)
            if usual < _TOGETHER_PX and this > _DOUBT_PX + _DOUBT_USUAL * usual:
                doubted.append(pair)
            self._off[pair] = usual + _LEARNT * (this - usual)
        return doubted
