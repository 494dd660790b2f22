"""The shared state: devices, quantisation, placing by hand, kept frames; options that are refused."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.twin.options import TwinOptions
from drivers.twin.store import FrameStore
from drivers.twin.world import World
from tests.drivers.twin.rigs import coarse_options


@pytest.fixture
def world():
    world = World(coarse_options())
    yield world
    world.close()


def test_devices_tell_where_they_are(world):
    position = [12.3456789]
    assert world.state().translation_mm == 50.0
    world.bind("translation_mm", lambda: position[0])
    assert world.state().translation_mm == pytest.approx(12.3457, abs=1e-12)
    world.bind("jack_mm", lambda: 42.0)
    assert world.prism().edge_mm == (0.0, -210.0, -28.0)
    with pytest.raises(ValueError, match="humidity"):
        world.bind("humidity", lambda: 0.0)


def test_a_state_made_by_hand_is_the_same_for_images_and_truth(world):
    exact = world.state()._replace(translation_mm=51.23456789)
    near = exact._replace(translation_mm=51.2346)
    assert world.quantised(exact) == near
    assert world.irradiance("primary", exact) is world.irradiance("primary", near)
    np.testing.assert_array_equal(world.dots("primary", exact)[0].xyz_mm, world.dots("primary", near)[0].xyz_mm)


def test_what_can_not_be_seen_renders_no_new_frame(world):
    state = world.state()
    frame = world.irradiance("primary", state)
    assert world.irradiance("primary", state._replace(pressure_kpa=9.0)) is frame
    low = world.irradiance("primary", state._replace(jack_mm=5.0))
    assert low is not frame
    assert world.irradiance("primary", state._replace(jack_mm=4.0)) is low
    side = world.irradiance("auxiliary", state)
    assert world.irradiance("auxiliary", state._replace(jack_mm=5.0)) is side


def test_frames_are_read_only_and_exposures_their_own(world):
    frame = world.irradiance("primary")
    with pytest.raises(ValueError, match="read-only"):
        frame[0, 0] = 1.0
    rng = np.random.default_rng(0)
    first, second = (world.expose("primary", exposure_s=0.02, gain_db=0.0, rng=rng) for _ in range(2))
    assert first.shape == (256, 320)
    assert (first != second).mean() > 0.3
    assert abs(first.astype(float) - 255 * frame).mean() < 2.0


def test_frames_rendered_ahead_are_those_that_are_asked_for(world):
    states = [world.state()._replace(translation_mm=40.0 + k) for k in range(3)]
    world.prepare("primary", states)
    world.wait()
    other = World(world.options)
    for state in states:
        np.testing.assert_array_equal(world.irradiance("primary", state), other.irradiance("primary", state))
    assert "twin-render" in " ".join(thread.name for thread in threading.enumerate())
    world.close()
    assert "twin-render" not in " ".join(thread.name for thread in threading.enumerate())
    assert world.irradiance("primary", states[0]).shape == (256, 320)


def test_the_cube_can_be_remounted(world):
    straight = world.dots("primary")[0].xyz_mm
    world.place("cube", shift_mm=(1.0, 2.0, -3.0))
    np.testing.assert_allclose(world.dots("primary")[0].xyz_mm - straight, [[1.0, 2.0, -3.0]] * 414, atol=1e-12)
    world.place("cube", turn_deg=(0.0, 0.0, 90.0))
    middle = np.array([0.0, 20.0 / 2**0.5, 0.0])
    turned = np.stack([-(straight - middle)[:, 1], (straight - middle)[:, 0], straight[:, 2]], axis=-1)
    np.testing.assert_allclose(world.dots("primary")[0].xyz_mm, turned + middle, atol=1e-12)


def test_a_sphere_goes_where_it_is_put_and_then_rides_on_the_stage(world):
    reading = [58.0]
    world.bind("translation_mm", lambda: reading[0])
    world.place("sphere", shift_mm=(0.0, -1.0, 0.0))
    np.testing.assert_allclose(world.object_pose().origin_mm, [0.6, 12.0, 0.5], atol=1e-12)
    reading[0] = 61.0
    moved = world.object_pose().origin_mm - [0.6, 12.0, 0.5]
    assert np.linalg.norm(moved) == pytest.approx(3.0, abs=1e-12)
    assert world.dots("primary") == []


def test_an_empty_stage_is_background(world):
    world.place("empty")
    np.testing.assert_allclose(world.irradiance("primary"), 0.1, atol=1e-6)
    with pytest.raises(ValueError, match="known: empty, cube, sphere, membrane"):
        world.place("cone")


def test_the_store_renders_once_and_forgets_the_oldest():
    rendered = []

    def render(key):
        rendered.append(key)
        return np.zeros((10, 100), np.float32)

    store = FrameStore(render, memory_bytes=3 * 4000)
    for key in ("a", "b", "c", "a", "d", "a", "b"):
        store.get(key)
    assert rendered == ["a", "b", "c", "d", "b"]
    assert len(store) == 3
    store.close()


def test_the_store_hands_on_what_a_rendering_raises():
    def render(key):
        raise ValueError(f"no {key}")

    store = FrameStore(render, memory_bytes=1000)
    with pytest.raises(ValueError, match="no frame"):
        store.get("frame")
    store.prepare(["ahead"])
    with pytest.raises(ValueError, match="no ahead"):
        store.get("ahead")
    store.close()


def test_a_frame_under_way_is_waited_for_and_a_queued_one_is_taken_over():
    started, release = threading.Event(), threading.Event()
    rendered = []

    def render(key):
        if key == "slow":
            started.set()
            assert release.wait(10.0)
        rendered.append(key)
        return np.zeros((1, 1), np.float32)

    store = FrameStore(render, memory_bytes=1000)
    store.prepare(["slow", "queued"])
    assert started.wait(10.0)
    store.get("queued")
    assert rendered == ["queued"]
    release.set()
    store.get("slow")
    store.wait()
    store.close()
    assert sorted(rendered) == ["queued", "slow"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"prism": {"alpha_deg": 60.0}}, "greater than 90"),
        ({"prism": {"thickness_mm": 4.0}}, "must exceed the roof's drop of 4.9 mm"),
        ({"cube": {"dot_diameter_mm": 2.5}}, "must be below pitch_mm"),
        ({"sensor": {"noise_grey": 0.3}}, "must exceed read_noise_grey"),
        ({"membrane": {"calibration_rise_mm": 14.0}}, "below a half sphere"),
        ({"light": {"colour": "red"}}, "Extra inputs are not permitted"),
        ({"primary": {"width_px": 0}}, "greater than or equal to 16"),
    ],
)
def test_impossible_options_are_refused(options, says):
    with pytest.raises(ValidationError, match=says):
        TwinOptions.model_validate(options)


def test_a_partly_given_auxiliary_camera_keeps_its_place():
    options = TwinOptions.model_validate({"auxiliary": {"roll_deg": 1.0}})
    assert options.auxiliary.position_mm[0] == pytest.approx(622.0 * np.sin(np.radians(20.0)))
    assert all(field.description for field in TwinOptions.model_fields.values())
