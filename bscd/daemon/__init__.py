"""One process that owns the rig: states, jobs, interlocks, journal; what operators and scripts talk to is above."""
