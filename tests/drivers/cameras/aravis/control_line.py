"""The control channel of a GigE camera with faults of the wire on its answers, at an address of its own."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from drivers.emulators.gige.loopback import GVCP_PORT, add_address, remove_address
from drivers.emulators.wire import WireFaults

ADDRESS = "127.0.0.9"
HEAD_BYTES = 8
NUMBER = slice(6, 8)
"""Where in the head the number of a question is, which its answer repeats."""


@contextmanager
def control_line(camera: str) -> Iterator[WireFaults]:
    """Passes questions at `ADDRESS` on to a camera, and its answers back as far as the faults let them.

    Of a garbled answer the head may be another; one that would tell something false is discarded, as UDP's checksum
    does.
    """
    faults = WireFaults()
    added = add_address(ADDRESS)
    ended = threading.Event()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far,
    ):
        near.bind((ADDRESS, GVCP_PORT))
        far.connect((camera, GVCP_PORT))
        thread = threading.Thread(target=_pass_on, args=(near, far, faults, ended), daemon=True)
        thread.start()
        try:
            yield faults
        finally:
            faults.clear()
            ended.set()
            thread.join(timeout=10.0)
            if added:
                remove_address(ADDRESS)


def _pass_on(near: socket.socket, far: socket.socket, faults: WireFaults, ended: threading.Event) -> None:
    asked_by = {}
    while not ended.is_set():
        ready, _, _ = select.select([near, far], [], [], 0.05)
        with suppress(ConnectionRefusedError):  # the camera is gone
            if near in ready:
                question, client = near.recvfrom(65_536)
                asked_by[question[NUMBER]] = client
                far.send(question)
            if far in ready:
                whole = far.recv(65_536)
                answer = faults.outgoing(whole)
                if answer and not _tells_falsely(answer, whole):
                    near.sendto(answer, asked_by[whole[NUMBER]])


def _tells_falsely(answer: bytes, whole: bytes) -> bool:
    return answer != whole and len(answer) == len(whole) and answer[:HEAD_BYTES] == whole[:HEAD_BYTES]
