"""Address of a camera in the wrong network, changed on request."""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address, IPv4Interface

from ...core.errors import InputError
from ..camera import CameraError, CameraNotFoundError
from ..host.network import Interface, interfaces
from . import gvcp


def set_address(serial: str, wanted: str) -> IPv4Interface:
    """Give a camera an address of a network of this computer, until it is switched off.

    Parameters
    ----------
    serial : str
        Serial number of the camera, which may be in any network behind the interface with that of the new address.
    wanted : str
        IPv4 address.

    Returns
    -------
    IPv4Interface
        The new address with its network.

    Raises
    ------
    InputError
        If the address is not one of a device in a network of this computer, or another device has it.
    CameraNotFoundError
        If no such camera answers there.
    CameraError
        If it does not confirm, or the interface cannot be used.
    """
    known = interfaces()
    try:
        address = IPv4Address(wanted)
    except AddressValueError:
        raise InputError(f"the address is {wanted!r}: give an IPv4 address such as 192.168.7.20") from None
    interface = next((one for one in known if address in one.address.network), None)
    if interface is None:
        listing = ", ".join(f"{one.name} ({one.address.network})" for one in known)
        raise InputError(f"{address} is in no network of this computer: choose one of {listing}")
    if any(one.address.ip == address for one in known):
        raise InputError(f"{address} is an address of this computer: choose another one")
    network = interface.address.network
    # A network of 31 bits has neither (RFC 3021).
    if network.prefixlen < 31 and address in (network.network_address, network.broadcast_address):
        raise InputError(f"{address} is the network's or the broadcast address of {network}: choose one in between")
    try:
        return _set_address(interface, serial, address)
    except OSError as error:
        raise CameraError(f"{interface.name} cannot be used ({error.strerror}): run the command with sudo") from error


def _set_address(interface: Interface, serial: str, address: IPv4Address) -> IPv4Interface:
    found = gvcp.announce_all(interface.name)
    camera = next((one for one in found if one.serial == serial), None)
    if camera is None:
        listing = ", ".join(f"{one.serial} at {one.address}" for one in found) or "none"
        raise CameraNotFoundError(
            f"no camera {serial} answers at {interface.name}; found: {listing}: check power, cable and serial number"
        )
    if any(one.address == str(address) for one in found if one is not camera):
        raise InputError(f"{address} is the address of another camera: choose another one")
    new = IPv4Interface(f"{address}/{interface.address.network.prefixlen}")
    if not gvcp.force_address(interface.name, camera.mac, new):
        raise CameraError(f"camera {serial} did not confirm {new}: end the program that controls it, or switch it off")
    return new
