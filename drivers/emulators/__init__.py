"""Simulated devices behind their real wire protocols, so that real drivers and the makers' own tools can talk to them.

An emulator is a protocol adapter around a simulated device: physics, limits and its own faults stay there. It shares no
framing or checksum code with the driver of the same protocol, or one error would cancel the other.
"""
