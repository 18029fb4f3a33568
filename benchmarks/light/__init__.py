"""A path tracer of a bore with one cell, to hold the simulated endoscope's light against."""
