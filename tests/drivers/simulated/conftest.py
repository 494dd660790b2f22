import pytest

from drivers.clock import VirtualClock
from tests.drivers.simulated.tiny_world import TinyWorld

pytest.register_assert_rewrite(
    "tests.drivers.contract.axis_contract",
    "tests.drivers.contract.camera_contract",
    "tests.drivers.contract.pressure_contract",
)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def world(clock: VirtualClock) -> TinyWorld:
    return TinyWorld(clock)
