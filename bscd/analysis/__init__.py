"""What the measurements say: validation of a calibration, figures and reports."""
