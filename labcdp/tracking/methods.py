"""The choice among the methods to follow regions."""

from __future__ import annotations

from collections.abc import Sequence

from ..core.errors import InputError

#: Ways to follow regions: see `make_tracker`.
METHODS = ("follow", "homography", "fixed")


def methods_of(method: str, names: Sequence[str]) -> tuple[str, ...]:
    """Say which method each region has.

    Parameters
    ----------
    method : str
        One of `METHODS` for all, or with others for some regions: ``"follow,wall=fixed"``.
    names : sequence of str
        Names of the regions.

    Raises
    ------
    InputError
        If a method or a region is unknown.

    Examples
    --------
    >>> from labcdp.tracking import methods_of
    >>> methods_of("follow", ["sign", "road"])
    ('follow', 'follow')
    """
    parts = [part.strip() for part in method.split(",")]
    general = next((part for part in parts if "=" not in part), METHODS[0])
    own: dict[str, str] = {}
    for part in parts:
        name, given, value = part.rpartition("=")
        if value not in METHODS or (not given and part != general):
            raise InputError(
                f"unknown tracking method {part!r}: give one of {', '.join(METHODS)}, or for one region NAME=METHOD"
            )
        if given:
            own[name] = value
    for name in own:
        if name not in names:
            raise InputError(f"method {method!r} names region {name!r}: the regions are {', '.join(names)}")
    return tuple(own.get(name, general) for name in names)


def method_among(method: str, names: Sequence[str], chosen: Sequence[str]) -> str:
    """Return the method of some of the regions as `methods_of` takes it for these alone.

    Parameters
    ----------
    method, names
        As for `methods_of`, of all regions.
    chosen : sequence of str
        Names of those that are followed.

    Raises
    ------
    InputError
        If a method or a region is unknown.

    Examples
    --------
    >>> from labcdp.tracking import method_among
    >>> method_among("follow,wall=fixed", ["car", "wall"], ["wall"])
    'fixed'
    """
    found = dict(zip(names, methods_of(method, names), strict=True))
    own = [found[name] for name in chosen]
    return own[0] if len(set(own)) == 1 else ",".join(f"{name}={found[name]}" for name in chosen)
