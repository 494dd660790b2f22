"""Drivers for the rig's hardware, and the digital twin; knows nothing of bscd."""
