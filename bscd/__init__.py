"""bscd: a measurement daemon for biprism single-camera stereo-DIC rigs."""

__version__ = "0.1.0"
