"""The digital twin: exact optics, scenes, image formation and one shared world of the rig."""
