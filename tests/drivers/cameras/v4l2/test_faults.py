"""Whatever goes wrong with a V4L2 camera ends in a named error in time, is over when it ends, and is never a frame."""

import errno
import logging
import threading
import time

import cv2
import numpy as np
import pytest

from drivers.errors import DeviceBusyError, DeviceTimeoutError, NotConnectedError
from tests.drivers.cameras.v4l2.rigs import PATH, make, until

GREY = np.zeros((24, 32), np.uint8)
GARBLED = {
    "nothing": (True, None),
    "refused": (False, GREY),
    "cut in half": (True, GREY[:12]),
    "cut in a row": (True, GREY.reshape(1, -1)[:, :500]),
    "empty": (True, np.zeros((0, 0), np.uint8)),
    "no channel": (True, np.zeros((24, 32, 0), np.uint8)),
    "another size": (True, np.zeros((48, 64), np.uint8)),
    "another depth": (True, GREY.astype(np.uint16)),
    "another kind": (True, np.zeros((24, 32, 3), np.float64)),
    "not decoded": cv2.error("imdecode"),
}


def level(frame):
    """The grey level of an image, whose first pixel is a count."""
    (grey,) = set(frame.data.ravel()[1:].tolist())
    return grey


def test_silence_is_named_within_its_own_time_out_and_ends(camera, device):
    camera.start()
    camera.read()
    device.silent.set()
    began_s = time.monotonic()
    with pytest.raises(DeviceTimeoutError, match="none came within"):
        for _ in range(50):
            camera.read(timeout_s=0.1)
    assert time.monotonic() - began_s < 1.0
    until(lambda: not camera.status().connected)
    with pytest.raises(NotConnectedError, match="no frames come"):
        camera.read(timeout_s=0.05)
    device.silent.clear()
    until(lambda: camera.status().connected)
    assert camera.read().data.shape == (24, 32)


def test_an_unplugged_camera_is_reported_once_and_comes_back_as_it_was(camera, device, caplog):
    caplog.set_level(logging.WARNING)
    camera.configure(exposure_s=0.004, gain_db=6.0)
    camera.start()
    before = camera.read()
    device.present = False
    until(lambda: not camera.status().connected)
    with pytest.raises(NotConnectedError):
        while True:
            before = camera.read(timeout_s=0.1)
    with pytest.raises(NotConnectedError):
        camera.configure(gain_db=0.0)
    device.present = True
    after = camera.read()
    status = camera.status()
    assert (status.connected, status.streaming) == (True, True)
    assert (status.exposure_s, status.gain_db) == (pytest.approx(0.004), pytest.approx(6.0))
    assert after.frame_id > before.frame_id + 1
    assert status.lost_frames >= after.frame_id - before.frame_id - 1
    said = [record.message for record in caplog.records if record.name.startswith("drivers.cameras.v4l2")]
    assert [("lost:" in text, "back after" in text) for text in said] == [(True, False), (False, True)]


def test_a_late_frame_is_a_time_out_and_nobody_else_s_frame(camera, device):
    device.late_s = 0.25
    began_s = time.monotonic()
    with pytest.raises(DeviceTimeoutError, match=r"none came within 0\.1 s"):
        camera.snap(timeout_s=0.1)
    assert time.monotonic() - began_s < 0.2
    device.late_s = 0.0
    for _ in range(3):
        before_ns = time.monotonic_ns()
        assert camera.snap().camera_time_ns - round(0.0025e9) >= before_ns


def test_late_frames_of_a_stream_come_in_order_and_those_that_are_missing_count(camera, device):
    camera.start()
    frames = [camera.read()]
    device.late_s = 0.2
    with pytest.raises(DeviceTimeoutError):
        while True:
            frames.append(camera.read(timeout_s=0.05))
    device.late_s = 0.0
    frames += [camera.read() for _ in range(30)]
    ids = np.array([frame.frame_id for frame in frames])
    assert np.all(np.diff(ids) > 0)
    assert camera.status().lost_frames == ids[-1] - ids[0] + 1 - len(ids)
    times_s = np.array([frame.camera_time_ns for frame in frames]) * 1e-9
    assert times_s - times_s[0] == pytest.approx((ids - ids[0]) * 0.01, abs=0.006)


@pytest.mark.parametrize("garbled", GARBLED)
def test_a_garbled_image_is_lost_and_never_a_frame(camera, device, garbled):
    device.garbled.extend([GARBLED[garbled]] * 2)
    assert camera.snap().data.shape == (24, 32)
    assert not device.garbled
    camera.start()
    frames = [camera.read()]
    device.garbled.extend([GARBLED[garbled]] * 2)
    frames += [camera.read() for _ in range(6)]
    assert {(frame.data.shape, frame.data.dtype.name, level(frame)) for frame in frames} == {((24, 32), "uint8", 5)}
    assert sorted(np.diff([frame.frame_id for frame in frames]).tolist()) == [1] * 5 + [3]
    assert camera.status().lost_frames == 2


def test_bits_that_the_format_does_not_have_are_garbled(device):
    camera = make(device, pixel_format="Y12 ", frame_rate_hz=50.0)
    camera.connect()
    camera.start()
    device.garbled.append((True, np.full((24, 32), 0x1000, np.uint16)))
    assert {int(camera.read().data.max()) for _ in range(4)} == {20 << 4}
    assert camera.status().lost_frames == 1
    camera.close()


def test_a_buffer_that_opencv_can_not_take_is_a_lost_camera_that_comes_back(camera, device):
    camera.start()
    before = camera.read()
    device.broken_buffers = True
    until(lambda: not camera.status().connected)
    with pytest.raises(NotConnectedError, match="no frames come"):
        while True:
            before = camera.read(timeout_s=0.1)
    device.broken_buffers = False
    assert camera.read().frame_id > before.frame_id


def test_a_device_that_another_program_has_is_told_as_busy(device):
    camera = make(device)
    device.open_error = errno.EBUSY
    with pytest.raises(DeviceBusyError, match=f"primary: connecting: another program has {PATH}; end that program"):
        camera.connect()
    with pytest.raises(NotConnectedError):
        camera.snap()
    assert device.opened == 0
    device.open_error = 0
    camera.connect()
    assert camera.snap().data.shape == (24, 32)
    camera.close()


def test_a_lost_camera_that_another_program_takes_comes_back_when_it_is_free(camera, device):
    device.open_error, device.present = errno.EBUSY, False
    until(lambda: not camera.status().connected)
    device.present = True
    for call in (camera.snap, camera.start, lambda: camera.configure(gain_db=1.0)):
        with pytest.raises(NotConnectedError, match="the camera is lost"):
            call() if call is not camera.snap else camera.snap(timeout_s=0.2)
    device.open_error = 0
    until(lambda: camera.status().connected)
    assert camera.snap().data.shape == (24, 32)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOENT, f"there is no {PATH}; check its cable and the path"),
        (errno.ENODEV, f"there is no {PATH}; check its cable and the path"),
        (errno.EACCES, f"not allowed to open {PATH}; add this user to the group video"),
        (errno.ENOTTY, "can not be opened as a camera"),
    ],
)
def test_the_kernel_s_reason_is_told(device, number, words):
    device.open_error = number
    with pytest.raises(NotConnectedError, match=f"primary: connecting: .*{words}"):
        make(device).connect()


@pytest.mark.parametrize("starting", [0, 2])
def test_a_power_cycle_sets_it_as_it_was_and_counts_what_is_missing(camera, device, starting):
    """It is there again before anybody looks, or later, and with its own settings."""
    camera.configure(exposure_s=0.004, gain_db=6.0)
    camera.start()
    before = camera.read()
    set_to = level(before)
    device.power_cycle(starting)
    frames = [camera.read() for _ in range(10)]
    assert device.opened == 2 + starting
    assert {level(frame) for frame in frames} == {set_to}
    ids = [frame.frame_id for frame in [before, *frames]]
    assert np.all(np.diff(ids) > 0)
    status = camera.status()
    assert (status.connected, status.exposure_s) == (True, pytest.approx(0.004))
    assert status.lost_frames == ids[-1] - ids[0] + 1 - len(ids) > 0


def test_a_start_waits_for_the_snap_that_is_under_way(device):
    camera = make(device, frame_rate_hz=2.0)
    camera.connect()
    snapped = []
    snapping = threading.Thread(target=lambda: snapped.append(camera.snap()))
    snapping.start()
    until(lambda: camera.status().lost_frames == 1)  # a snap counts as lost until its frame is there
    camera.start()
    assert len(snapped) == 1
    assert camera.read().frame_id > snapped[0].frame_id
    snapping.join()
    camera.close()


def test_closing_ends_a_snap_that_is_under_way(device):
    camera = make(device, frame_rate_hz=2.0, exposure_s=0.5)
    camera.connect()
    camera.snap()  # so the next exposure has begun, and the one after it is too late
    ended = []

    def snap():
        try:
            camera.snap(timeout_s=100.0)
        except NotConnectedError as error:
            ended.append(str(error))

    snapping = threading.Thread(target=snap)
    snapping.start()
    until(lambda: camera.status().lost_frames == 1)
    camera.close()
    snapping.join(timeout=10)
    assert ended == ["primary: taking a frame: it is not connected; call connect() first"]
