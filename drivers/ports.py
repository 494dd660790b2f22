"""Ports of this computer by names that last: a device keeps its own however it is plugged in."""

from __future__ import annotations

from pathlib import Path

DEV = Path("/dev")


def by_id(folder: str) -> list[str]:
    """The names in ``/dev/FOLDER/by-id`` and what they stand for now, a line each; none without udev."""
    names = DEV / folder / "by-id"
    if not names.is_dir():
        return []
    return [f"{name} ({name.resolve()})" for name in sorted(names.iterdir())]


def serial_ports() -> list[str]:
    """Serial ports."""
    return by_id("serial")


def video_devices() -> list[str]:
    """V4L2 devices."""
    return by_id("v4l")
