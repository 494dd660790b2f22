"""One acquisition of a camera, from its start to its stop, with a stream of its own."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

from drivers.cameras.aravis.counters import StreamCounters
from drivers.cameras.aravis.network import enlarge_receive_buffer, on_loopback
from drivers.cameras.aravis.options import AravisOptions
from drivers.cameras.aravis.pixels import Grey, frame_bytes, unpack
from drivers.errors import DeviceFaultError

_NO_ID = 2**64 - 1
"""No camera counts so far: a buffer that comes back with it did not get the packet that tells its frame's id."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """A buffer that came: the camera's frame id and time, and the image, None when packets of it are missing.

    Id and time are None when the first packet of the frame, the leader, is missing: it alone tells them.
    """

    raw_id: int | None
    camera_time_ns: int | None
    image: Grey | None
    part: Grey | None = None
    """Of an incomplete image what came, the rest as it was in the buffer; only where it was asked for."""


class Acquisition:
    """Receives from its making until `close`; frames of an earlier acquisition can not come through it.

    One thread at a time may call `pop`. Raises an error of GLib.
    """

    def __init__(self, aravis: Any, camera: Any, options: AravisOptions, device: str, buffers: int) -> None:
        self._aravis = aravis
        self._format = options.pixel_format
        self._parts_too = options.incomplete_frames == "deliver"
        self._popping = threading.Lock()
        if camera.is_gv_device():
            packet_socket = options.packet_socket
            if packet_socket is None:
                packet_socket = not on_loopback(camera)
            choice = aravis.GvStreamOption
            camera.gv_set_stream_options(choice.NONE if packet_socket else choice.PACKET_SOCKET_DISABLED)
        stream = camera.create_stream(None, None)
        if stream is None:
            raise DeviceFaultError(device, "no stream could be opened", "check memory and the number of open files")
        if camera.is_gv_device():
            stream.set_property("socket-buffer", aravis.GvStreamSocketBuffer.FIXED)
            stream.set_property("socket-buffer-size", 0)  # left alone: ours is there earlier
            enlarge_receive_buffer(stream.get_port(), options.socket_buffer_bytes, device)
            resend = aravis.GvStreamPacketResend
            stream.set_property("packet-resend", resend.ALWAYS if options.packet_resend else resend.NEVER)
        region = camera.get_region()
        self._size = int(region.width), int(region.height)
        payload_bytes = camera.get_payload()
        for _ in range(buffers):
            _lend(stream, aravis.Buffer.new_allocate(payload_bytes))
        self._is_gige = bool(camera.is_gv_device())
        self._stream = stream
        self._last = StreamCounters()

    def pop(self, timeout_s: float) -> Arrival | None:
        """The next buffer, None when none came in time or it was closed."""
        with self._popping:
            stream = self._stream
            if stream is None:
                return None
            buffer = stream.timeout_pop_buffer(max(1, round(1e6 * timeout_s)))
            if buffer is None:
                return None
            try:
                return self._arrival(buffer)
            finally:
                _lend(stream, buffer)

    def counters(self) -> StreamCounters:
        """What Aravis counted so far; the last figures after `close`."""
        with self._popping:
            stream = self._stream
            if stream is not None:
                completed, failed, underrun = self._aravis.Stream.get_statistics(stream)
                resent, missing = stream.get_statistics() if self._is_gige else (0, 0)
                self._last = StreamCounters(
                    completed=completed, failed=failed, underrun=underrun,
                    missing_packets=missing, resent_packets=resent,
                )  # fmt: skip
            return self._last

    def close(self) -> None:
        """Stop receiving; waits for a `pop` that is under way. May be called twice."""
        self.counters()
        with self._popping:
            self._stream = None

    def _arrival(self, buffer: Any) -> Arrival:
        raw_id, time_ns = buffer.get_frame_id(), buffer.get_timestamp()
        if raw_id == _NO_ID:
            raw_id = time_ns = None
        whole = raw_id is not None and buffer.get_status() == self._aravis.BufferStatus.SUCCESS
        if not whole and not self._parts_too:
            return Arrival(raw_id, time_ns, None)
        data = buffer.get_data()
        wanted = frame_bytes(self._format, *self._size)
        if whole and len(data) >= wanted:
            return Arrival(raw_id, time_ns, unpack(data[:wanted], self._format, *self._size))
        if self._parts_too:
            data = data[:wanted].ljust(wanted, b"\0")
            return Arrival(raw_id, time_ns, None, unpack(data, self._format, *self._size))
        return Arrival(raw_id, time_ns, None)


def _lend(stream: Any, buffer: Any) -> None:
    """Let a stream fill a buffer; Aravis leaves the id of the frame before in it where a leader is lost."""
    buffer.set_frame_id(_NO_ID)
    stream.push_buffer(buffer)
