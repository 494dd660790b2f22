"""The names that run files use; without any library, so that recipes can use them."""

from __future__ import annotations

from typing import Literal, get_args

Compression = Literal["none", "bitshuffle-lz4"]
CameraName = Literal["primary", "auxiliary"]
PhaseName = Literal["reference-corner", "reference-face", "bsc-corner", "bsc-face", "sphere", "inflation"]
AxisUnit = Literal["mm", "deg"]
AxisName = Literal["translation", "rotation", "jack"]

#: The cameras, phases and axes that a run file knows, in the order in which messages name them.
CAMERAS: tuple[CameraName, ...] = get_args(CameraName)
PHASES: tuple[PhaseName, ...] = get_args(PhaseName)
AXES: tuple[AxisName, ...] = get_args(AxisName)

RECORDER = "recorder"
"""The recorder's name among the consumers of a stream."""
