"""The network interface towards a GigE camera, and how large its packets may be."""

from __future__ import annotations

import fcntl
import ipaddress
import logging
import os
import socket
import struct
from pathlib import Path
from typing import Any

from drivers.cameras.aravis.options import AravisOptions

LARGEST_PACKET_BYTES = 9000
SMALL_MTU_BYTES = 1500

_GET_ADDRESS = 0x8915
_FORCE_RECEIVE_BUFFER = 33
"""SO_RCVBUFFORCE: beyond net.core.rmem_max, for who has CAP_NET_ADMIN."""
_log = logging.getLogger(__name__)


def on_loopback(camera: Any) -> bool:
    """Whether a GigE camera is reached through the loopback interface: an emulated one."""
    return ipaddress.ip_address(_local_address(camera)).is_loopback


def set_packets(camera: Any, options: AravisOptions, device: str) -> int:
    """Settle packet size and pause of an open GigE camera; returns the size in bytes.

    Without a size in the options camera and network try which packets arrive; a camera on loopback gets 9000 bytes.
    Warns once per connection of a link without jumbo frames.
    """
    if options.packet_size_bytes is not None:
        camera.gv_set_packet_size(options.packet_size_bytes)
    elif on_loopback(camera):
        camera.gv_set_packet_size(LARGEST_PACKET_BYTES)
    else:
        camera.gv_auto_packet_size()
    if options.packet_delay_us > 0.0:
        camera.gv_set_packet_delay(round(1e3 * options.packet_delay_us))
    size_bytes = int(camera.gv_get_packet_size())
    interface, mtu_bytes = interface_of(_local_address(camera))
    if size_bytes > mtu_bytes:
        _log.warning(
            "%s: packets of %d bytes do not fit %s, whose MTU is %d; run: ip link set %s mtu %d",
            device, size_bytes, interface, mtu_bytes, interface, size_bytes,
        )  # fmt: skip
    elif size_bytes <= SMALL_MTU_BYTES:
        _log.warning(
            "%s: packets of only %d bytes (MTU of %s: %d), so frames may be lost; run: ip link set %s mtu 9000, "
            "and switch on jumbo frames in any switch between",
            device, size_bytes, interface, mtu_bytes, interface,
        )  # fmt: skip
    return size_bytes


def enlarge_receive_buffer(port: int, wanted_bytes: int, device: str) -> None:
    """Give the stream that receives at a UDP port its buffer before the first frame comes.

    Aravis does it when the first packet is there: then most of the first frame is lost already. Warns where the kernel
    allows less.
    """
    for entry in os.listdir("/proc/self/fd"):
        try:
            if not os.readlink(f"/proc/self/fd/{entry}").startswith("socket:"):
                continue
            twin = socket.socket(fileno=os.dup(int(entry)))
        except OSError:  # closed meanwhile
            continue
        with twin:
            if twin.type != socket.SOCK_DGRAM or twin.family != socket.AF_INET or twin.getsockname()[1] != port:
                continue
            try:
                twin.setsockopt(socket.SOL_SOCKET, _FORCE_RECEIVE_BUFFER, wanted_bytes)
            except PermissionError:
                twin.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted_bytes)
            granted_bytes = twin.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2  # the kernel doubles it
            if granted_bytes < wanted_bytes:
                _log.warning(
                    "%s: a receive buffer of only %d of %d bytes, so frames may be lost; "
                    "run: sysctl -w net.core.rmem_max=%d",
                    device, granted_bytes, wanted_bytes, wanted_bytes,
                )  # fmt: skip


def interface_of(address: str) -> tuple[str, int]:
    """Name and MTU (bytes) of the interface with a local address; ("?", 65536) when none has it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for _, name in socket.if_nameindex():
            try:
                answer = fcntl.ioctl(any_socket, _GET_ADDRESS, struct.pack("16s24x", name.encode()))
            except OSError:  # an interface without an IPv4 address
                continue
            if socket.inet_ntoa(answer[20:24]) == address:
                return name, int(Path(f"/sys/class/net/{name}/mtu").read_text())
    return "?", 65_536


def _local_address(camera: Any) -> str:
    return camera.get_device().get_interface_address().get_address().to_string()
