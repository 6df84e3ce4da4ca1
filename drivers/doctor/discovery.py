"""Possible causes if no camera is found."""

from __future__ import annotations

from collections.abc import Sequence

from ..host.finding import Finding, State
from ..host.kernel import open_firewall
from ..host.network import Interface

_BY_HAND = "check that it has power, its cable, and that it is in the network of one of these interfaces"


def no_camera_finding(known: Sequence[Interface], firewall: str | None, state: State) -> Finding:
    """List possible causes of a camera that does not answer.

    Parameters
    ----------
    known : sequence of Interface
        The computer's.
    firewall : str or None
        Name of an active firewall; empty if none is known.
    state : {'notice', 'fault'}
        Whether a camera was expected.
    """
    ways = [one for one in known if not one.is_loopback and one.is_up and one.has_link]
    topic = "discovery"
    if not ways:
        return Finding(
            topic,
            state,
            "no camera answers, and no network interface with an IPv4 address has a link",
            "connect the camera, give it power, and see the network interfaces above",
        )
    listing = ", ".join(f"{one.name} ({one.address})" for one in ways)
    if firewall is None:
        return Finding(topic, state, f"no camera answers at {listing}", _BY_HAND)
    networks = "; ".join(open_firewall(firewall, str(one.address.network)) for one in ways)
    return Finding(
        topic,
        state,
        f"no camera answers at {listing}, and the firewall {firewall} may keep its answer out",
        f"{_BY_HAND}; then {networks}",
    )
