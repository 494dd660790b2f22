"""The page of the emulated rig tells every fault that can be typed, and its example lines are orders."""

import re
from pathlib import Path

import pytest

from drivers.clock import VirtualClock
from drivers.emulators.orders import EmulatedDevice, FaultOrders
from drivers.emulators.wire import WireFaults

DEVICES = ("primary", "auxiliary", "rotation", "translation", "jacks", "pressure")
TEXT = (Path(__file__).resolve().parents[2] / "docs/drivers/README.md").read_text()
SECTION = TEXT.partition("**Faults on command.**")[2].partition("\n## ")[0]
(EXAMPLE,) = re.findall(r"```\n(.*?)```", SECTION, re.DOTALL)
CAMERA = EmulatedDevice((WireFaults(),), lambda: None, lambda share: None)
OTHER = EmulatedDevice((WireFaults(),), lambda: None)


@pytest.mark.parametrize("line", EXAMPLE.splitlines())
def test_an_example_is_an_order(line):
    devices = {name: CAMERA if name in ("primary", "auxiliary") else OTHER for name in DEVICES}
    assert FaultOrders(devices, VirtualClock()).carry_out(line)


def test_the_table_tells_every_fault_and_no_other():
    assert set(re.findall(r"^\| `([a-z-]+)` \|", SECTION, re.MULTILINE)) == set(CAMERA.can_have)


def test_every_device_is_named():
    told = SECTION.partition("The devices are ")[2].partition(";")[0]
    assert tuple(re.findall(r"`(\w+)`", told)) == DEVICES
