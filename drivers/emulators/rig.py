"""A whole rig's simulated devices behind their wire protocols at once, and how real drivers are told of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from drivers.emulators.emulator import Emulator
from drivers.emulators.lines import Transport, open_line
from drivers.emulators.modbus import LabJackT7Emulator, ModbusJacksEmulator
from drivers.emulators.modbus.labjack_t7 import Wiring
from drivers.emulators.ximc import XimcEmulator
from drivers.emulators.ximc.emulator import STEPS_PER_UNIT
from drivers.emulators.ximc.messages import XimcSession
from drivers.emulators.zaber import ZaberEmulator
from drivers.simulated import SimulatedAxis, SimulatedCamera, SimulatedPressure

StageProtocol = Literal["ximc", "zaber"]

#: Microsteps of an XIMC controller; of a Zaber X-LSM and an X-RSW a unit.
MICROSTEPS = 256
ZABER_MICROSTEPS_PER_UNIT = {"mm": 1.0 / 0.047625e-3, "deg": 768000.0 / 180.0}

#: TCP ports from the first one on, so that a configuration can name them.
PORTS = ("rotation", "translation", "jacks", "pressure")
FIRST_PORT = 7101

#: An emulated camera is silent while the twin renders, which takes as long as the machine's other work lets it.
SILENT_S = 5.0

_STAGES = ("rotation", "translation")
_UNITS = {"rotation": "deg", "translation": "mm"}


def smallest_step(device: str, protocol: StageProtocol) -> float:
    """What a stage's simulated mechanics must resolve for its controller to count it, mm or deg."""
    unit = _UNITS[device]
    return 1.0 / (STEPS_PER_UNIT[unit] * MICROSTEPS if protocol == "ximc" else ZABER_MICROSTEPS_PER_UNIT[unit])


@dataclass(frozen=True)
class Served:
    """A device that can be reached: where, what it is, and a configuration's section for the real driver."""

    device: str
    address: str
    summary: str
    section: dict[str, Any]


@dataclass
class EmulatedRig:
    """Emulators around a rig's simulated devices; `start` serves what can be served and tells what can not.

    Parameters
    ----------
    devices : mapping of str to simulated device
        By their names in a configuration: primary, auxiliary, rotation, translation, jacks, pressure; None: left out.
    stages : {"ximc", "zaber"}
        What the two stages speak.
    first_port : int or None
        TCP ports from here on, in the order of `PORTS`; None: free ones.
    """

    devices: Mapping[str, Any]
    stages: StageProtocol = "ximc"
    first_port: int | None = FIRST_PORT
    served: list[Served] = field(default_factory=list)
    emulators: dict[str, Emulator] = field(default_factory=dict)
    _stops: list[Callable[[], None]] = field(default_factory=list)

    def start(self) -> list[str]:
        """Serve; what could not be served and what to do about it. Raises `OSError` for a port that is taken."""
        missing: list[str] = []
        try:
            missing += self._start_cameras()
            for device in _STAGES if self.stages == "ximc" else ():
                self._start_ximc(device)
            if self.stages == "zaber":
                self._start_zaber()
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
        self.emulators.clear()

    def configuration(self) -> dict[str, dict[str, Any]]:
        """The section ``devices`` of a configuration with the real drivers for what is served."""
        return {one.device: one.section for one in self.served if one.section}

    def _port(self, device: str) -> int:
        return 0 if self.first_port is None else self.first_port + PORTS.index(device)

    def _serve(self, device: str, emulator: Emulator, section: Callable[[str], dict[str, Any]]) -> None:
        emulator.start()
        self._stops.append(emulator.stop)
        self.emulators[device] = emulator
        self.served.append(Served(device, emulator.address, emulator.summary, section(emulator.address)))

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
            section = {"driver": "camera.aravis", "address": emulator.address, "stall_timeout_s": SILENT_S}
            device = _camera_name(self.devices, camera)
            self.emulators[device] = emulator
            self.served.append(Served(device, emulator.address, emulator.summary, section))
        return list(serving.missing)

    def _start_ximc(self, device: str) -> None:
        axis: SimulatedAxis = self.devices[device]
        unit, spec = _UNITS[device], axis.carriages[0].spec
        emulator = XimcEmulator(axis, unit, transport="tcp", port=self._port(device))
        self._serve(
            device,
            emulator,
            lambda address: {
                "driver": "axis.ximc",
                **_stage(address, unit, spec),
                "steps_per_unit": STEPS_PER_UNIT[unit],
                "microsteps": MICROSTEPS,
                "homing": {
                    "fast_speed": spec.homing_speed,
                    "slow_speed": spec.homing_speed,
                    "position": spec.home,
                },
            },
        )
        self._also_on_a_serial_port(
            device, "Standa XIMC controller", lambda: XimcSession(emulator.controller), emulator
        )

    def _start_zaber(self) -> None:
        microsteps = [ZABER_MICROSTEPS_PER_UNIT[_UNITS[device]] for device in _STAGES]
        emulator = ZaberEmulator(
            [(self.devices[device], count) for device, count in zip(_STAGES, microsteps, strict=True)],
            transport="tcp",
            port=self._port("rotation"),
        )
        for number, (device, count) in enumerate(zip(_STAGES, microsteps, strict=True), start=1):
            spec = self.devices[device].carriages[0].spec
            section = {
                "driver": "axis.zaber",
                **_stage("", _UNITS[device], spec),
                "address": number,
                "microsteps_per_unit": count,
                "homing_speed": spec.homing_speed,
                "home_position": spec.home,
            }
            if number == 1:
                self._serve(device, emulator, lambda address, section=section: {**section, "port": address})
            else:
                self.emulators[device] = emulator
                self.served.append(
                    Served(device, emulator.address, emulator.summary, {**section, "port": emulator.address})
                )

    def _start_jacks(self) -> None:
        axis: SimulatedAxis = self.devices["jacks"]
        spec = axis.carriages[0].spec
        jacks = {
            name: {"unit": unit, "limits_mm": [carriage.spec.limits.low, carriage.spec.limits.high]}
            for unit, (name, carriage) in enumerate(zip(("lower", "upper"), axis.carriages, strict=True), start=1)
        }
        self._serve(
            "jacks",
            ModbusJacksEmulator(axis, transport="tcp", port=self._port("jacks")),
            lambda address: {
                "driver": "axis.modbus",
                "address": address,
                **jacks,
                "speed_mm_s": spec.speed,
                "acceleration_mm_s2": spec.acceleration,
                "homing_speed_mm_s": spec.homing_speed,
            },
        )
        serial = ModbusJacksEmulator(axis, transport="rtu")
        serial.start()
        self._stops.append(serial.stop)
        self.served.append(Served("jacks", serial.address, serial.summary, {}))

    def _start_pressure(self) -> None:
        source: SimulatedPressure | None = self.devices.get("pressure")
        if source is None:
            return
        wiring = Wiring()
        top = source.limits_kpa.high
        self._serve(
            "pressure",
            LabJackT7Emulator(source, wiring, port=self._port("pressure")),
            lambda address: {
                "driver": "pressure.labjack_t7",
                "address": address,
                "transducer": {
                    "serial": "twin-transducer",
                    "volts_at_zero": wiring.transducer_v_at_0_kpa,
                    "kpa_per_volt": 1.0 / wiring.transducer_v_per_kpa,
                    "range_kpa": [0.0, 1.25 * top],
                },
                "regulator": {"volts_per_kpa": 1.0 / wiring.regulator_kpa_per_v},
                "limits_kpa": [0.0, top],
                "ceiling_kpa": 1.0625 * top,
            },
        )

    def _also_on_a_serial_port(
        self, device: str, what: str, session: Callable[[], Any], emulator: XimcEmulator
    ) -> None:
        transport: Transport = "pty"
        line = open_line(transport, session, emulator.faults)
        line.start()
        self._stops.append(line.stop)
        self.served.append(Served(device, line.address, f"{device}: {what}, the same by its serial port", {}))


def _stage(address: str, unit: str, spec: Any) -> dict[str, Any]:
    return {
        "port": address,
        "unit": unit,
        "limits": [spec.limits.low, spec.limits.high],
        "speed": spec.speed,
        "acceleration": spec.acceleration,
        "repeatability": spec.repeatability,
    }


def _camera_name(devices: Mapping[str, Any], camera: SimulatedCamera) -> str:
    return next(name for name in ("primary", "auxiliary") if devices.get(name) is camera)
