import pytest

from tests.drivers.gige_rig import serving, small_world


@pytest.fixture(scope="module")
def world():
    world = small_world()
    yield world
    world.close()


@pytest.fixture(scope="class")
def emulator(world):
    with serving(world) as emulator:
        yield emulator
