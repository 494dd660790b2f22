"""The driver on OpenCV's own capture: of a device that stands in for the kernel's, and of what is no camera."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.cameras.v4l2 import V4l2Camera, V4l2Options
from drivers.errors import NotConnectedError
from drivers.registry import DriverContext

HERE = Path(__file__).parent
FAKE = "/dev/v4l/by-id/fake"
TWO_PROGRAMS = """
import sys, time
import numpy as np
from drivers.cameras.v4l2 import V4l2Camera, V4l2Options
from drivers.errors import DeviceBusyError
from drivers.registry import DriverContext

def camera(pixel_format):
    options = V4l2Options(
        device=sys.argv[1], width_px=32, height_px=24, frame_rate_hz=10, pixel_size_mm=0.005, pixel_format=pixel_format
    )
    return V4l2Camera(options, DriverContext("primary"))

numbers = np.arange(32 * 24).reshape(24, 32)
for pixel_format, expected in (("GREY", numbers % 251), ("YUYV", numbers % 251), ("Y12 ", numbers)):
    first, second = camera(pixel_format), camera(pixel_format)
    first.connect()
    before_ns = time.monotonic_ns()
    frame = first.snap()
    assert np.array_equal(frame.data, expected), pixel_format
    assert before_ns < frame.camera_time_ns < time.monotonic_ns()
    try:
        second.connect()
    except DeviceBusyError as error:
        print(error)
    assert np.array_equal(first.snap().data, expected), pixel_format
    first.close()
    second.connect()
    assert np.array_equal(second.snap().data, expected), pixel_format
    second.close()
"""


@pytest.fixture(scope="module")
def fake_kernel(tmp_path_factory):
    compiler = shutil.which("cc")
    if compiler is None or not Path("/usr/include/linux/videodev2.h").exists():
        pytest.skip("no C compiler or no kernel headers (apt install gcc linux-libc-dev)")
    library = tmp_path_factory.mktemp("kernel") / "fake_kernel.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, HERE / "fake_kernel.c", "-ldl"], check=True)
    return library


def test_one_program_has_its_frames_and_the_other_is_told_that_it_is_busy(fake_kernel):
    environment = os.environ | {"LD_PRELOAD": str(fake_kernel), "FAKE_V4L2": FAKE}
    done = subprocess.run(
        [sys.executable, "-c", TWO_PROGRAMS, FAKE],
        env=environment,
        cwd=HERE.parents[3],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [f"primary: connecting: another program has {FAKE}; end that program"] * 3


@pytest.mark.parametrize(
    ("path", "words"), [("/dev/v4l/by-id/none", "there is no"), ("/dev/null", "can not be opened as a camera")]
)
def test_what_is_no_camera_is_told_by_us_and_not_by_opencv(path, words, capfd):
    camera = V4l2Camera(V4l2Options(device=path, pixel_size_mm=0.005), DriverContext("primary"))
    with pytest.raises(NotConnectedError, match=f"primary: connecting: .*{words}"):
        camera.connect()
    assert capfd.readouterr().err == ""
