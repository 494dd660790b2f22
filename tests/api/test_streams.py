"""Streams: events with replay, pictures of the newest frame; a viewer that stalls holds nobody up."""

from __future__ import annotations

import json
import socket
import threading
import time

import cv2
import numpy as np
import pytest
from httpx_sse import connect_sse

from tests.daemon.small import until

API = "/api/v1"


def events_of(api, count, **headers):
    """So many events, from when the listener was heard."""
    found = []
    with connect_sse(api, "GET", f"{API}/events", headers=headers) as source:
        for event in source.iter_sse():
            found.append(event)
            if len(found) == count:
                return found
    return found


def test_events_tell_what_happens_with_ids_that_grow(api, daemon):
    found: list = []

    def listen():
        with connect_sse(api, "GET", f"{API}/events") as source:
            for event in source.iter_sse():
                found.append(event)
                if event.event == "job" and json.loads(event.data)["status"] == "done":
                    return

    listening = threading.Thread(target=listen)
    before = len(daemon.events._subscriptions)
    listening.start()
    until(lambda: len(daemon.events._subscriptions) > before, "a listener")
    job = api.post(f"{API}/jobs", json={"recipe": "home"}).json()
    listening.join(60.0)
    assert not listening.is_alive()
    assert {"job", "state"} <= {event.event for event in found}
    ids = [int(event.id) for event in found]
    assert ids == list(range(ids[0], ids[0] + len(found)))
    first = json.loads(next(event.data for event in found if event.event == "job"))
    assert (first["id"], first["status"]) == (job["id"], "queued")
    until(lambda: len(daemon.events._subscriptions) == before, "it is let go of")


def test_what_was_missed_is_told_again(api, daemon):
    last = daemon.events.last_id
    for number in range(5):
        daemon.events.publish("warning", {"text": f"number {number}"})
    found = events_of(api, 5, **{"Last-Event-ID": str(last)})
    assert [json.loads(event.data)["text"] for event in found] == [f"number {n}" for n in range(5)]
    (third,) = events_of(api, 1, **{"Last-Event-ID": str(last + 2)})
    assert json.loads(third.data)["text"] == "number 2"


def test_what_is_gone_is_said_to_be(api, daemon):
    found = events_of(api, 1, **{"Last-Event-ID": "1"})
    assert found[0].event == "gone"
    assert json.loads(found[0].data)["lost"] >= 1


@pytest.mark.parametrize("last", ["x", "-1", "99999999999999999999999"])
def test_an_id_that_is_none_is_refused(api, last):
    assert api.get(f"{API}/events", headers={"Last-Event-ID": last}).status_code == 422


@pytest.fixture
def still(daemon):
    """Nobody else takes pictures: an idle camera that is looked at would."""
    with daemon.engine.shop.camera_lock:
        yield


def show(daemon, value, number):
    daemon.latest.put("primary", np.full((256, 320), value, np.uint8), number, time.monotonic_ns())


def test_a_snapshot_is_the_newest_frame_with_its_id_and_age(api, daemon, still):
    assert api.get(f"{API}/camera/third/snapshot.jpg").status_code == 422
    show(daemon, 77, 41)
    answer = api.get(f"{API}/camera/primary/snapshot.jpg", params={"width": 160})
    assert answer.headers["content-type"] == "image/jpeg"
    assert answer.headers["x-frame-id"] == "41"
    assert 0.0 <= float(answer.headers["x-frame-age-s"]) < 60.0
    assert answer.headers["cache-control"] == "no-store"
    picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (128, 160)
    assert abs(float(picture.mean()) - 77.0) < 2.0


def test_a_stream_shows_each_newest_frame_once(api, daemon, still):
    ids, ended = [], threading.Event()

    def film():
        number = 100
        while not ended.wait(0.02):
            number += 1
            show(daemon, number % 256, number)

    filming = threading.Thread(target=film)
    filming.start()
    try:
        with api.stream("GET", f"{API}/camera/primary/stream.mjpg", params={"fps": 60}) as answer:
            assert answer.headers["content-type"] == "multipart/x-mixed-replace; boundary=frame"
            data = b""
            for chunk in answer.iter_bytes():
                data += chunk
                ids = [int(part.split(b"\r\n")[0]) for part in data.split(b"X-Frame-Id: ")[1:]]
                if len(ids) >= 6:
                    break
    finally:
        ended.set()
        filming.join(30.0)
    assert ids == sorted(set(ids))
    assert data.startswith(b"--frame\r\nContent-Type: image/jpeg\r\n")


def test_viewers_that_stall_hold_nobody_up(api, daemon, still):
    """They ask and never read: each holds one part at most, while others see new frames and the status answers."""
    host, port = api.base_url.host, api.base_url.port
    noise = np.random.default_rng(1).integers(0, 255, (1024, 1280)).astype(np.uint8)
    stalled = []
    for _ in range(3):
        viewer = socket.create_connection((host, port), timeout=10.0)
        viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        viewer.sendall(f"GET {API}/camera/primary/stream.mjpg?fps=60 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        stalled.append(viewer)
    try:
        for number in range(200, 220):
            daemon.latest.put("primary", noise, number, time.monotonic_ns())
            answer = api.get(f"{API}/camera/primary/snapshot.jpg")
            assert answer.headers["x-frame-id"] == str(number)
            assert api.get(f"{API}/status").status_code == 200
    finally:
        for viewer in stalled:
            viewer.close()


def test_an_idle_camera_that_is_looked_at_takes_pictures(api, daemon):
    until(lambda: api.get(f"{API}/camera/auxiliary/snapshot.jpg").status_code == 200, "a picture")
    first = daemon.latest.get("auxiliary").number
    until(lambda: daemon.latest.get("auxiliary").number > first, "the next one")
