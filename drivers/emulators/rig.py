"""A whole rig's simulated devices behind their wire protocols at once, and how real drivers are told of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

from drivers.emulators.emulator import Emulator
from drivers.emulators.modbus import LabJackT7Emulator, ModbusJacksEmulator
from drivers.emulators.modbus.labjack_t7 import Wiring
from drivers.emulators.orders import EmulatedDevice
from drivers.emulators.ximc import XimcEmulator
from drivers.emulators.ximc.emulator import STEPS_PER_UNIT
from drivers.emulators.zaber import ZaberEmulator
from drivers.simulated import SimulatedAxis, SimulatedCamera, SimulatedPressure

StageProtocol = Literal["ximc", "zaber"]

#: Microsteps of an XIMC controller; of a Zaber X-LSM and an X-RSW a unit.
MICROSTEPS = 256
ZABER_MICROSTEPS_PER_UNIT = {"mm": 1.0 / 0.047625e-3, "deg": 768000.0 / 180.0}

#: TCP ports from the first one on, so that a configuration can name them; both stages share the line of Zaber's.
PORTS = ("rotation", "translation", "jacks", "pressure", "zaber")
FIRST_PORT = 7101

#: An emulated camera is silent while the twin renders, which takes as long as the machine's other work lets it.
SILENT_S = 5.0

_STAGES = ("rotation", "translation")
_UNITS = {"rotation": "deg", "translation": "mm"}


def smallest_step(device: str) -> float:
    """What a stage's simulated mechanics must resolve for both its controllers, mm or deg: XIMC's microstep."""
    return 1.0 / (STEPS_PER_UNIT[_UNITS[device]] * MICROSTEPS)


@dataclass(frozen=True)
class Served:
    """Something that can be reached: where, and what it is."""

    address: str
    summary: str


@dataclass
class EmulatedRig:
    """Emulators around a rig's simulated devices; `start` serves what can be served and tells what can not.

    Each stage has two controllers, an XIMC and a Zaber, that move the same motor; each knows its own homing, and the
    Zaber the XIMC's as well.

    Parameters
    ----------
    devices : mapping of str to simulated device
        By their names in a configuration: primary, auxiliary, rotation, translation, jacks, pressure; None: left out.
    stages : {"ximc", "zaber"}
        What the two stages speak in `configuration`.
    first_port : int or None
        TCP ports from here on, in the order of `PORTS`; None: free ones.
    """

    devices: Mapping[str, Any]
    stages: StageProtocol = "ximc"
    first_port: int | None = FIRST_PORT
    served: list[Served] = field(default_factory=list)
    devices_served: dict[str, EmulatedDevice] = field(default_factory=dict)
    _sections: dict[str, dict[str, Any]] = field(default_factory=dict)
    _stops: list[Callable[[], None]] = field(default_factory=list)

    def start(self) -> list[str]:
        """Serve; what could not be served and what to do about it. Raises `PortTakenError` and `OSError`."""
        missing: list[str] = []
        try:
            missing += self._start_cameras()
            self._start_stages()
            self._start_jacks()
            self._start_pressure()
        except OSError:
            self.stop()
            raise
        return missing

    def stop(self) -> None:
        """Stop serving and join all threads; may be called twice."""
        while self._stops:
            self._stops.pop()()
        self.served.clear()
        self.devices_served.clear()
        self._sections.clear()

    def configuration(self) -> dict[str, dict[str, Any]]:
        """The section ``devices`` of a configuration with the real drivers for what is served."""
        return dict(self._sections)

    def _port(self, device: str) -> int:
        return 0 if self.first_port is None else self.first_port + PORTS.index(device)

    def _serve(self, emulator: Emulator) -> None:
        emulator.start()
        self._stops.append(emulator.stop)
        self.served.append(Served(emulator.address, emulator.summary))

    def _start_cameras(self) -> list[str]:
        cameras = [self.devices[name] for name in ("primary", "auxiliary") if self.devices.get(name) is not None]
        if not cameras:
            return []
        try:
            from drivers.emulators.gige import serve_cameras

            serving = serve_cameras(cameras)
        except (ImportError, OSError) as error:
            return [f"the cameras are not served: {error}"]
        self._stops.append(serving.stop)
        for emulator, camera in zip(serving.emulators, cameras, strict=False):
            device = _camera_name(self.devices, camera)
            self.served.append(Served(emulator.address, emulator.summary))
            self.devices_served[device] = EmulatedDevice(
                (emulator.faults,), emulator.power_cycle, emulator.lose_packets
            )
            self._sections[device] = {
                "driver": "camera.aravis",
                "address": emulator.address,
                "stall_timeout_s": SILENT_S,
            }
        return list(serving.missing)

    def _start_stages(self) -> None:
        scales = [ZABER_MICROSTEPS_PER_UNIT[_UNITS[device]] for device in _STAGES]
        zaber = ZaberEmulator(
            [(self.devices[device], scale) for device, scale in zip(_STAGES, scales, strict=True)],
            transport="tcp",
            port=self._port("zaber"),
            also_pty=True,
        )
        for number, device in enumerate(_STAGES):
            ximc = self._start_ximc(device)
            other = zaber.devices[number]
            self.devices_served[device] = EmulatedDevice(
                (ximc.faults, other.faults), partial(_one_after_the_other, other.power_cycle, ximc.power_cycle)
            )
        self._serve(zaber)
        self.served += _by_serial_port(zaber)
        if self.stages == "zaber":
            for number, (device, scale) in enumerate(zip(_STAGES, scales, strict=True), start=1):
                spec = self.devices[device].carriages[0].spec
                self._sections[device] = {
                    "driver": "axis.zaber",
                    **_stage(zaber.address, _UNITS[device], spec),
                    "address": number,
                    "microsteps_per_unit": scale,
                    "homing_speed": spec.homing_speed,
                    "home_position": spec.home,
                }

    def _start_ximc(self, device: str) -> XimcEmulator:
        axis: SimulatedAxis = self.devices[device]
        unit, spec = _UNITS[device], axis.carriages[0].spec
        emulator = XimcEmulator(axis, unit, transport="tcp", port=self._port(device), also_pty=True)
        self._serve(emulator)
        self.served += _by_serial_port(emulator)
        if self.stages == "ximc":
            self._sections[device] = {
                "driver": "axis.ximc",
                **_stage(emulator.address, unit, spec),
                "steps_per_unit": STEPS_PER_UNIT[unit],
                "microsteps": MICROSTEPS,
                "homing": {
                    "fast_speed": spec.homing_speed,
                    "slow_speed": spec.homing_speed,
                    "position": spec.home,
                },
            }
        return emulator

    def _start_jacks(self) -> None:
        axis: SimulatedAxis = self.devices["jacks"]
        spec = axis.carriages[0].spec
        emulator = ModbusJacksEmulator(axis, transport="tcp", port=self._port("jacks"), also_rtu=True)
        self._serve(emulator)
        self.served.append(Served(emulator.addresses[1], emulator.summary.replace("Modbus TCP", "Modbus RTU")))
        self.devices_served["jacks"] = EmulatedDevice((emulator.faults,), emulator.power_cycle)
        self._sections["jacks"] = {
            "driver": "axis.modbus",
            "address": emulator.address,
            **{
                name: {
                    "unit": unit,
                    "limits_mm": [carriage.spec.limits.low, carriage.spec.limits.high],
                    "height_at_zero_mm": carriage.spec.home,
                }
                for unit, (name, carriage) in enumerate(zip(("lower", "upper"), axis.carriages, strict=True), start=1)
            },
            "speed_mm_s": spec.speed,
            "acceleration_mm_s2": spec.acceleration,
            "homing_speed_mm_s": spec.homing_speed,
        }

    def _start_pressure(self) -> None:
        source: SimulatedPressure | None = self.devices.get("pressure")
        if source is None:
            return
        wiring = Wiring()
        top = source.limits_kpa.high
        emulator = LabJackT7Emulator(source, wiring, port=self._port("pressure"))
        self._serve(emulator)
        self.devices_served["pressure"] = EmulatedDevice((emulator.faults,), emulator.power_cycle)
        self._sections["pressure"] = {
            "driver": "pressure.labjack_t7",
            "address": emulator.address,
            "transducer": {
                "serial": "twin-transducer",
                "volts_at_zero": wiring.transducer_v_at_0_kpa,
                "kpa_per_volt": 1.0 / wiring.transducer_v_per_kpa,
                "range_kpa": [0.0, 1.25 * top],
            },
            "regulator": {"volts_per_kpa": 1.0 / wiring.regulator_kpa_per_v},
            "limits_kpa": [0.0, top],
            "ceiling_kpa": 1.0625 * top,
        }


def _by_serial_port(emulator: XimcEmulator | ZaberEmulator) -> list[Served]:
    """Its further lines."""
    return [Served(address, f"{emulator.summary}, the same by its serial port") for address in emulator.addresses[1:]]


def _stage(address: str, unit: str, spec: Any) -> dict[str, Any]:
    return {
        "port": address,
        "unit": unit,
        "limits": [spec.limits.low, spec.limits.high],
        "speed": spec.speed,
        "acceleration": spec.acceleration,
        "repeatability": spec.repeatability,
    }


def _one_after_the_other(*calls: Callable[[], None]) -> None:
    for call in calls:
        call()


def _camera_name(devices: Mapping[str, Any], camera: SimulatedCamera) -> str:
    return next(name for name in ("primary", "auxiliary") if devices.get(name) is camera)
