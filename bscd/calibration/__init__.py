"""Calibration of the standard stereo pair and of the biprism's two virtual cameras. Does no image file I/O."""
