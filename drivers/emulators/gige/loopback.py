"""Addresses of the loopback interface: a second camera needs one of its own, because GVCP's port is fixed."""

from __future__ import annotations

import errno
import fcntl
import ipaddress
import socket
import struct
from contextlib import suppress

GVCP_PORT = 3956

_SET_ADDRESS, _SET_MASK, _GET_FLAGS, _SET_FLAGS, _GET_ADDRESS = 0x8916, 0x891C, 0x8913, 0x8914, 0x8915
_UP = 0x1


def require_loopback(address: str) -> None:
    """Raise `ValueError` for an address outside 127.0.0.0/8."""
    if not ipaddress.ip_address(address).is_loopback:
        raise ValueError(f"{address} is not a loopback address; choose one from 127.0.0.0/8")


def require_free(address: str) -> None:
    """Raise `OSError` when another camera answers at an address; Aravis would not tell."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, GVCP_PORT))
        except OSError as err:
            raise OSError(f"{address} port {GVCP_PORT} is taken ({err.strerror}); end the other camera") from err


def add_address(address: str) -> bool:
    """Give the loopback interface an address; False when it has it. Raises `OSError` that tells the command."""
    require_loopback(address)
    if address in (_address_of("lo"), _address_of(_alias(address))):
        return False
    try:
        _control(_alias(address), _SET_ADDRESS, _internet(address))
        _control(_alias(address), _SET_MASK, _internet("255.0.0.0"))
    except OSError as err:
        if err.errno == errno.EEXIST:  # given by another program
            return False
        raise OSError(f"lo has no address {address}; run: ip addr add {address}/8 dev lo") from err
    return True


def remove_address(address: str) -> None:
    """Take an address away that `add_address` gave."""
    with suppress(OSError):
        _control(_alias(address), _SET_FLAGS, struct.pack("h", 0))


def bring_up() -> None:
    """Switch the loopback interface on, in a network namespace of one's own. Raises `OSError`."""
    (flags,) = struct.unpack_from("h", _control("lo", _GET_FLAGS, bytes(16)), 16)
    _control("lo", _SET_FLAGS, struct.pack("h", flags | _UP))


def _alias(address: str) -> str:
    return f"lo:{address.rpartition('.')[2]}"


def _address_of(interface: str) -> str | None:
    try:
        answer = _control(interface, _GET_ADDRESS, bytes(16))
    except OSError:
        return None
    return socket.inet_ntoa(answer[20:24])


def _internet(address: str) -> bytes:
    return struct.pack("hH4s8x", socket.AF_INET, 0, socket.inet_aton(address))


def _control(interface: str, request: int, content: bytes) -> bytes:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        message = struct.pack("16s", interface.encode()) + content.ljust(24, b"\0")
        return fcntl.ioctl(any_socket, request, message)
