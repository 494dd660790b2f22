"""The simulated devices on the digital twin's own world, with cameras of few pixels."""

import numpy as np
import pytest

from drivers.registry import DriverContext
from drivers.simulated import (
    JackOptions,
    RotationOptions,
    SimulatedAxis,
    SimulatedCamera,
    SimulatedCameraOptions,
    SimulatedPressure,
    SimulatedPressureOptions,
    TranslationOptions,
)
from drivers.simulated.world import PhysicalWorld
from drivers.twin.membrane import Membrane
from drivers.twin.options import CameraGeometry, MembraneOptions, SensorOptions, SpeckleOptions, TwinOptions
from drivers.twin.world import World
from tests.drivers.contract.camera_contract import CameraContract

SMALL = CameraGeometry(pixel_size_mm=0.0536, width_px=160, height_px=128)
COARSE = MembraneOptions(speckle=SpeckleOptions(spacing_mm=1.0, seed=12))
"""Speckles that show in pixels of almost half a millimetre."""


@pytest.fixture
def twin(clock):
    world = World(TwinOptions(primary=SMALL, membrane=COARSE), clock=clock)
    yield world
    world.close()


@pytest.fixture
def context(clock, twin):
    world: PhysicalWorld = twin
    return lambda name: DriverContext(name, clock, world)


@pytest.fixture
def camera(context):
    camera = SimulatedCamera(SimulatedCameraOptions(), context("primary"))
    camera.connect()
    yield camera
    camera.close()


class TestSimulatedCameraOnTheTwin(CameraContract):
    @pytest.fixture
    def camera(self, context):
        return SimulatedCamera(SimulatedCameraOptions(), context("primary"))


class TestTwelveBits(CameraContract):
    @pytest.fixture
    def camera(self, clock):
        world = World(TwinOptions(primary=SMALL, sensor=SensorOptions(bits=12)), clock=clock)
        yield SimulatedCamera(SimulatedCameraOptions(), DriverContext("primary", clock, world))
        world.close()


def axis(options, context, home=True):
    device = SimulatedAxis(options, context(options.quantity))
    device.connect()
    if home:
        device.home()
    return device


def test_the_world_is_where_the_devices_are(clock, twin, context):
    rotation, translation, jack = (
        axis(options, context) for options in (RotationOptions(), TranslationOptions(), JackOptions())
    )
    source = SimulatedPressure(SimulatedPressureOptions(), context("pressure"))
    source.connect()
    rotation.move_to(45.0)
    translation.move_to(54.0)
    jack.move_to(70.0)
    source.set_pressure(13.0)
    clock.sleep(30.0)
    state, quanta = twin.state(), twin.options.store
    assert state.rotation_deg == pytest.approx(rotation.true_position(), abs=quanta.rotation_step_deg)
    assert state.translation_mm == pytest.approx(translation.true_position(), abs=quanta.translation_step_mm)
    assert state.jack_mm == pytest.approx(jack.true_position(), abs=quanta.jack_step_mm)
    assert (state.rotation_deg, state.translation_mm, state.jack_mm) != (45.0, 54.0, 70.0)
    assert (state.rotation_deg, state.translation_mm) == pytest.approx((45.0, 54.0), abs=0.01)
    assert state.pressure_kpa == pytest.approx(13.0, abs=quanta.pressure_step_kpa)


def test_without_homing_the_world_stands_at_rest_like_without_devices(twin, context):
    before = twin.state()
    for options in (RotationOptions(), TranslationOptions(), JackOptions()):
        axis(options, context, home=False)
    assert twin.state() == before


def test_a_frame_is_the_irradiance_with_noise(twin, camera):
    frame = camera.snap().data.astype(float)
    noise = frame - 255.0 * twin.irradiance("primary")
    assert np.mean(noise) == pytest.approx(0.0, abs=0.1)
    assert 0.5 < np.std(noise) < 2.5


def test_the_jacks_take_the_prism_out_of_view(twin, context, camera):
    jack = axis(JackOptions(), context)
    jack.move_to(twin.options.prism.raised_mm)
    through = camera.snap().data.astype(float)
    assert twin.sides("primary") == (-1, 1)
    jack.move_to(twin.options.prism.lowered_mm)
    past = camera.snap().data.astype(float)
    assert twin.sides("primary") == (0,)
    # the bright cube stands in the middle of the sensor without the prism, and in both halves with it
    bright = (past[44:84] > 120).mean(axis=0)
    doubled = (through[44:84] > 120).mean(axis=0)
    assert np.average(np.arange(160), weights=bright) == pytest.approx(79.5, abs=6.0)
    for half in (slice(0, 80), slice(80, 160)):
        assert doubled[half].sum() > 0.6 * bright.sum()


def test_the_object_rides_on_the_stage(twin, context, camera):
    translation = axis(TranslationOptions(repeatability_mm=0.0), context)
    axis(JackOptions(start_mm=5.0), context, home=False)
    heights = []
    for place_mm in (34.0, 66.0):
        translation.move_to(place_mm)
        columns = camera.snap().data[:, 60:100].astype(float)
        rows = np.flatnonzero((columns > 110).sum(axis=1) > 4)
        heights.append(rows[-1] - rows[0])
    # the cube is 622 + 16 + 10 mm away instead of 622 - 16 + 10: its image shrinks in that proportion
    assert heights[1] / heights[0] == pytest.approx(616.0 / 648.0, abs=0.025)


def test_an_inflation_is_seen_by_the_stream(clock, twin, context, camera):
    twin.place("membrane")
    source = SimulatedPressure(SimulatedPressureOptions(lag_s=0.5), context("pressure"))
    source.connect()
    rest = camera.snap().data.astype(float)
    camera.start()
    source.set_pressure(13.0)
    frames = [camera.read().data.astype(float) for _ in range(8)]
    camera.stop()
    change = [np.abs(frame - rest).mean() for frame in frames]
    assert twin.state().pressure_kpa == pytest.approx(13.0 * (1.0 - np.exp(-clock.now_s() / 0.5)), abs=1.0)
    assert change[-1] > 1.5 * change[0]


def test_the_membrane_rises_with_every_step_of_the_pressure(twin):
    membrane = Membrane(twin.options.membrane)
    pressures_kpa = np.arange(0.02, 16.0, 0.04)
    rises_mm = [membrane.rise_mm(pressure_kpa) for pressure_kpa in pressures_kpa]
    steps_mm = np.diff(rises_mm)
    assert np.all(steps_mm > 0.0)
    # shallow caps rise with the cube root of the pressure: ever more slowly until the rubber softens
    assert np.max(steps_mm[5:]) < 0.1
    clamps = [membrane.meridian(pressure_kpa).radius[-1] for pressure_kpa in pressures_kpa]
    assert clamps == pytest.approx([1.0] * len(clamps), abs=1e-9)
