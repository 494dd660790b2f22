"""The Python client of a running daemon."""
