"""The newest frame's slot."""

import threading

import cv2
import numpy as np
import pytest

from bscd.daemon.latest import LatestFrames


def frame(value, dtype=np.uint8, shape=(64, 128)):
    return np.full(shape, value, dtype)


def test_the_newest_is_there_and_is_a_copy():
    latest = LatestFrames()
    assert latest.get("primary") is None
    assert latest.jpeg("primary") is None
    image = frame(10)
    latest.put("primary", image, 7, 123)
    image[:] = 99
    found = latest.get("primary")
    assert (found.frame_id, found.host_time_ns, found.number) == (7, 123, 1)
    assert (found.data == 10).all()
    latest.put("primary", frame(20), 8, 456)
    assert latest.get("primary").number == 2
    assert latest.get("auxiliary") is None


def test_waiting_ends_with_the_next_frame_or_the_time():
    latest = LatestFrames()
    assert latest.wait_newer("primary", 0, 0.01) is None
    latest.put("primary", frame(1), 1, 1)
    assert latest.wait_newer("primary", 0, 0.01).frame_id == 1
    assert latest.wait_newer("primary", 1, 0.01) is None
    found = []
    waiting = threading.Thread(target=lambda: found.append(latest.wait_newer("primary", 1, 30.0)))
    waiting.start()
    latest.put("primary", frame(2), 2, 2)
    waiting.join(30.0)
    assert found[0].frame_id == 2


@pytest.mark.parametrize(
    ("dtype", "value", "shown"), [(np.uint8, 100, 100), (np.uint16, 4000, 250), (np.uint16, 90, 90)]
)
def test_the_picture_shows_the_frame(dtype, value, shown):
    latest = LatestFrames()
    image = frame(0, dtype, (64, 128))
    image[:, 64:] = value
    latest.put("primary", image, 1, 1)
    coded, told = latest.jpeg("primary", 64)
    picture = cv2.imdecode(np.frombuffer(coded, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (32, 64)
    assert abs(int(picture[:, 40:].mean()) - shown) <= 3
    assert told.frame_id == 1


def test_it_is_encoded_once_a_frame(monkeypatch):
    latest, calls = LatestFrames(), []
    encode = cv2.imencode
    monkeypatch.setattr(cv2, "imencode", lambda *given: calls.append(1) or encode(*given))
    latest.put("primary", frame(1), 1, 1)
    first = latest.jpeg("primary")[0]
    assert latest.jpeg("primary")[0] is first
    assert len(calls) == 1
    latest.put("primary", frame(200), 2, 2)
    assert latest.jpeg("primary")[0] != first
    assert len(calls) == 2


def test_who_looks_is_known_for_a_while():
    latest = LatestFrames()
    assert not latest.wanted("primary")
    latest.get("primary")
    assert latest.wanted("primary")
    assert not latest.wanted("auxiliary")
