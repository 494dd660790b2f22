"""Where things are in the emulated camera's memory: what Aravis's fake camera fixes, and what is ours."""

from __future__ import annotations

# GigE Vision bootstrap registers
VENDOR, MODEL, VERSION = 0x48, 0x68, 0x88
TEXT_BYTES = 32
STREAM_PORT = 0xD00
"""Where frames are sent to; another for each stream of a client."""

# read by the fake camera itself
WIDTH, HEIGHT = 0x100, 0x104
BINNING_X, BINNING_Y = 0x108, 0x10C
GAIN, EXPOSURE_US = 0x110, 0x120
SENSOR_WIDTH, SENSOR_HEIGHT = 0x118, 0x11C
ACQUISITION, PIXEL_FORMAT, ACQUISITION_MODE = 0x124, 0x128, 0x12C
OFFSET_X, OFFSET_Y = 0x130, 0x134
FRAME_PERIOD_US = 0x138
TRIGGER_MODE, TRIGGER_SOURCE, TRIGGER_ACTIVATION, TRIGGER_NOW = 0x300, 0x304, 0x308, 0x30C

# plain memory
TRIGGER_INPUT = 0x1000
"""The chosen input: 0 a line, 1 the command; the fake camera knows only its own ``TRIGGER_SOURCE``, always 1."""
TRIGGER_COMMAND = 0x1004
"""Where the software trigger is written while a line is chosen: nothing looks there."""
TEMPERATURE = 0x1008
"""In hundredths of a degree."""
