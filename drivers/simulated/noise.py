"""Keys of the noise that a simulated device draws next; a resumed acquisition draws the same noise again."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from itertools import count


def running() -> Iterator[tuple[int, ...]]:
    """Yield consecutive noise keys for exposures and readings that were not announced."""
    return ((number,) for number in count())


def announced(series: str, first: int, n_before: int = 0) -> Iterator[tuple[int, ...]]:
    """Yield keys of the noise of a series.

    Parameters
    ----------
    series : str
        Kind of exposure or reading; each series has noise of its own.
    first : int
        Number in the series of the first one that counts.
    n_before : int
        Number taken before it that do not count.

    Yields
    ------
    tuple of int
        For `numpy.random.SeedSequence` as its ``spawn_key``; never one of `running`.

    Examples
    --------
    A series that is continued has the keys that it would have had:

    >>> whole, rest = announced("dark", 0), announced("dark", 2)
    >>> [next(whole) for _ in range(3)][2] == next(rest)
    True
    """
    name = int.from_bytes(sha256(series.encode()).digest()[:8], "big")
    yield from ((name, first, number, 1) for number in range(n_before))
    yield from ((name, number, 0, 0) for number in count(first))
