"""The emulated camera's GenICam description: which features it has, their limits and their registers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.emulators.gige import registers as at
from drivers.interfaces import Range

_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Twin" VendorName="bscd" StandardNameSpace="None" SchemaMajorVersion="1"
 SchemaMinorVersion="0" SchemaSubMinorVersion="1" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ToolTip="The digital twin's camera" ProductGuid="0" VersionGuid="0"
 xmlns="http://www.genicam.org/GenApi/Version_1_0">"""


@dataclass(frozen=True, slots=True)
class CameraDescription:
    """What differs from one emulated camera to the other."""

    width_px: int
    height_px: int
    pixel_size_mm: float
    exposure_limits_s: Range
    gain_limits_db: Range
    frame_rate_limits_hz: Range
    formats: Mapping[str, int]


def describe(camera: CameraDescription) -> str:
    """The description as XML, after the SFNC's names; gain in hundredths of a dB, times in us."""
    exposure, gain, rate = camera.exposure_limits_s, camera.gain_limits_db, camera.frame_rate_limits_hz
    features = [
        _text("DeviceVendorName", at.VENDOR),
        _text("DeviceModelName", at.MODEL),
        _text("DeviceVersion", at.VERSION),
        _scaled("DeviceTemperature", at.TEMPERATURE, 100.0, None, "RO"),
        _integer("SensorWidth", at.SENSOR_WIDTH, access="RO"),
        _integer("SensorHeight", at.SENSOR_HEIGHT, access="RO"),
        _constant("SensorPixelWidth", 1e3 * camera.pixel_size_mm),
        _constant("SensorPixelHeight", 1e3 * camera.pixel_size_mm),
        _quotient("WidthMax", "SensorWidth", "BinningHorizontal"),
        _quotient("HeightMax", "SensorHeight", "BinningVertical"),
        _integer("Width", at.WIDTH, "<Min>8</Min><pMax>WidthMax</pMax><Inc>2</Inc>"),
        _integer("Height", at.HEIGHT, "<Min>2</Min><pMax>HeightMax</pMax><Inc>2</Inc>"),
        _integer("OffsetX", at.OFFSET_X, "<Min>0</Min><pMax>WidthMax</pMax><Inc>2</Inc>"),
        _integer("OffsetY", at.OFFSET_Y, "<Min>0</Min><pMax>HeightMax</pMax><Inc>2</Inc>"),
        _integer("BinningHorizontal", at.BINNING_X, "<Min>1</Min><Max>4</Max>"),
        _integer("BinningVertical", at.BINNING_Y, "<Min>1</Min><Max>4</Max>"),
        _choice("PixelFormat", at.PIXEL_FORMAT, camera.formats),
        _choice("AcquisitionMode", at.ACQUISITION_MODE, {"Continuous": 1}),
        _command("AcquisitionStart", at.ACQUISITION, 1),
        _command("AcquisitionStop", at.ACQUISITION, 0),
        _reciprocal("AcquisitionFrameRate", at.FRAME_PERIOD_US, rate),
        _choice("TriggerSelector", None, {"FrameStart": 0}),
        _choice("TriggerMode", at.TRIGGER_MODE, {"Off": 0, "On": 1}),
        _choice("TriggerSource", at.TRIGGER_INPUT, {"Line0": 0, "Software": 1}),
        _choice("TriggerActivation", at.TRIGGER_ACTIVATION, {"RisingEdge": 0, "FallingEdge": 1}),
        _software_trigger(),
        _scaled("ExposureTime", at.EXPOSURE_US, 1.0, Range(1e6 * exposure.low, 1e6 * exposure.high)),
        _scaled("Gain", at.GAIN, 100.0, gain),
        '<IntSwissKnife Name="PayloadSize"><pVariable Name="W">Width</pVariable><pVariable Name="H">Height</pVariable>'
        '<pVariable Name="F">PixelFormat</pVariable><Formula>W * H * ((F &gt;&gt; 16) &amp; 0xFF) / 8</Formula>'
        "</IntSwissKnife>",
        '<Integer Name="TLParamsLocked"><Value>0</Value><Min>0</Min><Max>1</Max></Integer>',
        '<Port Name="Device" NameSpace="Standard"></Port>',
    ]
    names = [feature.split('Name="', 1)[1].split('"', 1)[0] for feature in features[:-2]]
    root = "".join(f"<pFeature>{name}</pFeature>" for name in names)
    category = f'<Category Name="Root" NameSpace="Standard">{root}</Category>'
    return "\n".join([_HEAD, category, *features, "</RegisterDescription>\n"])


def _register(name: str, address: int, access: str) -> str:
    return (
        f'<IntReg Name="{name}"><Address>{address:#x}</Address><Length>4</Length><AccessMode>{access}</AccessMode>'
        "<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )


def _text(name: str, address: int) -> str:
    return (
        f'<StringReg Name="{name}"><Address>{address:#x}</Address><Length>{at.TEXT_BYTES}</Length>'
        "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>"
    )


def _integer(name: str, address: int, limits: str = "", access: str = "RW") -> str:
    feature = f'<Integer Name="{name}"><pValue>{name}Register</pValue>{limits}</Integer>'
    return feature + _register(f"{name}Register", address, access)


def _choice(name: str, address: int | None, values: Mapping[str, int]) -> str:
    entries = "".join(f'<EnumEntry Name="{key}"><Value>{value}</Value></EnumEntry>' for key, value in values.items())
    if address is None:
        first = next(iter(values.values()))
        return f'<Enumeration Name="{name}">{entries}<Value>{first}</Value></Enumeration>'
    feature = f'<Enumeration Name="{name}">{entries}<pValue>{name}Register</pValue></Enumeration>'
    return feature + _register(f"{name}Register", address, "RW")


def _command(name: str, address: int, value: int) -> str:
    feature = f'<Command Name="{name}"><pValue>{name}Register</pValue><CommandValue>{value}</CommandValue></Command>'
    return feature + _register(f"{name}Register", address, "WO")


def _software_trigger() -> str:
    """The command reaches the fake camera only while the trigger's source is the command."""
    feature = (
        '<Command Name="TriggerSoftware"><pValue>TriggerSoftwareRegister</pValue><CommandValue>1</CommandValue>'
        "</Command>"
    )
    address = (
        '<IntSwissKnife Name="TriggerSoftwareAddress"><pVariable Name="S">TriggerSourceRegister</pVariable>'
        f"<Formula>(S = 1) ? {at.TRIGGER_NOW} : {at.TRIGGER_COMMAND}</Formula></IntSwissKnife>"
    )
    register = (
        '<IntReg Name="TriggerSoftwareRegister"><pAddress>TriggerSoftwareAddress</pAddress><Length>4</Length>'
        "<AccessMode>WO</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )
    return feature + address + register


def _scaled(name: str, address: int, scale: float, limits: Range | None, access: str = "RW") -> str:
    bounds = f"<Min>{limits.low}</Min><Max>{limits.high}</Max>" if limits else ""
    return (
        f'<Float Name="{name}"><pValue>{name}Converter</pValue>{bounds}</Float>'
        f'<Converter Name="{name}Converter"><FormulaTo>FROM * {scale}</FormulaTo>'
        f"<FormulaFrom>TO / {scale}</FormulaFrom><pValue>{name}Register</pValue></Converter>"
        + _register(f"{name}Register", address, access)
    )


def _reciprocal(name: str, address: int, limits: Range) -> str:
    return (
        f'<Float Name="{name}"><pValue>{name}Converter</pValue><Min>{limits.low}</Min><Max>{limits.high}</Max></Float>'
        f'<Converter Name="{name}Converter"><FormulaTo>1000000.0 / FROM</FormulaTo>'
        f"<FormulaFrom>1000000.0 / TO</FormulaFrom><pValue>{name}Register</pValue></Converter>"
        + _register(f"{name}Register", address, "RW")
    )


def _constant(name: str, value: float) -> str:
    return f'<Float Name="{name}"><Value>{value}</Value></Float>'


def _quotient(name: str, whole: str, part: str) -> str:
    return (
        f'<IntSwissKnife Name="{name}"><pVariable Name="A">{whole}</pVariable><pVariable Name="B">{part}</pVariable>'
        "<Formula>A / B</Formula></IntSwissKnife>"
    )
