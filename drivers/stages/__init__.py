"""Motorised stages on their makers' serial protocols."""
