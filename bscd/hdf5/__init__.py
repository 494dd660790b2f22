"""What the project's HDF5 files have in common: opened, written while they can be read, closed with a state."""
