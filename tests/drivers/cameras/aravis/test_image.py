"""What comes through the wire is what the twin's sensor sees: region, binning, formats, settings, identity."""

import numpy as np
import pytest

from drivers.errors import DeviceBusyError, NotConnectedError, OutOfLimitsError, UnsupportedError
from tests.drivers.gige_rig import open_camera, serving, small_world

pytestmark = pytest.mark.own_network


@pytest.fixture(scope="module")
def twelve_bits():
    world = small_world(bits=12)
    yield world
    world.close()


@pytest.fixture(scope="module")
def served(twelve_bits):
    with serving(twelve_bits) as emulator:
        yield emulator


def truth(world, bits=12):
    return world.irradiance("primary") * (2**bits - 1)


def noise(frame, expected):
    return frame.data.astype(float) - np.clip(expected, 0, None)


@pytest.mark.parametrize(
    ("pixel_format", "bits"), [("Mono8", 8), ("Mono12", 12), ("Mono12Packed", 12), ("Mono12p", 12)]
)
def test_every_format_shows_the_same_image(twelve_bits, served, pixel_format, bits):
    with open_camera(pixel_format=pixel_format) as camera:
        assert camera.info().bit_depth == bits
        frame = camera.snap()
    assert frame.data.dtype == (np.uint8 if bits == 8 else np.uint16)
    relative = noise(frame, truth(twelve_bits, bits)) / 2**bits
    assert abs(relative.mean()) < 0.005
    assert np.std(relative) < 0.02


def test_a_region_is_that_part_of_the_sensor(twelve_bits, served):
    with open_camera(pixel_format="Mono12", region_px=[40, 30, 64, 50]) as camera:
        info, frame = camera.info(), camera.snap()
    assert (info.width_px, info.height_px) == (64, 50)
    assert np.std(noise(frame, truth(twelve_bits)[30:80, 40:104])) < 0.02 * 4096
    assert np.std(truth(twelve_bits)[30:80, 40:104]) > 0.1 * 4096


def test_bins_are_means(twelve_bits, served):
    with open_camera(pixel_format="Mono12", binning=[2, 2]) as camera:
        info, frame = camera.info(), camera.snap()
    assert (info.width_px, info.height_px) == (80, 64)
    assert info.pixel_size_mm == pytest.approx(2 * 0.0536)
    binned = truth(twelve_bits).reshape(64, 2, 80, 2).mean(axis=(1, 3))
    assert np.std(noise(frame, binned)) < 0.02 * 4096


def test_exposure_and_gain_brighten(served):
    with open_camera(pixel_format="Mono12", exposure_s=0.005) as camera:
        dark = camera.snap().data.mean()
        camera.configure(exposure_s=0.01)
        assert camera.snap().data.mean() == pytest.approx(2 * dark, rel=0.02)
        camera.configure(exposure_s=0.005, gain_db=20 * np.log10(2))
        assert camera.snap().data.mean() == pytest.approx(2 * dark, rel=0.02)


def test_identity_and_temperature(served):
    with open_camera(pixel_format="Mono12") as camera:
        info = camera.info()
        assert (info.vendor, info.model, info.serial) == ("bscd", "Twin primary", "twin-primary")
        assert info.pixel_size_mm == pytest.approx(0.0536)
        assert camera.temperature_deg() == pytest.approx(41.5)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"region_px": [100, 0, 64, 64]}, OutOfLimitsError, "160 x 128 pixels"),
        ({"region_px": [0, 0, 160, 128], "binning": [2, 2]}, OutOfLimitsError, "80 x 64"),
        ({"pixel_format": "Mono10"}, UnsupportedError, "choose one of Mono8, Mono12"),
    ],
)
def test_what_the_sensor_can_not_do_is_refused(served, options, error, message):
    with pytest.raises(error, match=message), open_camera(**options):
        pass


def test_software_triggers_make_one_frame_each(served):
    with open_camera(trigger="software", exposure_s=0.002) as camera:
        camera.start()
        ids = []
        for _ in range(5):
            camera.trigger()
            ids.append(camera.read().frame_id)
        assert np.diff(ids).tolist() == [1] * 4
        with pytest.raises(Exception, match="none came"):
            camera.read(timeout_s=0.2)
        camera.stop()
        with pytest.raises(UnsupportedError):
            camera.trigger()


def test_a_line_triggers_one_frame_a_pulse(served):
    with open_camera(trigger="hardware", trigger_source="Line0", exposure_s=0.002) as camera:
        camera.start()
        ids = []
        for _ in range(5):
            served.pulse()
            ids.append(camera.read().frame_id)
        assert np.diff(ids).tolist() == [1] * 4
        camera.stop()
        assert camera.snap().status == "ok"
        served.pulse()


def test_a_camera_that_another_program_has_is_said_to_be_taken(served):
    with (
        open_camera(),
        pytest.raises(DeviceBusyError, match="another program"),
        open_camera(name="second", open_timeout_s=0.1),
    ):
        pass
    with open_camera(name="second") as camera:
        assert camera.snap().status == "ok"


@pytest.mark.parametrize(
    ("where", "message"),
    [({"address": "", "serial": "nobody"}, "seen: twin-primary"), ({"address": "127.0.0.77"}, "127.0.0.77")],
)
def test_a_camera_that_is_not_there_is_named(served, where, message):
    with pytest.raises(NotConnectedError, match=message), open_camera(**where):
        pass


@pytest.mark.parametrize("serial", ["twin-primary", ""])
def test_a_camera_is_found_by_its_serial_and_the_only_one_without(served, serial):
    with open_camera(address="", serial=serial) as camera:
        assert camera.info().serial == "twin-primary"
