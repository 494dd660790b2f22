"""The lines that emulators serve on: bytes in both directions, faults, clients that follow each other, no leftovers."""

import os
import select
import socket
import threading
import time
from pathlib import Path

import pytest

from drivers.emulators.lines import PtyLine, TcpLine, open_line
from drivers.emulators.wire import WireFault, WireFaults
from drivers.stages.line import LineLostError, LineTakenError, SerialLine
from drivers.stages.line import TcpLine as TcpClient
from drivers.stages.line import open_line as open_client


class Echo:
    """Answers each line by itself."""

    def __init__(self):
        self._pending = b""

    def receive(self, data):
        *lines, self._pending = (self._pending + data).split(b"\n")
        return [line + b"\n" for line in lines]


@pytest.fixture(params=["pty", "tcp"])
def line(request):
    line = open_line(request.param, Echo, WireFaults(late_s=0.2))
    line.start()
    yield line
    line.stop()


def call(line):
    return open_client(line.address, baud=115200, stop_bits=2, timeout_s=1.0)


def hear(client, count: int) -> bytes:
    heard = b""
    while len(heard) < count:
        more = client.read(1.0)
        assert more, f"only {heard!r} came"
        heard += more
    return heard


def threads() -> set[str]:
    return {thread.name for thread in threading.enumerate() if thread.name.startswith("emulator at")}


def test_bytes_pass_as_they_are(line):
    client = call(line)
    every = bytes(value for value in range(256) if value != 10) + b"\n"
    client.write(every[:100])
    client.write(every[100:])
    assert hear(client, 256) == every
    client.write(b"a\nb\nc")
    assert hear(client, 4) == b"a\nb\n"
    assert client.read(0.02) == b""
    client.close()
    client.close()


def test_much_at_once(line):
    client = call(line)
    text = b"0123456789abcdef" * 64 + b"\n"
    for _ in range(40):
        client.write(text)
        assert hear(client, len(text)) == text
    client.close()


def test_clients_follow_each_other(line):
    for _ in range(3):
        client = call(line)
        client.write(b"hello\n")
        assert hear(client, 6) == b"hello\n"
        client.close()


def test_only_one_at_a_time(line):
    first = call(line)
    first.write(b"hello\n")
    hear(first, 6)
    with pytest.raises(LineTakenError, match="another program"):
        second = call(line)
        try:
            second.read(1.0)
        finally:
            second.close()
    first.write(b"still\n")
    assert hear(first, 6) == b"still\n"
    first.close()


def test_several_at_a_time_where_it_may_be():
    line = TcpLine(Echo, WireFaults(), clients=2)
    line.start()
    clients = [call(line) for _ in range(2)]
    for client in clients:
        client.write(b"he")
    for client in clients:
        client.write(b"llo\n")
        assert hear(client, 6) == b"hello\n"
        client.close()
    line.stop()


def test_unplugged_and_plugged_in_again_at_the_same_address(line):
    address = line.address
    client = call(line)
    client.write(b"hello\n")
    hear(client, 6)
    line.stop()
    with pytest.raises(LineLostError):
        for _ in range(3):
            client.write(b"hello\n")
            client.read(0.2)
    client.close()
    with pytest.raises(LineLostError, match=r"no port|no connection"):
        call(line)
    line.start()
    line.start()
    assert line.address == address
    client = call(line)
    client.write(b"again\n")
    assert hear(client, 6) == b"again\n"
    client.close()


@pytest.mark.parametrize(
    ("fault", "comes"),
    [
        (WireFault.SILENCE, b""),
        (WireFault.PARTIAL, b"hel"),
        (WireFault.GARBLED, b"helyo\n"),
        (WireFault.LATE, b""),
    ],
)
def test_faults_strike_answers(fault, comes):
    faults = WireFaults(late_s=0.3)
    line = TcpLine(Echo, faults)
    line.start()
    client = call(line)
    faults.inject(fault, count=1)
    client.write(b"hello\n")
    assert client.read(0.1) == comes
    if fault is WireFault.LATE:
        assert hear(client, 6) == b"hello\n"
    client.write(b"whole\n")
    assert hear(client, 6) == b"whole\n"
    client.close()
    line.stop()


def test_late_answers_do_not_keep_it_from_stopping():
    faults = WireFaults(late_s=0.3)
    line = TcpLine(Echo, faults)
    line.start()
    faults.inject(WireFault.LATE)
    client = call(line)
    client.write(b"hello\n" * 64)
    client.read(0.05)
    began_s = time.monotonic()
    line.stop()
    assert time.monotonic() - began_s < 2.0
    client.close()
    assert not threads()


def test_a_client_that_does_not_read_does_not_keep_it_from_stopping():
    line = PtyLine(Echo, WireFaults())
    line.start()
    port = os.open(line.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        while True:
            os.write(port, b"0123456789abcde\n" * 64)
            if not select.select([], [port], [], 0.1)[1]:
                break
    except BlockingIOError:
        pass
    line.stop()
    os.close(port)
    assert not threads()


def test_leaves_nothing_behind(line):
    before = set(os.listdir("/proc/self/fd"))
    for _ in range(3):
        line.stop()
        line.stop()
        assert not threads()
        if isinstance(line, PtyLine):
            assert not Path(line.address).parent.exists()
        line.start()
    assert threads() == {f"emulator at {line.address}"}
    assert len(os.listdir("/proc/self/fd")) == len(before)


def test_serves_on_loopback_only():
    line = TcpLine(Echo, WireFaults())
    line.start()
    host, _, port = line.address.removeprefix("tcp://").partition(":")
    assert host == "127.0.0.1"
    taken = TcpLine(Echo, WireFaults(), port=int(port))
    with pytest.raises(OSError, match="in use"):
        taken.start()
    taken.stop()
    line.stop()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((host, int(port)), timeout=1.0)


def test_a_port_that_is_not_allowed(tmp_path):
    nobody = tmp_path / "nothing"
    nobody.write_text("a file, no port")
    with pytest.raises(LineLostError, match="can not be opened"):
        SerialLine(str(nobody), baud=115200, stop_bits=1)
    with pytest.raises(LineLostError, match="no connection"):
        TcpClient("127.0.0.1", 1, timeout_s=0.5)
