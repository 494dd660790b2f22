"""One error tree for everything a device can do wrong.

Every error carries the device's name, what was being done and what to do about it, and prints as one
sentence. Library errors (serial, Modbus, GLib, OS) are turned into these at the driver's boundary with
``raise ... from err``.
"""


class DeviceError(Exception):
    """Anything a device did wrong; raise a subclass, never this."""

    def __init__(self, device: str, doing: str, hint: str = "") -> None:
        self.device = device
        self.doing = doing
        self.hint = hint
        super().__init__(f"{device}: {doing}" + (f"; {hint}" if hint else ""))


class NotConnectedError(DeviceError):
    """The device was never found, or is gone. For a device that answers late use `DeviceTimeoutError`."""


class DeviceTimeoutError(DeviceError):
    """No answer, or a move not finished, within its time-out. For a lost line use `NotConnectedError`."""


class ProtocolError(DeviceError):
    """The device answered bytes that make no sense: a bad checksum, an unknown code, another's answer."""


class OutOfLimitsError(DeviceError):
    """A request lies outside the device's limits; raised before anything is sent to the device."""


class NotHomedError(DeviceError):
    """The device does not know where it is and was asked to move to an absolute position."""


class DeviceFaultError(DeviceError):
    """The device reports an alarm of its own: a limit switch, a stall, an over-temperature."""


class DeviceBusyError(DeviceError):
    """The device is taken: by a move that is under way, or by another program that owns it."""


class MoveStoppedError(DeviceError):
    """A move ended before its target because somebody stopped it; not a fault."""


class UnsupportedError(DeviceError):
    """The device can not do what was asked (see its capabilities); no retry will help."""
