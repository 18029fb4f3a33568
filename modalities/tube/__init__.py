"""A printed tube of known size, by which instruments are calibrated: its marks, and where they lie in a recording."""
