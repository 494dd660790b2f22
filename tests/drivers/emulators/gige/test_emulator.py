"""The emulated camera as Aravis's own tools see it, and where it may be served."""

import re
import shutil
import subprocess
import threading

import pytest

from drivers.emulators.gige import GigeEmulator, loopback, serve_cameras
from drivers.twin.options import TwinOptions
from drivers.twin.world import World
from tests.drivers.gige_rig import require_aravis, serving, simulated, small_world
from tests.drivers.own_network import one_at_a_time


@pytest.fixture(scope="module")
def world():
    world = small_world()
    yield world
    world.close()


def tool(name, *arguments, timeout_s=30):
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is missing; run: apt-get install aravis-tools aravis-tools-cli")
    done = subprocess.run([path, *arguments], capture_output=True, text=True, timeout=timeout_s)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.own_network
def test_arv_tool_lists_it_and_sets_it(world):
    with serving(world) as emulator:
        assert "bscd-Twin primary-twin-primary (127.0.0.1)" in tool("arv-tool-0.8")
        assert emulator.summary == "GigE Vision camera twin-primary, the twin's primary camera"
        said = tool(
            "arv-tool-0.8", "-a", "127.0.0.1", "control", "ExposureTime=5000", "Gain=3.5", "AcquisitionFrameRate=8"
        )
        assert "ExposureTime = 5000 min:10 max:1e+06" in said
        assert "Gain = 3.5 min:0 max:24" in said
        values = tool("arv-tool-0.8", "-a", "127.0.0.1", "values")
        assert "'SensorPixelWidth' = 53.6" in values
        assert "'AcquisitionFrameRate' = 8" in values
        emulator.power_cycle()
        assert "'ExposureTime' = 20000" in tool("arv-tool-0.8", "-a", "127.0.0.1", "values")


@pytest.mark.own_network
def test_arv_camera_test_streams_from_it():
    world = World(TwinOptions())
    world.irradiance("primary")
    # arv-camera-test enlarges its socket's buffer with the first packet, so a burst of 1.3 MB may overrun it once
    with serving(world):
        said = tool(
            "arv-camera-test-0.8", "-n", "bscd-Twin primary-twin-primary", "--no-packet-socket", "-a",
            "-i", "9000", "-f", "11", "-e", "10000", "--duration", "3",
        )  # fmt: skip
    world.close()
    counts = {name: int(value) for name, value in re.findall(r"(n_\w+)\s*= (\d+)", said)}
    assert counts["n_completed_buffers"] >= 25
    assert counts["n_failures"] <= 1
    assert (counts["n_underruns"], counts["n_missing_frames"], counts["n_size_mismatch_errors"]) == (0, 0, 0)


@pytest.mark.own_network
def test_two_cameras_are_served_at_addresses_of_their_own(world):
    require_aravis()
    with one_at_a_time():
        served = serve_cameras([simulated(world, "primary"), simulated(world, "auxiliary")])
        try:
            if served.missing:
                pytest.skip(served.missing[0])
            assert [emulator.address for emulator in served.emulators] == ["127.0.0.1", "127.0.0.2"]
            seen = tool("arv-tool-0.8")
            assert "twin-primary (127.0.0.1)" in seen and "twin-auxiliary (127.0.0.2)" in seen
        finally:
            served.stop()
    # the address that it added is gone again
    assert loopback.add_address("127.0.0.2")
    loopback.remove_address("127.0.0.2")


@pytest.mark.own_network
def test_without_the_right_to_add_an_address_one_camera_is_served_and_the_command_told(world, monkeypatch):
    require_aravis()

    def refuse(address):
        if address == "127.0.0.1":
            return False
        raise OSError(f"lo has no address {address}; run: ip addr add {address}/8 dev lo")

    monkeypatch.setattr("drivers.emulators.gige.emulator.add_address", refuse)
    with one_at_a_time():
        served = serve_cameras([simulated(world, "primary"), simulated(world, "auxiliary")])
        served.stop()
    assert [emulator.address for emulator in served.emulators] == ["127.0.0.1"]
    assert served.missing == (
        "the auxiliary camera is not served: lo has no address 127.0.0.2; run: ip addr add 127.0.0.2/8 dev lo",
    )


@pytest.mark.own_network
def test_it_starts_and_stops_twice_and_leaves_no_thread(world):
    before = set(threading.enumerate())
    with serving(world) as emulator:
        emulator.start()
        emulator.stop()
        emulator.stop()
        emulator.start()
    assert [t for t in threading.enumerate() if t not in before and t.name.startswith("gige")] == []


def test_only_loopback_is_served(world):
    with pytest.raises(ValueError, match="not a loopback address"):
        GigeEmulator(simulated(world), "192.168.1.5")
    with pytest.raises(ValueError, match="between 0 and 1"):
        GigeEmulator(simulated(world)).lose_packets(1.5)
