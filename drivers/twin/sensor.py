"""From a sharp image of brightness to grey levels: blur, vignetting, exposure, gain, noise, saturation, bits."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.twin.bands import run_in_bands
from drivers.twin.optics import CameraOptics
from drivers.twin.options import SensorOptions

FloatImage = NDArray[np.float32]


def vignette(camera: CameraOptics, loss: float) -> FloatImage:
    """Relative illumination ``(H, W)``: 1 at the principal point, ``1 - loss`` at half the sensor's diagonal."""
    column = np.arange(camera.width_px) - camera.principal_px[0]
    row = np.arange(camera.height_px) - camera.principal_px[1]
    half_diagonal2 = (camera.width_px**2 + camera.height_px**2) / 4.0
    return (1.0 - loss * (column[None, :] ** 2 + row[:, None] ** 2) / half_diagonal2).astype(np.float32)


def blur(sharp: FloatImage, sigma_px: float) -> FloatImage:
    """The lens's Gaussian point spread; the image is continued by its border values."""
    if sigma_px == 0.0:
        return sharp
    size = 2 * math.ceil(5.0 * sigma_px) + 1
    blurred = cv2.GaussianBlur(sharp, (size, size), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)


def electrons_full_scale(sensor: SensorOptions) -> float:
    """Electrons at full scale such that shot and read noise add up to ``noise_grey`` at the working level.

    From (noise / 255 N)^2 = level N + (read / 255 N)^2.
    """
    variance = (sensor.noise_grey**2 - sensor.read_noise_grey**2) / 255.0**2
    return sensor.working_level / variance


@njit(cache=True, nogil=True)
def _digitise(first, last, irradiance, noise, scale, shot, read, top, out):
    """Grey = scale * irradiance + noise, rounded and saturated; variance = shot * grey + read^2 in grey levels."""
    for r in range(first, last):
        for c in range(out.shape[1]):
            grey = scale * irradiance[r, c]
            grey += noise[r, c] * np.sqrt(shot * max(grey, 0.0) + read * read)
            out[r, c] = min(max(np.floor(grey + 0.5), 0.0), top)


def digitise(
    irradiance: FloatImage, sensor: SensorOptions, *, exposure_s: float, gain_db: float, rng: np.random.Generator
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Grey levels ``(H, W)`` of an exposure.

    Shot noise in its Gaussian limit (hundreds of electrons and more). Gain amplifies signal, shot and read noise
    alike. ``noise = "gaussian"`` puts the same ``noise_grey`` on every pixel at every level and gain.
    """
    top = float(2**sensor.bits - 1)
    gain = 10.0 ** (gain_db / 20.0)
    scale = top * gain * exposure_s / sensor.nominal_exposure_s
    shot, read = 0.0, sensor.noise_grey * top / 255.0
    if sensor.noise == "shot" and sensor.noise_grey > 0.0:
        shot = top * gain / electrons_full_scale(sensor)
        read = sensor.read_noise_grey * gain * top / 255.0
    noise = rng.standard_normal(irradiance.shape, dtype=np.float32)
    out: NDArray[np.uint8] | NDArray[np.uint16]
    out = np.empty(irradiance.shape, np.uint8) if sensor.bits == 8 else np.empty(irradiance.shape, np.uint16)
    run_in_bands(
        len(out),
        lambda first, last: _digitise(first, last, irradiance, noise, scale, shot, read, top, out),
        small=64,
    )
    return out
