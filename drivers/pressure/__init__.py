"""Pressure sources: a regulator and a transducer behind a LabJack T7, or a transducer and a person at the regulator."""
