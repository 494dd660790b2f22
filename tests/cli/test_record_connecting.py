"""`bscd record` connected: vented whatever a program that crashed has left, and not before all is its own."""

import pytest

from bscd.cli.record import rig_of
from bscd.config import parse_config
from bscd.procedures.rig import RigNotReadyError
from tests.cli.small_rig import small_twin
from tests.drivers.pressure import rigs as pressure


@pytest.fixture
def left():
    """A T7 that holds a pressure, and a section for it."""
    with pressure.pressure_rig(answer_timeout_s=3.0) as rig:
        rig.simulated.connect()
        rig.driver.connect()
        rig.driver.set_pressure(8.0)
        section = pressure.settings(rig.emulator.address, regulator=pressure.REGULATOR, answer_timeout_s=3.0)
        yield rig, {"driver": "pressure.labjack_t7", **section}


def test_it_is_vented_once_connected(left):
    rig, section = left
    with rig_of(parse_config(small_twin({"pressure": section}), "rig.toml")):
        assert rig.simulated.set_point_kpa() == 0.0


def test_it_is_left_where_another_device_does_not_answer(left):
    """The other program may have that device as well."""
    rig, section = left
    camera = {"driver": "camera.v4l2", "device": "/dev/v4l/by-id/none", "pixel_size_mm": 0.005}
    config = parse_config(small_twin({"pressure": section, "auxiliary": camera}), "rig.toml")
    with pytest.raises(RigNotReadyError, match="auxiliary"), rig_of(config):
        pass
    assert rig.simulated.set_point_kpa() == pytest.approx(8.0)
