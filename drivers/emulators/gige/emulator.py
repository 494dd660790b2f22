"""One simulated camera behind GigE Vision."""

from __future__ import annotations

import logging
import tempfile
import threading
import time

from drivers.emulators.gige import registers as at
from drivers.emulators.gige.exposures import Exposures, Readout
from drivers.emulators.gige.formats import CODES, MONO8, offered
from drivers.emulators.gige.genicam import CameraDescription, describe
from drivers.emulators.gige.library import FakeCamera
from drivers.emulators.gige.loopback import add_address, remove_address, require_free, require_loopback
from drivers.emulators.wire import WireFaults
from drivers.interfaces import Range
from drivers.simulated import SimulatedCamera

TRIGGER_LOOKS_HZ = 250.0
"""How often a triggered camera looks for its trigger: frames come up to 4 ms late."""
TEMPERATURE_DEG = 41.5

_log = logging.getLogger(__name__)


class GigeEmulator:
    """A simulated camera that speaks GVCP and GVSP; see `drivers.emulators.emulator.Emulator`.

    It takes exposure, gain, frame rate, region, binning, pixel format and trigger from its client. The fake camera
    answers commands and sends frames on one thread, so it is silent while it exposes, and `WireFault.SILENCE` strikes
    only while it streams (each strike is 20 ms); `unplug` silences it at any time. Of a frame that is struck by
    ``GARBLED`` or ``PARTIAL`` half the packets are lost, as UDP discards a damaged packet.

    Parameters
    ----------
    camera : SimulatedCamera
        What it shows; need not be connected. Its own limits hold.
    address : str
        A loopback address; one that the interface does not have is added by `start` and taken away by `stop`.
    """

    def __init__(self, camera: SimulatedCamera, address: str = "127.0.0.1") -> None:
        require_loopback(address)
        self.faults = WireFaults()
        self._camera = camera
        self._address = address
        self._lock = threading.RLock()
        self._stopping = threading.Event()
        self._fake: FakeCamera | None = None
        self._exposures: Exposures | None = None
        self._added = False
        self._last_start_ns = 0
        self._last_port = 0
        self._lost_ratio = 0.0
        self._sent_frames = 0

    @property
    def sent_frames(self) -> int:
        """Frames that were due and sent since it was made, those included whose packets it lost."""
        return self._sent_frames

    @property
    def address(self) -> str:
        """The address that a driver connects to."""
        return self._address

    @property
    def serial(self) -> str:
        """The serial number that it is found by."""
        return f"twin-{self._camera.options.camera}"

    @property
    def summary(self) -> str:
        """What it is, in a few words."""
        return f"GigE Vision camera {self.serial}, the twin's {self._camera.options.camera} camera"

    def start(self) -> None:
        """Serve; raises `OSError` when the address is taken or can not be had, or Aravis is missing."""
        with self._lock:
            if self._exposures is not None:
                return
            self._added = add_address(self._address)
            try:
                require_free(self._address)
                self.plug_in()
            except OSError:
                self._release_address()
                raise
            world = self._camera.world
            self._exposures = Exposures(self._camera.expose, world.state, world.options.sensor.bits)

    def stop(self) -> None:
        """Stop serving and join the threads; may be called twice."""
        with self._lock:
            self.unplug()
            exposures, self._exposures = self._exposures, None
            if exposures is not None:
                exposures.close()
            self._release_address()

    def power_cycle(self) -> None:
        """Off and on: the client's connection breaks, settings and the frame count start anew."""
        with self._lock:
            self.unplug()
            self.plug_in()

    def unplug(self) -> None:
        """Vanish from the network, and lose power as a camera powered through its cable does."""
        with self._lock:
            fake, self._fake = self._fake, None
            if fake is not None:
                self._stopping.set()
                fake.close()

    def plug_in(self) -> None:
        """Come back after `unplug`, with settings as powered; does nothing when plugged in."""
        with self._lock:
            if self._fake is not None:
                return
            self._stopping.clear()
            with tempfile.NamedTemporaryFile("w", suffix=".xml") as genicam:
                genicam.write(describe(self._description()))
                genicam.flush()
                fake = FakeCamera(self._address, self.serial, genicam.name, self._fill)
            self._power_up(fake)
            self._fake = fake

    def lose_packets(self, ratio: float) -> None:
        """Lose this share of all packets of frames, 0 to 1, from the next frame on."""
        if not 0.0 <= ratio <= 1.0:
            raise ValueError(f"a share of packets lies between 0 and 1, not at {ratio:g}")
        self._lost_ratio = ratio

    def pulse(self) -> None:
        """A pulse at the trigger line: one frame, when a client has chosen the line."""
        with self._lock:
            if self._fake is not None and self._fake.read(at.TRIGGER_INPUT) == 0:
                self._fake.write(at.TRIGGER_NOW, 1)

    def _release_address(self) -> None:
        if self._added:
            remove_address(self._address)
            self._added = False

    def _description(self) -> CameraDescription:
        options, world = self._camera.options, self._camera.world
        optics = world.optics(options.camera)
        return CameraDescription(
            width_px=optics.width_px,
            height_px=optics.height_px,
            pixel_size_mm=optics.pixel_size_mm,
            exposure_limits_s=Range(*options.exposure_limits_s),
            gain_limits_db=Range(*options.gain_limits_db),
            frame_rate_limits_hz=Range(*options.frame_rate_limits_hz),
            formats=offered(world.options.sensor.bits),
        )

    def _power_up(self, fake: FakeCamera) -> None:
        options = self._camera.options
        optics = self._camera.world.optics(options.camera)
        fake.write_text(at.VENDOR, "bscd", at.TEXT_BYTES)
        fake.write_text(at.MODEL, f"Twin {options.camera}", at.TEXT_BYTES)
        fake.look_for_triggers(TRIGGER_LOOKS_HZ)
        for register, value in (
            (at.SENSOR_WIDTH, optics.width_px),
            (at.SENSOR_HEIGHT, optics.height_px),
            (at.WIDTH, optics.width_px),
            (at.HEIGHT, optics.height_px),
            (at.BINNING_X, 1),
            (at.BINNING_Y, 1),
            (at.PIXEL_FORMAT, MONO8),
            (at.EXPOSURE_US, round(1e6 * options.exposure_s)),
            (at.GAIN, round(100 * options.gain_db)),
            (at.FRAME_PERIOD_US, round(1e6 / options.frame_rate_hz)),
            (at.TRIGGER_SOURCE, 1),
            (at.TRIGGER_INPUT, 1),
            (at.TEMPERATURE, round(100 * TEMPERATURE_DEG)),
        ):
            fake.write(register, value)

    def _fill(self, buffer: int, exposure_us: int, gain: int) -> None:
        """Called on the fake camera's thread when the next frame is due."""
        fake, exposures = self._fake, self._exposures
        if fake is None or exposures is None:
            return
        try:
            answer = self.faults.outgoing(b"frame")
            while not answer and not self._stopping.wait(0.02):
                answer = self.faults.outgoing(b"frame")
            fake.lose_packets(self._lost_ratio if answer == b"frame" else 0.5)
            start_ns = self._start_ns(fake)
            self._wait_until(start_ns + 500 * exposure_us)
            content = exposures.take(_readout(fake, exposure_us, gain))
            self._wait_until(start_ns + 1000 * exposure_us)
            fake.fill(buffer, content, start_ns)
        except Exception:
            fake.lose_packets(1.0)
            _log.exception("%s: no image for a frame, so it is not sent", self.serial)
        self._sent_frames += 1

    def _start_ns(self, fake: FakeCamera) -> int:
        """When the exposure begins: now when triggered, else at the whole period that is due; waits for the first.

        A thread that is woken late still stamps the time at which the exposure was due, as a camera's own clock would.
        """
        now_ns = time.time_ns()
        if fake.read(at.TRIGGER_MODE) == 1:
            return now_ns
        period_ns = 1000 * fake.read(at.FRAME_PERIOD_US)
        start_ns = now_ns - now_ns % period_ns
        port, self._last_port = self._last_port, fake.read(at.STREAM_PORT)
        if port != self._last_port or now_ns - self._last_start_ns > 2 * period_ns:
            start_ns += period_ns
            self._wait_until(start_ns)
        self._last_start_ns = start_ns
        return start_ns

    def _wait_until(self, time_ns: int) -> None:
        left_s = 1e-9 * (time_ns - time.time_ns())
        if left_s > 0.0:
            self._stopping.wait(left_s)


def _readout(fake: FakeCamera, exposure_us: int, gain: int) -> Readout:
    code = fake.read(at.PIXEL_FORMAT)
    return Readout(
        exposure_s=1e-6 * exposure_us,
        gain_db=gain / 100.0,
        x_px=fake.read(at.OFFSET_X),
        y_px=fake.read(at.OFFSET_Y),
        width_px=fake.read(at.WIDTH),
        height_px=fake.read(at.HEIGHT),
        binning=(max(fake.read(at.BINNING_X), 1), max(fake.read(at.BINNING_Y), 1)),
        pixel_format=code if code in CODES.values() else MONO8,
    )
