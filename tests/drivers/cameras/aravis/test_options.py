"""The driver's options, its entry in the registry, and what it says where Aravis is missing."""

import pytest
from pydantic import ValidationError

from drivers.cameras.aravis import AravisCamera, library
from drivers.errors import NotConnectedError
from drivers.interfaces import Camera
from drivers.registry import DriverContext, installed_drivers


def build(**options):
    return installed_drivers()["camera.aravis"].build(options, DriverContext("primary"))


def test_the_registry_builds_it():
    camera = build(serial="12345", pixel_format="Mono12p", region_px=[0, 0, 640, 480], trigger="hardware")
    assert isinstance(camera, AravisCamera)
    assert isinstance(camera, Camera)
    assert camera.name == "primary"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"serial": "1", "address": "10.0.0.2"}, "not both"),
        ({"exposure_s": 0.2}, "does not fit 11 Hz"),
        ({"region_px": [0, 0, 0, 10]}, "above 0"),
        ({"reconnect_s": [5, 1]}, "first pause"),
        ({"pixel_format": "RGB8"}, "Mono8"),
        ({"colour": True}, "Extra inputs"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(ValidationError, match=message):
        build(**options)


def test_a_triggered_camera_needs_no_frame_rate_that_fits():
    assert build(exposure_s=0.2, trigger="hardware").status().exposure_s == 0.2


def test_without_aravis_it_says_how_to_get_it(monkeypatch):
    def missing():
        raise ImportError("No module named 'gi'")

    monkeypatch.setattr(library, "_load", missing)
    camera = build(address="10.0.0.2")
    with pytest.raises(NotConnectedError, match="apt-get install gir1") as raised:
        camera.connect()
    assert "No module named 'gi'" in str(raised.value)
    assert not camera.status().connected
