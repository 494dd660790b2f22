"""An open Aravis camera: its identity, its settings and its triggers, in our units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from drivers.cameras.aravis.acquisition import Acquisition
from drivers.cameras.aravis.library import aravis_for, library_errors
from drivers.cameras.aravis.network import set_packets
from drivers.cameras.aravis.options import AravisOptions
from drivers.cameras.aravis.pixels import bit_depth
from drivers.errors import OutOfLimitsError, UnsupportedError
from drivers.interfaces import CameraInfo, Range

SNAP_BUFFERS = 2


@dataclass(frozen=True, slots=True)
class Settings:
    """What can be changed while connected."""

    exposure_s: float
    gain_db: float
    frame_rate_hz: float


class Device:
    """Sets an open camera up as the options say; not safe to use from two threads at once.

    Raises what `library_errors` makes of GLib's errors, `OutOfLimitsError` for a region or a binning outside the
    sensor, `UnsupportedError` for a pixel format that the camera does not have.
    """

    def __init__(self, camera: Any, options: AravisOptions, name: str) -> None:
        self._aravis = aravis_for(name)
        self._camera = camera
        self._device = camera.get_device()
        self._options = options
        self._name = name
        self._armed = ""
        self.is_gige = bool(camera.is_gv_device())
        with library_errors(name, "setting up"):
            camera.stop_acquisition()  # of a program that crashed
            if self.is_gige:
                set_packets(camera, options, name)
            self._set_image()
            self._set_automatics_off()
            self.info = self._identify()

    def set(self, settings: Settings) -> Settings:
        """Set exposure, gain and frame rate; returns what the camera made of them."""
        doing = f"setting {settings.exposure_s:g} s, {settings.gain_db:g} dB, {settings.frame_rate_hz:g} Hz"
        camera = self._camera
        with library_errors(self._name, doing):
            armed, self._armed = self._armed, ""  # setting the rate switches triggers off
            if camera.is_frame_rate_available():
                camera.set_frame_rate(settings.frame_rate_hz)
            camera.set_exposure_time(1e6 * settings.exposure_s)
            if camera.is_gain_available():
                camera.set_gain(settings.gain_db)
            if armed:
                self.arm(armed)
            return Settings(
                exposure_s=1e-6 * camera.get_exposure_time(),
                gain_db=camera.get_gain() if camera.is_gain_available() else 0.0,
                frame_rate_hz=camera.get_frame_rate() if camera.is_frame_rate_available() else settings.frame_rate_hz,
            )

    def frame_rate_limits_hz(self) -> Range:
        """The rates that can be had with the exposure as it is set."""
        with library_errors(self._name, "asking for the frame rate's limits"):
            if not self._camera.is_frame_rate_available():
                return Range(0.0, math.inf)
            limits = self._camera.get_frame_rate_bounds()
            return Range(limits.min, limits.max)

    def temperature_deg(self) -> float:
        """The camera's temperature in degrees Celsius, NaN when it does not tell."""
        with library_errors(self._name, "reading the temperature"):
            for feature in ("DeviceTemperature", "DeviceTemperatureAbs"):
                if self._device.is_feature_available(feature):
                    return float(self._device.get_float_feature_value(feature))
        return math.nan

    def can_be_triggered(self) -> bool:
        """Whether a frame can be asked for by command."""
        with library_errors(self._name, "asking for its triggers"):
            return bool(self._camera.is_software_trigger_supported())

    def arm(self, trigger: str) -> None:
        """Choose what starts an exposure: "off" (the frame rate), "software" or "hardware"."""
        if trigger == self._armed:
            return
        camera = self._camera
        with library_errors(self._name, f"switching its trigger to {trigger}"):
            camera.clear_triggers()
            if trigger == "software":
                camera.set_trigger("Software")
            elif trigger == "hardware":
                camera.set_trigger(self._options.trigger_source)
                edge = "RisingEdge" if self._options.trigger_edge == "rising" else "FallingEdge"
                camera.set_string("TriggerActivation", edge)
        self._armed = trigger

    def start(self, buffers: int) -> Acquisition:
        """Open a stream and start to acquire."""
        with library_errors(self._name, "starting to acquire"):
            acquisition = Acquisition(self._aravis, self._camera, self._options, self._name, buffers)
            try:
                self._camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)
                self._camera.start_acquisition()
            except BaseException:
                acquisition.close()
                raise
            return acquisition

    def stop(self, acquisition: Acquisition) -> None:
        """Stop to acquire and close the stream."""
        try:
            with library_errors(self._name, "stopping to acquire"):
                self._camera.stop_acquisition()
        finally:
            acquisition.close()

    def trigger(self) -> None:
        """Start one exposure by command."""
        with library_errors(self._name, "triggering a frame"):
            self._camera.software_trigger()

    def is_ours(self) -> bool:
        """Whether the heartbeat still finds the camera, and us in control; sends nothing."""
        return not self.is_gige or bool(self._device.is_controller())

    def release(self) -> None:
        """Give up control of the camera; Aravis itself does it only when nobody holds this any more."""
        if self.is_gige and self.is_ours():
            with library_errors(self._name, "releasing the camera"):
                self._device.leave_control()

    def answers(self) -> None:
        """Ask the camera for anything; raises when it does not answer."""
        with library_errors(self._name, "looking whether it answers"):
            self._camera.get_exposure_time()

    def _set_image(self) -> None:
        camera, options = self._camera, self._options
        formats = camera.dup_available_pixel_formats_as_strings()
        if options.pixel_format not in formats:
            raise UnsupportedError(self._name, f"it has no pixel format {options.pixel_format}", _one_of(formats))
        camera.set_pixel_format_from_string(options.pixel_format)
        if camera.is_binning_available():
            camera.set_binning(*options.binning)
        elif options.binning != (1, 1):
            raise UnsupportedError(self._name, "it can not bin pixels", "leave binning out")
        if camera.is_region_offset_available():
            camera.set_region(0, 0, -1, -1)
        whole = camera.get_width_bounds().max, camera.get_height_bounds().max
        left, top, width, height = options.region_px or (0, 0, *whole)
        if left + width > whole[0] or top + height > whole[1]:
            raise OutOfLimitsError(
                self._name,
                f"region_px {left}, {top}, {width}, {height} lies outside the image",
                f"it has {whole[0]} x {whole[1]} pixels with this binning",
            )
        camera.set_region(-1, -1, width, height)
        if camera.is_region_offset_available():
            camera.set_region(left, top, width, height)
        read = camera.get_region()
        if (read.x, read.y, read.width, read.height) != (left, top, width, height):
            hint = f"the nearest it takes is {read.x}, {read.y}, {read.width}, {read.height}"
            raise OutOfLimitsError(self._name, f"region_px {left}, {top}, {width}, {height} is not on its grid", hint)

    def _set_automatics_off(self) -> None:
        off = self._aravis.Auto.OFF
        if self._camera.is_exposure_auto_available():
            self._camera.set_exposure_time_auto(off)
        if self._camera.is_gain_auto_available():
            self._camera.set_gain_auto(off)

    def _identify(self) -> CameraInfo:
        camera = self._camera
        region, exposure = camera.get_region(), camera.get_exposure_time_bounds()
        gain = camera.get_gain_bounds() if camera.is_gain_available() else None
        return CameraInfo(
            vendor=camera.get_vendor_name() or "unknown",
            model=camera.get_model_name() or "unknown",
            serial=camera.get_device_serial_number() or camera.get_device_id(),
            width_px=region.width,
            height_px=region.height,
            pixel_size_mm=self._pixel_size_mm(),
            bit_depth=bit_depth(self._options.pixel_format),
            exposure_limits_s=Range(1e-6 * exposure.min, 1e-6 * exposure.max),
            gain_limits_db=Range(gain.min, gain.max) if gain is not None else Range(0.0, 0.0),
            firmware=self._firmware(),
        )

    def _firmware(self) -> str:
        for feature in ("DeviceFirmwareVersion", "DeviceVersion"):
            if self._device.is_feature_available(feature):
                return self._device.get_string_feature_value(feature) or ""
        return ""

    def _pixel_size_mm(self) -> float:
        """Edge of a pixel of the image, binning included; NaN when neither camera nor options tell."""
        size_mm = self._options.pixel_size_mm
        if size_mm is None and self._device.is_feature_available("SensorPixelWidth"):
            size_mm = 1e-3 * float(self._device.get_float_feature_value("SensorPixelWidth"))
        return math.nan if size_mm is None else size_mm * self._options.binning[0]


def _one_of(formats: list[str]) -> str:
    return f"choose one of {', '.join(formats)}"
