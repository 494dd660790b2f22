"""Packet size, MTU and the receive buffer: what is set, and what the operator is told to do."""

import os
import socket

import pytest

from drivers.cameras.aravis import AravisOptions, network
from drivers.cameras.aravis.network import enlarge_receive_buffer, interface_of, set_packets


class GigeCamera:
    """The part of an ``Aravis.Camera`` that packets need, at a local address, on a link that lets so much through."""

    def __init__(self, address="10.0.0.1", passes=8228):
        self._address = address
        self._passes = passes
        self.size = 1400
        self.delay_ns = 0

    def get_device(self):
        return self

    get_interface_address = get_address = get_device

    def to_string(self):
        return self._address

    def gv_set_packet_size(self, size):
        self.size = size

    def gv_auto_packet_size(self):
        self.size = self._passes

    def gv_get_packet_size(self):
        return self.size

    def gv_set_packet_delay(self, delay_ns):
        self.delay_ns = delay_ns


@pytest.fixture
def wire(monkeypatch):
    """Sets the MTU of the interface towards the camera."""

    def set_mtu(mtu):
        monkeypatch.setattr(network, "interface_of", lambda address: ("eth1", mtu))

    return set_mtu


def settle(camera, **options):
    return set_packets(camera, AravisOptions.model_validate(options), "primary")


def test_camera_and_network_agree_on_the_size(wire, caplog):
    wire(9000)
    assert settle(GigeCamera()) == 8228
    assert caplog.records == []


def test_loopback_takes_large_packets(caplog):
    assert settle(GigeCamera("127.0.0.1")) == 9000
    assert caplog.records == []


def test_a_link_without_jumbo_frames_is_warned_of(wire, caplog):
    wire(1500)
    assert settle(GigeCamera(passes=1500)) == 1500
    (record,) = caplog.records
    assert record.message.startswith("primary: packets of only 1500 bytes (MTU of eth1: 1500)")
    assert "ip link set eth1 mtu 9000" in record.message


def test_a_size_that_does_not_fit_the_link_is_warned_of(wire, caplog):
    wire(1500)
    camera = GigeCamera()
    assert settle(camera, packet_size_bytes=9000, packet_delay_us=2.5) == 9000
    assert camera.delay_ns == 2500
    assert "packets of 9000 bytes do not fit eth1, whose MTU is 1500" in caplog.text


def test_the_interface_of_an_address():
    name, mtu = interface_of("127.0.0.1")
    assert name == "lo"
    assert mtu >= 1500
    assert interface_of("203.0.113.77") == ("?", 65_536)


def test_the_receive_buffer_of_a_port_is_enlarged_and_no_file_left_open(caplog):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stream:
        stream.bind(("127.0.0.1", 0))
        before = stream.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF), len(os.listdir("/proc/self/fd"))
        wanted = 4096
        enlarge_receive_buffer(stream.getsockname()[1], wanted, "primary")
        assert stream.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) == 2 * wanted != before[0]
        assert len(os.listdir("/proc/self/fd")) == before[1]
    assert caplog.records == []


def test_a_kernel_that_grants_less_is_warned_of(caplog, monkeypatch):
    monkeypatch.setattr(network, "_FORCE_RECEIVE_BUFFER", socket.SO_RCVBUF)  # without CAP_NET_ADMIN
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stream:
        stream.bind(("127.0.0.1", 0))
        enlarge_receive_buffer(stream.getsockname()[1], 1 << 30, "primary")
    assert "run: sysctl -w net.core.rmem_max=1073741824" in caplog.text
