"""Results: measured shapes and displacements of a run, kept and exported."""
