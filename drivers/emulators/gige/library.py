"""Aravis's fake camera in C, called through ctypes: its callback for images can not be set from PyGObject."""

from __future__ import annotations

import ctypes
from ctypes import CFUNCTYPE, POINTER, byref, c_char_p, c_int, c_size_t, c_uint32, c_uint64, c_void_p
from functools import cache
from typing import Any

#: ``fill(buffer, data, exposure_us, gain, pixel_format)``, called on the fake camera's thread for each frame.
FillCallback = CFUNCTYPE(None, c_void_p, c_void_p, c_uint32, c_uint32, c_uint32)

_G_TYPE_DOUBLE = 15 << 2


class _GValue(ctypes.Structure):
    _fields_ = (("g_type", c_size_t), ("data", c_uint64 * 2))


@cache
def _aravis() -> Any:
    try:
        library = ctypes.CDLL("libaravis-0.8.so.0")
    except OSError as err:
        raise OSError(f"GigE Vision needs Aravis ({err}); run: apt-get install libaravis-0.8-0") from err
    for name, result, arguments in (
        ("arv_gv_fake_camera_new_full", c_void_p, (c_char_p, c_char_p, c_char_p)),
        ("arv_gv_fake_camera_get_fake_camera", c_void_p, (c_void_p,)),
        ("arv_gv_fake_camera_is_running", c_int, (c_void_p,)),
        ("arv_fake_camera_write_register", c_int, (c_void_p, c_uint32, c_uint32)),
        ("arv_fake_camera_read_register", c_int, (c_void_p, c_uint32, POINTER(c_uint32))),
        ("arv_fake_camera_write_memory", c_int, (c_void_p, c_uint32, c_uint32, c_char_p)),
        ("arv_fake_camera_set_fill_pattern", None, (c_void_p, c_void_p, c_void_p)),
        ("arv_fake_camera_set_trigger_frequency", None, (c_void_p, ctypes.c_double)),
        ("arv_buffer_get_data", c_void_p, (c_void_p, POINTER(c_size_t))),
        ("arv_buffer_set_timestamp", None, (c_void_p, c_uint64)),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


@cache
def _gobject() -> Any:
    library = ctypes.CDLL("libgobject-2.0.so.0")
    library.g_object_unref.restype, library.g_object_unref.argtypes = None, (c_void_p,)
    library.g_value_init.restype, library.g_value_init.argtypes = c_void_p, (POINTER(_GValue), c_size_t)
    library.g_value_set_double.restype, library.g_value_set_double.argtypes = None, (POINTER(_GValue), ctypes.c_double)
    library.g_object_set_property.restype = None
    library.g_object_set_property.argtypes = (c_void_p, c_char_p, POINTER(_GValue))
    return library


class FakeCamera:
    """One ``ArvGvFakeCamera``: listens from its making until `close`. Raises `OSError` where Aravis is missing.

    Parameters
    ----------
    address : str
        Address of an interface of this host.
    serial : str
        Serial number, at most 15 characters.
    genicam_path : str
        GenICam description; read once, not needed afterwards.
    fill : callable
        ``fill(buffer, exposure_us, gain)``, called on the camera's thread for each frame; must not raise.
    """

    def __init__(self, address: str, serial: str, genicam_path: str, fill: Any) -> None:
        self._library = _aravis()
        self._camera = self._library.arv_gv_fake_camera_new_full(
            address.encode(), serial.encode(), genicam_path.encode()
        )
        if not self._library.arv_gv_fake_camera_is_running(self._camera):
            _gobject().g_object_unref(self._camera)
            raise OSError(f"no interface of this host has the address {address}")
        self._registers = self._library.arv_gv_fake_camera_get_fake_camera(self._camera)
        # kept: the library holds a bare pointer to it
        self._callback = FillCallback(lambda buffer, _data, exposure, gain, _format: fill(buffer, exposure, gain))
        self._library.arv_fake_camera_set_fill_pattern(self._registers, ctypes.cast(self._callback, c_void_p), None)

    def close(self) -> None:
        """Stop listening, join the camera's thread and free it."""
        _gobject().g_object_unref(self._camera)

    def read(self, register: int) -> int:
        """The value of a 32 bit register."""
        value = c_uint32()
        self._library.arv_fake_camera_read_register(self._registers, register, byref(value))
        return value.value

    def write(self, register: int, value: int) -> None:
        """Set a 32 bit register."""
        self._library.arv_fake_camera_write_register(self._registers, register, value)

    def write_text(self, register: int, text: str, size: int) -> None:
        """Set a register of ``size`` bytes to a text, cut where it is too long."""
        encoded = text.encode()[: size - 1].ljust(size, b"\0")
        self._library.arv_fake_camera_write_memory(self._registers, register, size, encoded)

    def look_for_triggers(self, frequency_hz: float) -> None:
        """How often the camera looks whether it was triggered."""
        self._library.arv_fake_camera_set_trigger_frequency(self._registers, frequency_hz)

    def lose_packets(self, ratio: float) -> None:
        """Which share of the packets of a frame is not sent, from now on."""
        value = _GValue()
        _gobject().g_value_init(byref(value), _G_TYPE_DOUBLE)
        _gobject().g_value_set_double(byref(value), ratio)
        _gobject().g_object_set_property(self._camera, b"gvsp-lost-ratio", byref(value))

    def fill(self, buffer: int, content: bytes, time_ns: int) -> None:
        """Copy a frame's bytes into a buffer of the callback and stamp it with the camera's time."""
        target = self._library.arv_buffer_get_data(buffer, byref(c_size_t()))
        ctypes.memmove(target, content, len(content))
        self._library.arv_buffer_set_timestamp(buffer, time_ns)
